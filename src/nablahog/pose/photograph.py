"""A photograph's object with the templates that renderings are compared with, each made once."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from functools import cached_property, lru_cache

import torch
from torch import Tensor

from ..hog import HOGSpec, presets
from ..hog.box import pixel_box
from .background import FINE, coarse_background, default_background, pose_spec
from .crop import ObjectCrop, crop_object
from .elements import Elements, elements
from .options import SimilarityKind
from .similarity import CalibratedTemplate, PatchTemplate, Template, calibrated_template, describe, patch_template
from .whitening import Background, whitener_of

ELEMENT = (5, 5)  # rows, columns of cells of a visual element
ELEMENTS = 25  # of a photograph, at most
PATCH_EPSILON = 0.1  # ε of Eq. 7, in votes of images in 0…1: a hundredth of a typical patch's ‖v‖


@lru_cache(maxsize=4)
def patch_spec(cell_size: tuple[int, int]) -> HOGSpec:
    """φ of a patch: ∇HOG, Eq. 1-7, whose ε gives little weight to patches of a rendering that are nearly flat."""
    return presets.paper(cell_size, global_form="robust", epsilon=PATCH_EPSILON)


class PreparedPhotograph:
    """An object's crop with its templates.

    Args:
        crop: the object.
        background: of the coarse templates; None for the default one of :func:`.background.pose_spec`.
    """

    def __init__(self, crop: ObjectCrop, background: Background | None = None) -> None:
        self.crop, self.own_background = crop, background
        self.background = background or default_background(pose_spec())

    def around(self, image: Tensor, box: Sequence[float]) -> PreparedPhotograph:
        """The crop of the same photograph (C, H, W) around another box, by the same camera."""
        crop = crop_object(image, box, focal=self.crop.focal, axis=self.crop.axis)
        return PreparedPhotograph(crop, self.own_background)

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
        chosen = elements(inside, self.background, ELEMENT, count=ELEMENTS, threshold=0.0)
        return descriptor, dataclasses.replace(chosen, positions=chosen.positions + torch.tensor(low))

    @cached_property
    def calibrated(self) -> CalibratedTemplate:
        """The template of the whole crop; for the default descriptor the crop is shrunk before."""
        return _calibrated(self.crop, *coarse_background(self.own_background))

    @cached_property
    def fine(self) -> CalibratedTemplate:
        """The calibrated template of smaller cells, for the last fraction of a degree."""
        finer = dataclasses.replace(self.background.spec, cell_size=(FINE, FINE))
        return _calibrated(self.crop, default_background(finer))


def _box_cells(pixels: float, cells: int, cell: int) -> tuple[int, int]:
    """First and end of the cells in the middle of ``cells`` that the box's ``pixels`` reach into.

    There are at least as many as an element has.
    """
    middle, half = cells / 2, max(pixels / cell, max(ELEMENT)) / 2
    return max(0, math.floor(middle - half)), min(cells, math.ceil(middle + half))


def _calibrated(crop: ObjectCrop, background: Background, shrink: int = 1) -> CalibratedTemplate:
    spec, small = background.spec, crop.downsampled(shrink) if shrink > 1 else crop
    rows, cols = spec.grid(*small.image.shape[2:])
    return calibrated_template(small, spec, whitener_of(background, rows, cols), shrink)
