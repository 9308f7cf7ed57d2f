"""The operator's steps fused into native loops for CPUs: the same results up to rounding, and the same derivatives.

``docs/kernels.md`` explains them; ``tests/hog/kernels`` compares them with the reference steps.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ... import native
from ..autograd import Step, apply, cells_reference, describe_reference, norm_reference
from ..spec import HOGSpec
from ..steps import merge_colours, separate_colours, separate_colours_vjp, split_colours
from . import loops


def _nothing(x: Tensor) -> Tensor:
    return torch.empty(len(x), 0, device="cpu")


_CELLS = Step(
    lambda images, spec: (loops.cells(images, spec), _nothing(images)),
    lambda images, _, grad_output, spec: loops.cells_vjp(images, grad_output, spec),
    lambda images, _, tangent, spec: loops.cells_jvp(images, tangent, spec),
    cells_reference,
)
_NORM = Step(
    lambda cells, spec: (loops.norm(cells, spec), _nothing(cells)),
    lambda cells, _, grad_output, spec: loops.norm_vjp(cells, grad_output, spec),
    lambda cells, _, tangent, spec: loops.norm_jvp(cells, tangent, spec),
    norm_reference,
)
_DESCRIBE = Step(loops.describe, loops.describe_vjp, loops.describe_jvp, describe_reference)


def supports(spec: HOGSpec) -> bool:
    """Whether these loops have all that the dialect needs, except perhaps its normaliser."""
    smoothed_border = spec.mask == "sobel" and spec.border not in ("reflect", "ignore")
    return not smoothed_border and native.available()


@lru_cache(maxsize=64)
def _of_one_colour(spec: HOGSpec) -> HOGSpec:
    return spec.of_one_colour()


def describe(images: Tensor, spec: HOGSpec) -> Tensor:
    """Descriptors (B, rows, cols, channels) of images (B, C, H, W) on a CPU, if the normaliser has loops."""
    return merge_colours(apply(_DESCRIBE, separate_colours(images, spec), _of_one_colour(spec)), spec)


def histograms(images: Tensor, spec: HOGSpec) -> Tensor:
    """Cell histograms (B, colours · bins, rows, cols) of images (B, C, H, W)."""
    each = apply(_CELLS, separate_colours(images, spec), _of_one_colour(spec))
    return merge_colours(each, spec).permute(0, 3, 1, 2)


def cells(images: Tensor, spec: HOGSpec) -> Tensor:
    """:func:`histograms` as cells (B, rows, cols, colours · bins), in one piece."""
    return merge_colours(loops.cells(separate_colours(images, spec), _of_one_colour(spec)), spec).contiguous()


def cells_vjp(images: Tensor, grad_cells: Tensor, spec: HOGSpec) -> Tensor:
    """Gradients of images from those of :func:`cells`."""
    each, grad = separate_colours(images, spec), split_colours(grad_cells, spec)
    grad_images = loops.cells_vjp(each, grad, _of_one_colour(spec))
    return separate_colours_vjp(grad_images, images.shape[1], spec).contiguous()


def describe_vjp(images: Tensor, grad_output: Tensor, spec: HOGSpec) -> Tensor:
    """Gradients of images from those of :func:`describe`."""
    each, one = separate_colours(images, spec), _of_one_colour(spec)
    grad_cells = loops.norm_vjp(loops.cells(each, one), split_colours(grad_output, spec), one)
    return separate_colours_vjp(loops.cells_vjp(each, grad_cells, one), images.shape[1], spec).contiguous()


def histograms_jvp(images: Tensor, tangents: Tensor, spec: HOGSpec) -> Tensor:
    """Tangents of the cells (B, colours · bins, rows, cols) from those of the images (B, C, H, W)."""
    pixels, directions = (separate_colours(each.detach(), spec) for each in (images, tangents))
    return merge_colours(loops.cells_jvp(pixels, directions, _of_one_colour(spec)), spec).permute(0, 3, 1, 2)


def norm(of_cells: Tensor, spec: HOGSpec) -> Tensor:
    """The normaliser, if it has loops: histograms (B, colours · bins, rows, cols) to (B, channels, rows, cols)."""
    each = split_colours(of_cells.permute(0, 2, 3, 1), spec)
    return merge_colours(apply(_NORM, each, _of_one_colour(spec)), spec).permute(0, 3, 1, 2)


def add_energy(values: NDArray[Any], total: float) -> float:
    """``total``, of whole blocks of 256, plus the squares of numbers (n,), rounded as in the native normaliser."""
    if native.available():
        return loops.add_energy(values, total)
    return total + float(np.square(values, dtype=np.float64).sum())
