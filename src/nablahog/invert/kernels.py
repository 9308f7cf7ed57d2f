"""The default prior with its derivative, and constant regions, in one pass over an image; compiled for CPUs."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from ..compile import compiled
from ..hog.orientation import vanishing


@compiled
def _visible(image: Any, tiny: Any) -> float:
    """Σ‖∇i‖ over the inner pixels of an image (H, W)."""
    height, width = image.shape
    total = np.zeros(width, image.dtype)  # a sum for each column: several of them go at a time
    for y in range(1, height - 1):
        for x in range(1, width - 1):
            u, v = image[y, x + 1] - image[y, x - 1], image[y + 1, x] - image[y - 1, x]
            squared = u * u + v * v
            total[x] += squared - squared if squared < tiny else math.sqrt(squared)
    return float(total.astype(np.float64).sum())


@compiled
def _visible_adjoint(image: Any, tiny: Any, given: Any, found: Any) -> None:
    """Adds to ``found`` the derivative of ``given`` times :func:`_visible`."""
    height, width = image.shape
    along_x, along_y = np.empty(width, image.dtype), np.empty(width, image.dtype)
    for y in range(1, height - 1):
        for x in range(1, width - 1):
            u, v = image[y, x + 1] - image[y, x - 1], image[y + 1, x] - image[y - 1, x]
            squared = u * u + v * v
            nothing = squared < tiny
            share = given / math.sqrt(tiny if nothing else squared)
            along_x[x] = u - u if nothing else share * u
            along_y[x] = v - v if nothing else share * v
        for x in range(1, width - 1):
            found[y, x + 1] += along_x[x]
            found[y + 1, x] += along_y[x]
            found[y - 1, x] -= along_y[x]
        for x in range(1, width - 1):
            found[y, x - 1] -= along_x[x]


@compiled
def _differences(image: Any, rounding: Any, found: Any) -> tuple[float, float]:
    """Σ√(d² + ρ²) and Σ1/√(d² + ρ²) over the differences d of neighbours; the derivative of the first to ``found``."""
    height, width = image.shape
    squared, one = rounding * rounding, image.dtype.type(1)
    slope = np.empty(width, image.dtype)
    roots, reciprocals = np.zeros(width, image.dtype), np.zeros(width, image.dtype)
    for y in range(height):
        for x in range(width - 1):
            d = image[y, x + 1] - image[y, x]
            root = math.sqrt(d * d + squared)
            reciprocal = one / root
            slope[x] = d * reciprocal
            roots[x] += root
            reciprocals[x] += reciprocal
        for x in range(width - 1):
            found[y, x] -= slope[x]
        for x in range(width - 1):
            found[y, x + 1] += slope[x]
        if y < height - 1:
            for x in range(width):
                d = image[y + 1, x] - image[y, x]
                root = math.sqrt(d * d + squared)
                reciprocal = one / root
                slope[x] = d * reciprocal
                roots[x] += root
                reciprocals[x] += reciprocal
            for x in range(width):
                found[y, x] -= slope[x]
            for x in range(width):
                found[y + 1, x] += slope[x]
    return float(roots.astype(np.float64).sum()), float(reciprocals.astype(np.float64).sum())


class _Smoothness(torch.autograd.Function):
    """Images (A, 1, H, W) to :func:`.priors.smoothness` (A,)."""

    @staticmethod
    def forward(ctx: Any, images: Tensor, rounding: float) -> Tensor:
        planes = images.detach().contiguous().numpy()[:, 0]
        dtype, pixels = planes.dtype.type, planes[0].size
        tiny = dtype(vanishing(images.dtype))
        ctx.slopes = np.zeros_like(planes)
        found = np.empty(len(planes), dtype)
        for k, (plane, slope) in enumerate(zip(planes, ctx.slopes, strict=True)):
            visible = _visible(plane, tiny) / pixels
            scale = visible if visible > 0 else 1.0
            roots, reciprocals = _differences(plane, dtype(rounding * scale), slope)
            found[k] = roots / (pixels * scale)
            slope /= dtype(pixels * scale)
            if visible > 0:
                to_scale = rounding**2 * reciprocals / pixels - roots / (pixels * scale**2)
                _visible_adjoint(plane, tiny, dtype(to_scale / pixels), slope)
        return torch.from_numpy(found)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, given: Tensor) -> tuple[Tensor, None]:
        return torch.from_numpy(ctx.slopes).unsqueeze(1) * given.view(-1, 1, 1, 1), None


def smoothness(images: Tensor, rounding: float) -> Tensor:
    """:func:`.priors.smoothness` of images (A, 1, H, W) on a CPU, differentiable once, in reverse mode."""
    found: Tensor = _Smoothness.apply(images, rounding)  # type: ignore[no-untyped-call]
    return found


@compiled
def _level(image: Any, regions: Any, sizes: Any, sums: Any, found: Any) -> None:
    """An image (pixels,) to ``found``, each of its ``regions`` but 0 at its mean; leaves ``sums`` (regions,) at 0."""
    for i in range(image.size):
        if regions[i] > 0:
            sums[regions[i]] += image[i]
    for i in range(image.size):
        region = regions[i]
        found[i] = sums[region] / sizes[region] if region > 0 else image[i]
    for i in range(image.size):
        sums[regions[i]] = 0


class _Levelled(torch.autograd.Function):
    """Images (A, 1, H, W) of the problems ``index`` (A,), with their regions at their means: its own adjoint."""

    @staticmethod
    def forward(images: Tensor, index: Tensor, regions: Tensor, sizes: Tensor) -> Tensor:
        pixels, labels, areas = images.detach().contiguous().numpy(), regions.numpy(), sizes.numpy()
        found, sums = np.empty_like(pixels), np.zeros(len(areas))
        for plane, problem, to in zip(pixels, index.numpy(), found, strict=True):
            _level(plane.reshape(-1), labels[problem].reshape(-1), areas, sums, to.reshape(-1))
        return torch.from_numpy(found)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Tensor) -> None:
        ctx.of = inputs[1:]

    @staticmethod
    def backward(ctx: Any, given: Tensor) -> tuple[Tensor, None, None, None]:
        return levelled(given, *ctx.of), None, None, None

    @staticmethod
    def jvp(ctx: Any, tangent: Tensor, *_: None) -> Tensor:
        return levelled(tangent, *ctx.of)


def levelled(images: Tensor, index: Tensor, regions: Tensor, sizes: Tensor) -> Tensor:
    """Images (A, 1, H, W) on a CPU with each region at its mean; linear, differentiable in either mode.

    Args:
        images: float32 or float64.
        index: (A,), which of the ``regions`` are each image's.
        regions: (B, H, W), int32: the number of each pixel's region, each in one image only; 0 is none.
        sizes: (regions,), float64: their pixels.
    """
    found: Tensor = _Levelled.apply(images, index, regions, sizes)  # type: ignore[no-untyped-call]
    return found
