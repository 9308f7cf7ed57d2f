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
from ..colours import merge_colours, separate_colours, split_colours
from ..orientation import vote_rule
from ..spec import HOGSpec
from . import loops
from .plan import VOTES, has_norm

__all__ = ["describe", "energy", "has_norm", "histograms", "histograms_jvp", "norm", "supports"]


def _nothing(x: Tensor) -> Tensor:
    return torch.empty(len(x), 0)


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
    """Whether these loops have all that the dialect needs but, perhaps, its normaliser: see :func:`.has_norm`."""
    smoothed_border = spec.mask == "sobel" and spec.border not in ("reflect", "ignore")
    return not smoothed_border and vote_rule(spec).name in VOTES and native.available()


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


def histograms_jvp(images: Tensor, tangents: Tensor, spec: HOGSpec) -> Tensor:
    """Tangents of the cells (B, colours · bins, rows, cols) from those of the images (B, C, H, W)."""
    pixels, directions = (separate_colours(each.detach(), spec) for each in (images, tangents))
    return merge_colours(loops.cells_jvp(pixels, directions, _of_one_colour(spec)), spec).permute(0, 3, 1, 2)


def norm(of_cells: Tensor, spec: HOGSpec) -> Tensor:
    """The normaliser, if it has loops: histograms (B, colours · bins, rows, cols) to (B, channels, rows, cols)."""
    each = split_colours(of_cells.permute(0, 2, 3, 1), spec)
    return merge_colours(apply(_NORM, each, _of_one_colour(spec)), spec).permute(0, 3, 1, 2)


def energy(values: NDArray[Any]) -> float:
    """The sum of squares of numbers (n,), float32 or float64, rounded as in the native global normaliser."""
    return loops.energy(values) if native.available() else float(np.square(values, dtype=np.float64).sum())
