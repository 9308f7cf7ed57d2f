"""The default prior with its derivative in one pass over an image, compiled for CPUs."""

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
    row = np.empty(width, image.dtype)
    total = 0.0
    for y in range(1, height - 1):
        for x in range(1, width - 1):
            u, v = image[y, x + 1] - image[y, x - 1], image[y + 1, x] - image[y - 1, x]
            squared = u * u + v * v
            row[x] = squared - squared if squared < tiny else math.sqrt(squared)
        for x in range(1, width - 1):
            total += row[x]
    return total


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
    squared = rounding * rounding
    root, slope = np.empty(width, image.dtype), np.empty(width, image.dtype)
    roots = reciprocals = 0.0
    for y in range(height):
        for x in range(width - 1):
            d = image[y, x + 1] - image[y, x]
            root[x] = math.sqrt(d * d + squared)
            slope[x] = d / root[x]
        for x in range(width - 1):
            found[y, x] -= slope[x]
        for x in range(width - 1):
            found[y, x + 1] += slope[x]
        for x in range(width - 1):
            roots += root[x]
            reciprocals += 1 / root[x]
        if y < height - 1:
            for x in range(width):
                d = image[y + 1, x] - image[y, x]
                root[x] = math.sqrt(d * d + squared)
                slope[x] = d / root[x]
                found[y, x] -= slope[x]
                found[y + 1, x] += slope[x]
            for x in range(width):
                roots += root[x]
                reciprocals += 1 / root[x]
    return roots, reciprocals


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
