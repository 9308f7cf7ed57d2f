"""A photograph's object with the templates that renderings are compared with, and its visual elements (Section 3.2).

Discriminative visual elements are the patches of a descriptor that are least like other photographs.  As by Aubry et
al. ("Seeing 3D chairs", released code): every patch is whitened by the background, its norm says how discriminative it
is, and of overlapping patches the most discriminative is selected.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import torch
from torch import Tensor

from ..hog import HOGSpec, presets
from ..hog.box import pixel_box
from ..inputs.numbers import LONGEST_SIDE, as_integer, as_number, as_size, check_type
from ..inputs.tensors import check_shape, check_values
from .background import FINE_CELL, default_background, pose_spec
from .crop import ObjectCrop
from .options import SimilarityKind
from .similarity import (
    CalibratedTemplate,
    PatchTemplate,
    Template,
    calibrated_template,
    coarse_background,
    describe,
    patch_template,
)
from .whitening import Background

ELEMENT = (5, 5)  # rows, columns of cells of a visual element
ELEMENTS = 25  # of a photograph, at most
EMPTY = 0.01  # sum of a cell's entries up to which it counts as the plain background of a rendering
PATCH_EPSILON = 0.1  # ε of Eq. 7, in votes of images in 0…1: a hundredth of a typical patch's ‖v‖


@lru_cache(maxsize=4)
def patch_spec(cell_size: tuple[int, int]) -> HOGSpec:
    """φ of a patch: ∇HOG, Eq. 1-7, whose ε gives little weight to patches of a rendering that are nearly flat."""
    return presets.paper(cell_size, global_form="robust", epsilon=PATCH_EPSILON)


class PreparedPhotograph:
    """An object's crop with its templates; the coarse ones use a background, by default that of :func:`.pose_spec`."""

    def __init__(self, crop: ObjectCrop, background: Background | None = None) -> None:
        self.crop, self.own_background = crop, background
        self.background = background or default_background(pose_spec())

    def template(self, kind: SimilarityKind) -> Template:
        """The template for one of the similarities of :mod:`.similarity`."""
        template: Template = getattr(self, kind)
        return template

    @cached_property
    def patches(self) -> PatchTemplate:
        """The template of the visual elements' patches of pixels.

        Raises:
            ValueError: the crop has fewer cells than an element.
        """
        spec, (descriptor, elements) = self.background.spec, self.elements
        if not len(elements):
            got = "x".join(map(str, descriptor.shape[:2]))
            raise ValueError(f"visual elements have {ELEMENT[0]}x{ELEMENT[1]} cells, but the object only {got}")
        (height, width), (rows, cols) = self.crop.image.shape[2:], ELEMENT
        cells = [(col, row, col + cols, row + rows) for row, col in elements.positions.tolist()]
        regions = [pixel_box(spec, (height, width), window) for window in cells]
        return patch_template(self.crop.image, regions, patch_spec(spec.cell_size))

    @cached_property
    def elements(self) -> tuple[Tensor, Elements]:
        """The descriptor (rows, cols, C) of the crop, and the visual elements inside the object's box."""
        spec = self.background.spec
        descriptor = describe(self.crop.image, spec)[0].permute(1, 2, 0)
        low, high = zip(*map(_box_cells, self.crop.size[::-1], descriptor.shape[:2], spec.cell_size), strict=True)
        inside = descriptor[low[0] : high[0], low[1] : high[1]]
        chosen = elements(inside, self.background, threshold=0.0)
        return descriptor, dataclasses.replace(chosen, positions=chosen.positions + torch.tensor(low))

    @cached_property
    def calibrated(self) -> CalibratedTemplate:
        """The template of the whole crop; for the default descriptor the crop is shrunk first."""
        return calibrated_template(self.crop, *coarse_background(self.own_background))

    @cached_property
    def fine(self) -> CalibratedTemplate:
        """The calibrated template of smaller cells, for the last fraction of a degree."""
        finer = dataclasses.replace(self.background.spec, cell_size=(FINE_CELL, FINE_CELL))
        return calibrated_template(self.crop, default_background(finer))


def _box_cells(pixels: float, cells: int, cell: int) -> tuple[int, int]:
    """Range of the cells, in the middle of ``cells``, that the box's ``pixels`` reach into."""
    middle, half = cells / 2, max(pixels / cell, max(ELEMENT)) / 2
    return max(0, math.floor(middle - half)), min(cells, math.ceil(middle + half))


@dataclass(frozen=True, eq=False, repr=False)
class Elements:
    """Patches of r x c cells of one descriptor with C channels, the most discriminative first.

    Attributes:
        positions: (N, 2), int64: row and column of the upper left cell.
        patches: (N, r, c, C), q.
        weights: (N, r, c, C), w = Σ⁻¹(q − μ), 0 in empty cells: wᵀx is how much x looks like the element.
        discriminability: (N,), ‖Σ^-½(q − μ)‖.
    """

    positions: Tensor
    patches: Tensor
    weights: Tensor
    discriminability: Tensor

    def __len__(self) -> int:
        return len(self.positions)

    def __repr__(self) -> str:
        """Number and size, not the patches."""
        rows, cols, channels = self.patches.shape[1:]
        return f"<Elements: {len(self)} of {rows}x{cols} cells with {channels} channels>"


def all_patches(descriptor: Tensor, size: tuple[int, int]) -> Tensor:
    """Every patch of a descriptor (rows, cols, C): (rows − r + 1, cols − c + 1, r, c, C), a view."""
    return descriptor.unfold(0, size[0], 1).unfold(1, size[1], 1).permute(0, 1, 3, 4, 2)


@torch.no_grad()
def elements(
    descriptor: Tensor,
    background: Background,
    size: tuple[int, int] = ELEMENT,
    *,
    count: int | None = ELEMENTS,
    overlap: float = 0.25,
    threshold: float = 2.0,
) -> Elements:
    """The discriminative elements of one descriptor.

    Args:
        descriptor: (rows, cols, C), float32 or float64, of the background's dialect.
        background: statistics of other photographs.
        size: rows and columns of an element, in cells.
        count: the most to return; None for no limit.
        overlap: the most that two elements share: the area of their intersection over that of the smallest box around
            both.
        threshold: the least discriminability, in that of an empty patch, √(μᵀΣ⁻¹μ).

    Returns:
        At most ``count``; none of an empty descriptor, or of one smaller than ``size``.

    Raises:
        TypeError: the descriptor is no dense tensor, or the background is none.
        ValueError: the descriptor is of another shape or type, an option is out of range, or the background knows no
            templates of this size.

    >>> spec = nablahog.presets.aubry(cell_size=8)
    >>> background = nablahog.pose.learn_background({"a": torch.rand(128, 128)}, spec, order=4)
    >>> image = torch.zeros(1, 1, 96, 96)
    >>> image[..., 30:70, 40:60] = 1.0  # a white box
    >>> result = nablahog.pose.elements(nablahog.hog(image, spec)[0], background, (5, 5), count=3)
    >>> len(result) <= 3
    True
    """
    check_type("background", background, Background, "nablahog.pose.default_background(spec)")
    check_shape("the descriptor", descriptor, ("rows", "cols", background.spec.channels))
    check_values("the descriptor", descriptor)
    size = as_size("size", size, "rows, cols")
    count = None if count is None else as_integer("count", count, 1, LONGEST_SIDE)
    overlap, threshold = as_number("overlap", overlap, 0, 1), as_number("threshold", threshold, 0)
    background.factor(*size)  # raises for sizes it does not know
    across = max(0, descriptor.shape[1] - size[1] + 1)
    if across and descriptor.shape[0] >= size[0]:
        flat = all_patches(descriptor, size).flatten(0, 1)
    else:
        flat = descriptor.new_zeros(0, *size, descriptor.shape[2])
    order, discriminability = most_discriminative(flat, background, threshold)
    positions = torch.stack([order // across, order % across], dim=1)
    corners = torch.cat([positions, positions + torch.tensor(size, device=order.device)], dim=1)
    selected = suppress_overlaps(corners, count, overlap)
    chosen = order[selected]
    best = flat[chosen]
    return Elements(positions[selected], best, element_weights(best, background), discriminability[chosen])


def most_discriminative(patches: Tensor, background: Background, threshold: float) -> tuple[Tensor, Tensor]:
    """Indices of the patches (N, r, c, C) above a threshold, the best first, and the discriminability of all, (N,)."""
    discriminability = background.discriminability(patches)
    least = threshold * background.discriminability(patches.new_zeros(1, *patches.shape[1:]))
    order = torch.argsort(discriminability, descending=True, stable=True)
    return order[discriminability[order] > least], discriminability


def element_weights(patches: Tensor, background: Background) -> Tensor:
    """w of :class:`Elements` for patches (N, r, c, C)."""
    return background.whiten(patches) * (patches.abs().sum(dim=3, keepdim=True) > EMPTY)


def suppress_overlaps(corners: Tensor, count: int | None, overlap: float) -> Tensor:
    """Non-maximum suppression: indices (K,) of the boxes that overlap with no better one that is kept.

    Args:
        corners: (N, 4), in order of preference: the low corner and the high one, both x, y or both row, column.
        count: the most to keep; None for no limit.
        overlap: the largest share allowed of the intersection in the smallest box around both.
    """
    chosen: list[Tensor] = []
    left = torch.arange(len(corners), device=corners.device)
    while len(left) and (count is None or len(chosen) < count):
        best, rest = left[0], left[1:]
        chosen.append(best)
        low, high = corners[rest, :2], corners[rest, 2:]
        shared = (torch.minimum(high, corners[best, 2:]) - torch.maximum(low, corners[best, :2])).clamp(min=0).prod(1)
        around = (torch.maximum(high, corners[best, 2:]) - torch.minimum(low, corners[best, :2])).prod(1)
        left = rest[shared <= overlap * around]
    return torch.stack(chosen) if chosen else left
