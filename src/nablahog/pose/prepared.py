"""A photograph and models prepared for comparison, made once and reused."""

from __future__ import annotations

import dataclasses
import hashlib
import math
from collections.abc import Sequence
from functools import cached_property, lru_cache

import torch
from torch import Tensor

from ..hog import HOGSpec, presets
from ..hog.coordinates import pixel_box
from ..render import Camera, Mesh, Renderer
from ..render.renderer import Method
from ..render.simplify import simplify
from .background import default_background
from .crop import DISTANCE, ObjectCrop, crop_object, downsampled
from .elements import Elements, elements
from .options import SimilarityKind
from .patches import PatchTemplate, patch_template
from .placement import hull
from .similarity import ElementTemplate, Similarity, Template, calibrated_template, describe, whitened_template
from .whitener import Whitener
from .whitening import Background

ELEMENT = (5, 5)  # rows, columns of cells of a visual element
ELEMENTS = 25  # of a photograph, at most
PATCH_EPSILON = 0.1  # ε of Eq. 7, in votes of images in 0…1: a hundredth of a typical patch's ‖v‖
DETAIL = 1.0  # pixel that vertices may be off in searches: a third of the faces remain, and poses come out as well
_COARSE, _FINE = 8, 4  # pixels of a cell: half of them tell poses apart that are half as far from each other
_SHRINK = 2  # of the crop in the coarse search: with as many cells it finds as many poses, and takes less time
_REGULARIZATION = {_COARSE: 0.003, _FINE: 0.03}


@lru_cache(maxsize=4)
def pose_spec(cell_size: int = _COARSE) -> HOGSpec:
    """The descriptor of poses by default: Aubry et al.'s nine contrast-insensitive channels, of gray images."""
    return presets.aubry(cell_size, colour="gray")


@lru_cache(maxsize=4)
def patch_spec(cell_size: tuple[int, int]) -> HOGSpec:
    """φ of a patch: ∇HOG, Eq. 1-7, whose ε lets patches of a rendering that are nearly flat count for little."""
    return presets.paper(cell_size, global_form="robust", epsilon=PATCH_EPSILON)


def coarse_background(own: Background | None) -> tuple[Background, int]:
    """The background of the coarse search, and the factor by which the crop is made smaller there.

    Args:
        own: the one that was asked for; None for the default one.
    """
    return (own, 1) if own is not None else (default_background(pose_spec(_COARSE // _SHRINK)), _SHRINK)


class PreparedPhotograph:
    """An object's crop with its templates.

    Args:
        crop: the object.
        background: of the coarse templates; None for the default one of :func:`pose_spec`.
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

    @property
    def whitened(self) -> ElementTemplate:
        """The template of the whitened visual elements."""
        descriptor, elements = self.elements
        return whitened_template(elements, self.background.spec, *descriptor.shape[:2])

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
    def calibrated(self) -> ElementTemplate:
        """The template of the whole crop; for the default descriptor the crop is shrunk before."""
        return _calibrated(self.crop, *coarse_background(self.own_background))

    @cached_property
    def fine(self) -> ElementTemplate:
        """The calibrated template of smaller cells, for the last fraction of a degree."""
        finer = dataclasses.replace(self.background.spec, cell_size=(_FINE, _FINE))
        return _calibrated(self.crop, default_background(finer))


def _box_cells(pixels: float, cells: int, cell: int) -> tuple[int, int]:
    """First and last of the cells, in the middle of ``cells``, that the box's ``pixels`` reach into.

    They are at least as many as an element has.
    """
    middle, half = cells / 2, max(pixels / cell, max(ELEMENT)) / 2
    return max(0, math.floor(middle - half)), min(cells, math.ceil(middle + half))


def _calibrated(crop: ObjectCrop, background: Background, shrink: int = 1) -> ElementTemplate:
    spec, small = background.spec, crop.downsampled(shrink) if shrink > 1 else crop
    rows, cols = spec.grid(*small.image.shape[2:])
    return calibrated_template(small, spec, whitener_of(background, rows, cols), shrink)


@lru_cache(maxsize=64)
def whitener_of(background: Background, rows: int, cols: int) -> Whitener:
    """The whitener of descriptors of a size, made once."""
    return Whitener(background, rows, cols, _REGULARIZATION.get(background.spec.cell_size[0]))


class PreparedModel:
    """A mesh with its renderers for one camera.

    Args:
        mesh: normalised.
        camera: of the crop.
    """

    def __init__(self, mesh: Mesh, camera: Camera) -> None:
        self.mesh, self.camera, self.hull = mesh, camera, hull(mesh)
        self._renderers: dict[tuple[Method, int, float, int], Renderer] = {}

    @cached_property
    def digest(self) -> str:
        """A hash of what renderings depend on: the mesh and the camera."""
        parts = (self.mesh.vertices, self.mesh.faces, self.mesh.brightness)
        hashed = hashlib.sha256(repr((self.camera, [part.shape for part in parts])).encode())
        for part in parts:
            hashed.update(part.detach().numpy().tobytes())
        return hashed.hexdigest()

    def renderer(
        self,
        method: Method = "edges",
        supersampling: int = 1,
        *,
        detail: float = 0.0,
        shrink: int = 1,
        camera: Camera | None = None,
    ) -> Renderer:
        """The renderer of images ``shrink`` times smaller than the crop.

        Args:
            method: of derivatives.
            supersampling: samples of a pixel along a side.
            detail: pixels that the vertices of the mesh may be off, seen from :data:`.crop.DISTANCE`, so that there
                are fewer faces to draw.
            shrink: factor.
            camera: of the crop, if it has another focal length than :attr:`camera`.
        """
        key = method, supersampling, detail, shrink
        if key not in self._renderers:
            own = downsampled(self.camera, shrink)
            mesh = simplify(self.mesh, detail * DISTANCE / own.focal) if detail > 0 else self.mesh
            self._renderers[key] = Renderer(mesh, own, method=method, supersampling=supersampling)
        renderer = self._renderers[key]
        return renderer if camera is None else renderer.with_camera(downsampled(camera, shrink))

    def similarity(
        self,
        template: Template,
        method: Method = "edges",
        supersampling: int = 1,
        *,
        detail: float = 0.0,
        camera: Camera | None = None,
    ) -> Similarity:
        """The similarity of renderings to a template; see :meth:`renderer`."""
        renderer = self.renderer(method, supersampling, detail=detail, shrink=template.shrink, camera=camera)
        return Similarity(renderer, template)


@lru_cache(maxsize=256)
def prepared_model(mesh: Mesh, camera: Camera) -> PreparedModel:
    """The prepared model of a mesh, made once, since all crops have one camera."""
    return PreparedModel(mesh, camera)
