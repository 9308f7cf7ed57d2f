"""The default prior with its derivative, and constant regions, in one pass over an image each; compiled for CPUs."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from ..hog.orientation import vanishing
from ..runtime.arrays import Floats, Integers, Real
from ..runtime.compile import compiled, inlined


@compiled
def _gradient_sum(image: Floats, tiny: Real) -> float:
    """Σ‖∇i‖ over the inner pixels of an image (H, W)."""
    height, width = image.shape
    total = np.zeros(width, image.dtype)  # a sum for each column, so that they are computed in vectors
    for y in range(1, height - 1):
        for x in range(1, width - 1):
            u, v = image[y, x + 1] - image[y, x - 1], image[y + 1, x] - image[y - 1, x]
            squared = u * u + v * v
            total[x] += squared - squared if squared < tiny else math.sqrt(squared)
    return float(total.astype(np.float64).sum())


@compiled
def _gradient_sum_vjp(image: Floats, tiny: Real, grad_output: Real, grad_image: Floats) -> None:
    """Adds ``grad_output`` times the derivative of :func:`_gradient_sum` to ``grad_image``."""
    height, width = image.shape
    along_x, along_y = np.empty(width, image.dtype), np.empty(width, image.dtype)
    for y in range(1, height - 1):
        for x in range(1, width - 1):
            u, v = image[y, x + 1] - image[y, x - 1], image[y + 1, x] - image[y - 1, x]
            squared = u * u + v * v
            nothing = squared < tiny
            share = grad_output / math.sqrt(tiny if nothing else squared)
            along_x[x] = u - u if nothing else share * u
            along_y[x] = v - v if nothing else share * v
        for x in range(1, width - 1):
            grad_image[y, x + 1] += along_x[x]
            grad_image[y + 1, x] += along_y[x]
            grad_image[y - 1, x] -= along_y[x]
        for x in range(1, width - 1):
            grad_image[y, x - 1] -= along_x[x]


@inlined
def _add_differences(
    first: Floats, second: Floats, squared: Real, sums: Floats, slope: Floats, of_first: Floats, of_second: Floats
) -> None:
    """A row of :func:`_differences`: d = second - first, both sums of columns (2, width), and the derivatives."""
    one = first.dtype.type(1)
    for x in range(len(first)):
        d = second[x] - first[x]
        root = math.sqrt(d * d + squared)
        reciprocal = one / root
        slope[x] = d * reciprocal
        sums[0, x] += root
        sums[1, x] += reciprocal
    for x in range(len(first)):
        of_first[x] -= slope[x]
    for x in range(len(first)):
        of_second[x] += slope[x]


@compiled
def _differences(image: Floats, rounding: Real, derivative: Floats) -> tuple[float, float]:
    """Σ√(d² + ρ²) and Σ1/√(d² + ρ²) over the differences d of neighbours; adds the first's to ``derivative``."""
    height, width = image.shape
    squared, slope, sums = rounding * rounding, np.empty(width, image.dtype), np.zeros((2, width), image.dtype)
    for y in range(height):
        row, of_row = image[y], derivative[y]
        _add_differences(row[:-1], row[1:], squared, sums, slope, of_row[:-1], of_row[1:])
        if y < height - 1:
            _add_differences(row, image[y + 1], squared, sums, slope, of_row, derivative[y + 1])
    return float(sums[0].astype(np.float64).sum()), float(sums[1].astype(np.float64).sum())


@compiled
def _smoothness(images: Floats, rounding: float, tiny: Real, out: Floats, slopes: Floats) -> None:
    """:func:`.priors.smoothness` of images (A, H, W) to ``out`` (A,), and its derivatives to ``slopes``, 0 before."""
    batch, height, width = images.shape
    kind, pixels = images.dtype.type, height * width
    for k in range(batch):
        visible = _gradient_sum(images[k], tiny) / pixels
        scale = visible if visible > 0 else 1.0
        roots, reciprocals = _differences(images[k], kind(rounding * scale), slopes[k])
        out[k] = roots / (pixels * scale)
        share = kind(1 / (pixels * scale))
        for y in range(height):
            for x in range(width):
                slopes[k, y, x] *= share
        if visible > 0:
            to_scale = rounding * rounding * reciprocals / pixels - roots / (pixels * scale * scale)
            _gradient_sum_vjp(images[k], tiny, kind(to_scale / pixels), slopes[k])


class _Smoothness(torch.autograd.Function):
    """Images (A, 1, H, W) to :func:`.priors.smoothness` (A,)."""

    @staticmethod
    def forward(ctx: Any, images: Tensor, rounding: float) -> Tensor:
        planes = images.detach().contiguous().numpy()[:, 0]
        ctx.slopes = np.zeros_like(planes)
        out = np.empty(len(planes), planes.dtype)
        _smoothness(planes, rounding, planes.dtype.type(vanishing(images.dtype)), out, ctx.slopes)
        return torch.from_numpy(out)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad_output: Tensor) -> tuple[Tensor, None]:
        return torch.from_numpy(ctx.slopes).unsqueeze(1) * grad_output.view(-1, 1, 1, 1), None


def smoothness(images: Tensor, rounding: float) -> Tensor:
    """:func:`.priors.smoothness` of images (A, 1, H, W) on a CPU, differentiable once, in reverse mode."""
    out: Tensor = _Smoothness.apply(images, rounding)  # type: ignore[no-untyped-call]
    return out


@compiled
def _level(images: Floats, index: Integers, runs: Integers, firsts: Integers, sizes: Floats, sums: Floats) -> None:
    """Sets each region of each image (pixels,) to its mean.  ``sums`` (regions,) is 0 before; see :func:`levelled`."""
    for a in range(len(images)):
        image, first, end = images[a], firsts[index[a]], firsts[index[a] + 1]
        for k in range(first, end):
            total = 0.0
            for x in range(runs[k, 0], runs[k, 1]):
                total += image[x]
            sums[runs[k, 2]] += total
        for k in range(first, end):
            region = runs[k, 2]
            image[runs[k, 0] : runs[k, 1]] = sums[region] / sizes[region]


def level(images: Tensor, index: Tensor, runs: Tensor, firsts: Tensor, sizes: Tensor) -> Tensor:
    """:func:`levelled` in place, of contiguous images that need no derivative."""
    sums = torch.zeros_like(sizes)
    _level(*(tensor.numpy() for tensor in (images.flatten(1), index, runs, firsts, sizes, sums)))
    return images


class _Levelled(torch.autograd.Function):
    """Images (A, 1, H, W) of the problems ``index`` (A,), with their regions at their means: its own adjoint."""

    @staticmethod
    def forward(images: Tensor, index: Tensor, runs: Tensor, firsts: Tensor, sizes: Tensor) -> Tensor:
        return level(images.detach().clone(memory_format=torch.contiguous_format), index, runs, firsts, sizes)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Tensor) -> None:
        ctx.of = inputs[1:]

    @staticmethod
    def backward(ctx: Any, grad_output: Tensor) -> tuple[Tensor, None, None, None, None]:
        return levelled(grad_output, *ctx.of), None, None, None, None

    @staticmethod
    def jvp(ctx: Any, tangent: Tensor, *_: None) -> Tensor:
        return levelled(tangent, *ctx.of)


def levelled(images: Tensor, index: Tensor, runs: Tensor, firsts: Tensor, sizes: Tensor) -> Tensor:
    """Images (A, 1, H, W) on a CPU with each region at its mean; linear, differentiable in either mode.

    Args:
        images: float32 or float64.
        index: (A,), the number of each image in the batch of B that has the regions.
        runs: (runs, 3), of pixels of one region in a row: the first, the one behind the last, the region, which is in
            one image only.  Those of an image follow each other.
        firsts: (B + 1,), of each image the first of its runs.
        sizes: (regions,), float64: their pixels.
    """
    out: Tensor = _Levelled.apply(images, index, runs, firsts, sizes)  # type: ignore[no-untyped-call]
    return out
