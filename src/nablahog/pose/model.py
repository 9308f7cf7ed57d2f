"""A model prepared for comparison: its renderers, and its views all around, made once for all photographs.

Views are also cached on disk (:mod:`nablahog.io.array_cache`) for later processes.
"""

from __future__ import annotations

import hashlib
from functools import cache, cached_property, lru_cache

import torch
from torch import Tensor

from ..hog import HOGSpec
from ..io.array_cache import cached_array
from ..render import Camera, Mesh, Renderer
from ..render.renderer import Method
from ..render.surface import simplify
from ..runtime.source import code_key
from .background import coarse_background
from .crop import DISTANCE, FILL, SIDE, downsampled
from .fit_box import VIEW_COUNT, equidistant_azimuths, fit_to_box, hull, level_poses
from .similarity import Similarity, Template, describe, deviations, downsampled_poses, in_batches, white_background
from .whitening import Background, Whitener, whitener_of

DETAIL = 1.0  # pixel that vertices may be off in searches: a third of the faces remain, and poses are as exact
ELEVATION_STEP = 5.0  # degrees between the elevations that there are views of
ALIKE = 0.9
"""Correlation above which no photograph tells two views apart."""
_CACHED = 2048  # sets of views, of half a megabyte: those of 256 models


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
            detail: pixels that the vertices of the mesh may be off, seen from :data:`.crop.DISTANCE`; with fewer faces
                it renders faster.
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


def coarse_whitener(own: Background | None = None) -> Whitener:
    """The whitener of crops in the coarse search, see :func:`.background.coarse_background`."""
    background, shrink = coarse_background(own)
    return whitener_of(background, *background.spec.grid(SIDE // shrink, SIDE // shrink))


def view_descriptors(model: PreparedModel, elevation: float, own: Background | None = None) -> Tensor:
    """Descriptors of views all around, each divided by the standard deviation of its score over photographs.

    The model fills the crop, so that views do not depend on the photograph.

    Args:
        model: seen from equidistant azimuths.
        elevation: of the views, rounded to a multiple of :data:`ELEVATION_STEP`, degrees.
        own: the background of the descriptor; None for the default one.

    Returns:
        (VIEW_COUNT, C, rows, cols), float32.
    """
    (background, shrink), whitener = coarse_background(own), coarse_whitener(own)
    rounded = ELEVATION_STEP * round(elevation / ELEVATION_STEP)
    views = _view_descriptors(model, background.spec, whitener, shrink, rounded)
    return views.reshape(VIEW_COUNT, -1, whitener.rows, whitener.cols)


@lru_cache(maxsize=_CACHED)
def _view_descriptors(model: PreparedModel, spec: HOGSpec, whitener: Whitener, shrink: int, elevation: float) -> Tensor:
    numbers = spec.channels * whitener.rows * whitener.cols
    facts = (model.digest, spec.to_json(), whitener.digest, shrink, elevation, _code(), torch.__version__)
    key = hashlib.sha256(repr(facts).encode()).hexdigest()
    made = cached_array(
        "views", key, (VIEW_COUNT, numbers), lambda: _described(model, spec, whitener, shrink, elevation).numpy()
    )
    return torch.from_numpy(made)


@cache
def _code() -> str:
    return code_key(_described)


def _described(model: PreparedModel, spec: HOGSpec, whitener: Whitener, shrink: int, elevation: float) -> Tensor:
    """What :func:`view_descriptors` returns, rendered."""
    poses = fit_to_box(level_poses(equidistant_azimuths(VIEW_COUNT), elevation), model.hull, model.camera, FILL)
    renderer = model.renderer(detail=DETAIL, shrink=shrink)
    background = white_background(renderer.camera)

    def describe_views(some: Tensor) -> Tensor:
        descriptors = describe(renderer.render(some, background, derivative=False).image[:, None], spec)
        return descriptors.flatten(1) / deviations(whitener.energies(descriptors))[:, None]

    return torch.cat(in_batches(describe_views, downsampled_poses(poses, shrink)))


def equivalent_azimuths(model: PreparedModel, azimuth: float, elevation: float) -> tuple[float, ...]:
    """Azimuths in 0…360 from which the model looks as it does from ``azimuth``, without ``azimuth`` itself.

    A bottle looks the same from everywhere, a table from behind.

    Args:
        model: whose views are compared.
        azimuth, elevation: of one, degrees.

    Returns:
        Multiples of 360 / :data:`.fit_box.VIEW_COUNT` degrees from ``azimuth`` on; all of them for a solid of
        revolution.
    """
    alike = view_correlations(model, ELEVATION_STEP * round(elevation / ELEVATION_STEP))
    nearest = round(azimuth / 360 * VIEW_COUNT) % VIEW_COUNT
    same = (alike[nearest] >= ALIKE).roll(-nearest)
    return tuple((azimuth + float(turn)) % 360 for turn in equidistant_azimuths(VIEW_COUNT)[same][1:])


@lru_cache(maxsize=512)
def view_correlations(model: PreparedModel, elevation: float) -> Tensor:
    """Correlations (VIEW_COUNT, VIEW_COUNT) of the whitened views at an elevation, a multiple of ELEVATION_STEP."""
    views = view_descriptors(model, elevation)
    return views.flatten(1) @ coarse_whitener()(views).flatten(1).T
