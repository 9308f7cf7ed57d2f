"""The operator's steps fused into native loops for CPUs: the same results up to rounding, and the same derivatives.

``docs/kernels.md`` explains them; ``tests/hog/kernels`` compares them with the reference steps.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.autograd import forward_ad

from ... import native
from ...runtime.forward_mode import load_forward_mode
from .. import triton as gpu
from ..colours import merge_colours, separate_colours, split_colours
from ..orientation import vote_rule
from ..spec import HOGSpec
from ..steps import histograms_reference, normalize_reference, spread_nan
from . import autograd, loops, operators
from .plan import VOTES, has_norm

Step: TypeAlias = Callable[[Tensor, HOGSpec], Tensor]


def supports(spec: HOGSpec) -> bool:
    """Whether these loops have all that the dialect needs but, perhaps, its normaliser."""
    smoothed_border = spec.mask == "sobel" and spec.border not in ("reflect", "ignore")
    return not smoothed_border and vote_rule(spec).name in VOTES and native.available()


@lru_cache(maxsize=64)
def _of_one_colour(spec: HOGSpec) -> HOGSpec:
    return spec.of_one_colour()


def describe(images: Tensor, spec: HOGSpec) -> Tensor:
    """Descriptors (B, rows, cols, channels) of images (B, C, H, W) on a CPU, in a dialect that these loops support."""
    if not has_norm(spec):
        descriptor = spread_nan(normalize_reference(histograms(images, spec), spec), images)
        return descriptor.permute(0, 2, 3, 1).contiguous()
    if autograd.in_graph(images):
        spec.grid(*images.shape[2:])
        descriptors: Tensor = operators.describe(images, spec.to_json())
        return descriptors
    each = autograd.apply(autograd.DESCRIBE, separate_colours(images, spec), _of_one_colour(spec))
    return merge_colours(each, spec)


def histograms(images: Tensor, spec: HOGSpec) -> Tensor:
    """Cell histograms (B, colours · bins, rows, cols) of images (B, C, H, W)."""
    if autograd.in_graph(images):
        spec.grid(*images.shape[2:])
        cells: Tensor = operators.cells(images, spec.to_json())
    else:
        each = autograd.apply(autograd.CELLS, separate_colours(images, spec), _of_one_colour(spec))
        cells = merge_colours(each, spec)
    return cells.permute(0, 3, 1, 2)


def histograms_jvp(images: Tensor, tangents: Tensor, spec: HOGSpec) -> Tensor:
    """Tangents of the cells (B, colours · bins, rows, cols) from those of the images (B, C, H, W): the step's own jvp.

    PyTorch's forward mode, which serves other devices, takes twice the time for small images.
    """
    if gpu.chosen(images.device, spec):
        from ..triton import steps as on_gpu

        return on_gpu.histograms_jvp(images, tangents, spec)
    if images.is_cpu and supports(spec):
        pixels, directions = (separate_colours(each.detach(), spec) for each in (images, tangents))
        return merge_colours(loops.cells_jvp(pixels, directions, _of_one_colour(spec)), spec).permute(0, 3, 1, 2)
    load_forward_mode()
    with forward_ad.dual_level():
        dual = forward_ad.make_dual(images.detach(), tangents)  # type: ignore[no-untyped-call]
        return forward_ad.unpack_dual(histograms_reference(dual, spec)).tangent  # type: ignore[no-any-return, no-untyped-call]


def _norm(of_cells: Tensor, spec: HOGSpec) -> Tensor:
    """The normaliser: cell histograms (B, colours · bins, rows, cols) to (B, channels, rows, cols)."""
    if autograd.in_graph(of_cells) or not has_norm(spec):
        return normalize_reference(of_cells, spec)
    each = split_colours(of_cells.permute(0, 2, 3, 1), spec)
    return merge_colours(autograd.apply(autograd.NORM, each, _of_one_colour(spec)), spec).permute(0, 3, 1, 2)


def energy(values: NDArray[Any]) -> float:
    """The sum of squares of numbers (n,), float32 or float64, rounded as in the native global normaliser."""
    return loops.energy(values) if native.available() else float(np.square(values, dtype=np.float64).sum())


def steps(device: torch.device, spec: HOGSpec) -> tuple[Step, Step]:
    """The fastest ``histograms`` of images on the device, and ``normalize``, of the dialect."""
    if device.type == "cpu" and supports(spec):
        return histograms, _norm
    if gpu.chosen(device, spec):
        from ..triton import steps as on_gpu

        return on_gpu.histograms, on_gpu.norm
    return histograms_reference, normalize_reference
