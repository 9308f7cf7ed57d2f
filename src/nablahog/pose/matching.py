"""A photograph and a model brought together: what a similarity needs, prepared once and kept."""

from __future__ import annotations

import dataclasses
import math
from functools import cached_property, lru_cache

import torch
from torch import Tensor

from ..hog import HOGSpec, presets
from ..render import Camera, Mesh, Renderer
from ..render.renderer import Method
from ..render.simplify import simplify
from .background import default_background
from .canvas import DISTANCE, Canvas, smaller
from .choices import Kind
from .elements import Elements, elements
from .filter import Whitener
from .placing import hull
from .similarity import Similarity, Template, by_elements, calibrated, describe
from .whitening import Background

ELEMENT = (5, 5)  # cells of a visual element
ELEMENTS = 25  # the most of a photograph
DETAIL = 1.0  # pixel that vertices may be off in searches: a third of the faces remain, and poses come out as well
_COARSE, _FINE = 8, 4  # pixels of a cell: half of them tell poses apart that are half as far from each other
_SMALLER = 2  # times: to look around, half the pixels along a side, with as many cells, find as many poses
_REGULARIZATION = {_COARSE: 0.003, _FINE: 0.03}


@lru_cache(maxsize=4)
def pose_spec(cell_size: int = _COARSE) -> HOGSpec:
    """The descriptor of poses by default: Aubry et al.'s nine contrast-insensitive channels, of gray images."""
    return presets.aubry(cell_size, colour="gray")


class Photograph:
    """An object's canvas with its templates.

    Args:
        canvas: the object.
        background: of the coarse templates; None for the default one of :func:`pose_spec`.
    """

    def __init__(self, canvas: Canvas, background: Background | None = None) -> None:
        self.canvas, self._given = canvas, background
        self.background = background or default_background(pose_spec())

    def template(self, kind: Kind) -> Template:
        """What to compare renderings with, by one of the similarities of :mod:`.similarity`."""
        if kind == "calibrated":
            return self.calibrated
        descriptor, found = self.elements
        patches = found.patches if kind == "dot" else found.weights
        return by_elements(found, patches, self.background.spec, *descriptor.shape[:2])

    @cached_property
    def elements(self) -> tuple[Tensor, Elements]:
        """The descriptor (rows, cols, C) of the canvas, and the visual elements inside the object's box."""
        spec = self.background.spec
        descriptor = describe(self.canvas.image, spec)[0].permute(1, 2, 0)
        low, high = zip(*map(self._cells, self.canvas.size[::-1], descriptor.shape[:2], spec.cell_size), strict=True)
        inside = descriptor[low[0] : high[0], low[1] : high[1]]
        found = elements(inside, self.background, ELEMENT, count=ELEMENTS, threshold=0.0)
        return descriptor, dataclasses.replace(found, positions=found.positions + torch.tensor(low))

    @staticmethod
    def _cells(pixels: float, cells: int, cell: int) -> tuple[int, int]:
        """The cells in the middle of ``cells`` that the box's ``pixels`` reach into, but no fewer than an element's."""
        middle, half = cells / 2, max(pixels / cell, max(ELEMENT)) / 2
        return max(0, math.floor(middle - half)), min(cells, math.ceil(middle + half))

    @cached_property
    def calibrated(self) -> Template:
        """The template of the canvas as a whole; where no background says which descriptor it is of, a quarter of the
        pixels do for it."""
        if self._given is not None:
            return _calibrated(self.canvas, self._given)
        return _calibrated(self.canvas, default_background(pose_spec(_COARSE // _SMALLER)), _SMALLER)

    @cached_property
    def fine(self) -> Template:
        """The calibrated template of smaller cells, for the last fraction of a degree."""
        return _calibrated(self.canvas, default_background(_finer(self.background.spec)))


@lru_cache(maxsize=4)
def _finer(spec: HOGSpec) -> HOGSpec:
    return dataclasses.replace(spec, cell_size=(_FINE, _FINE))


def _calibrated(canvas: Canvas, background: Background, shrink: int = 1) -> Template:
    spec, small = background.spec, canvas.smaller(shrink) if shrink > 1 else canvas
    rows, cols = spec.grid(*small.image.shape[2:])
    return calibrated(small, spec, _whitener(background, rows, cols), shrink)


@lru_cache(maxsize=16)
def _whitener(background: Background, rows: int, cols: int) -> Whitener:
    return Whitener(background, rows, cols, _REGULARIZATION.get(background.spec.cell_size[0]))


class Model:
    """A mesh with its renderings for one camera.

    Args:
        mesh: normalised.
        camera: of the canvas.
    """

    def __init__(self, mesh: Mesh, camera: Camera) -> None:
        self.mesh, self.camera, self.hull = mesh, camera, hull(mesh)
        self._renderers: dict[tuple[Method, int, float, int], Renderer] = {}

    def renderer(
        self, method: Method = "edges", supersampling: int = 1, *, detail: float = 0.0, shrink: int = 1
    ) -> Renderer:
        """Of images ``shrink`` times smaller than the canvas.

        Args:
            supersampling: samples of a pixel along a side.
            detail: pixels that the vertices of the mesh may be off, seen from :data:`.canvas.DISTANCE`, so that there
                are fewer faces to draw.
        """
        key = method, supersampling, detail, shrink
        if key not in self._renderers:
            camera = smaller(self.camera, shrink)
            mesh = simplify(self.mesh, detail * DISTANCE / camera.focal) if detail > 0 else self.mesh
            self._renderers[key] = Renderer(mesh, camera, method=method, supersampling=supersampling)
        return self._renderers[key]

    def similarity(
        self, template: Template, method: Method = "edges", supersampling: int = 1, *, detail: float = 0.0
    ) -> Similarity:
        """Of renderings to a template; see :meth:`renderer`."""
        return Similarity(self.renderer(method, supersampling, detail=detail, shrink=template.shrink), template)


@lru_cache(maxsize=256)
def model_of(mesh: Mesh, camera: Camera) -> Model:
    """The prepared model of a mesh; all canvases have one camera, so it is prepared once."""
    return Model(mesh, camera)
