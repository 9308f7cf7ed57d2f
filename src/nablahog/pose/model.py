"""A model prepared for comparison: its renderers, and its views all around, made once for all photographs.

The distance and shift of a view are those at which the model's outline fills a box.  Views are also cached on disk
(:mod:`nablahog.io.array_cache`) for later processes.
"""

from __future__ import annotations

import hashlib
from functools import cached_property, lru_cache

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError
from torch import Tensor

from ..io.array_cache import cached_array
from ..render import Camera, Mesh, Renderer
from ..render.camera import rotation_matrices
from ..render.renderer import DEFAULT_LIGHT, EdgeMethod
from ..render.surface import Light, simplify
from ..runtime.cache import code_key
from .crop import CROP_FILL, CROP_SIDE, DISTANCE, downsample_camera, typical_camera
from .similarity import Similarity, Template, coarse_background, describe, deviations, downsample_poses, run_in_batches
from .whitening import Background, Whitener, cached_whitener

Doubles = NDArray[np.float64]

VIEW_COUNT = 48  # azimuths around an object, at which the coarse search looks at models
_ROUNDS = 3  # of fitting the distance: perspective makes size not quite its inverse; 2 leave a tenth of a pixel
DETAIL = 1.0  # pixels that vertices may be off in searches: a third of the faces remain, and poses are as exact
_FEW_FACES = 500  # with fewer, a mesh is as fast, and thin ones such as doors would become flat
ELEVATION_STEP = 5.0  # degrees between the elevations that there are views of
_CACHED_VIEWS = 2048  # sets of views, of half a megabyte: those of 256 models


class PreparedModel:
    """A normalised mesh with its renderers, for :func:`.crop.typical_camera` unless another is given."""

    def __init__(self, mesh: Mesh) -> None:
        self.mesh, self.camera, self.hull = mesh, typical_camera(), convex_hull(mesh)
        self._renderers: dict[tuple[EdgeMethod, int, float, int], Renderer] = {}

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
        method: EdgeMethod = "edges",
        supersampling: int = 1,
        *,
        detail: float = 0.0,
        shrink: int = 1,
        camera: Camera | None = None,
    ) -> Renderer:
        """The renderer of images ``shrink`` times smaller than the crop.

        Args:
            method, supersampling: as for :class:`nablahog.Renderer`.
            detail: pixels that the vertices of a large mesh may be off, seen from :data:`.crop.DISTANCE`; with fewer
                faces it renders faster.
            shrink: factor.
            camera: of the crop, if it has another focal length than the typical one.
        """
        key = method, supersampling, detail, shrink
        if key not in self._renderers:
            own = downsample_camera(self.camera, shrink)
            simpler = detail > 0 and len(self.mesh.faces) >= _FEW_FACES
            mesh = simplify(self.mesh, detail * DISTANCE / own.focal) if simpler else self.mesh
            self._renderers[key] = Renderer(mesh, own, method=method, supersampling=supersampling)
        renderer = self._renderers[key]
        return renderer if camera is None else renderer.with_camera(downsample_camera(camera, shrink))

    def similarity(
        self,
        template: Template,
        method: EdgeMethod = "edges",
        supersampling: int = 1,
        *,
        detail: float = 0.0,
        camera: Camera | None = None,
    ) -> Similarity:
        """The similarity of renderings to a template; see :meth:`renderer`."""
        renderer = self.renderer(method, supersampling, detail=detail, shrink=template.shrink, camera=camera)
        return Similarity(renderer, template)


@lru_cache(maxsize=256)
def prepared_model(mesh: Mesh) -> PreparedModel:
    """The prepared model of a mesh, made once."""
    return PreparedModel(mesh)


def crop_whitener(background: Background, shrink: int = 1) -> Whitener:
    """The whitener of descriptors of crops that are made ``shrink`` times smaller."""
    return cached_whitener(background, *background.spec.grid(CROP_SIDE // shrink, CROP_SIDE // shrink))


def view_descriptors(model: PreparedModel, elevation: float, own: Background | None = None) -> Tensor:
    """Descriptors of views all around, each divided by the standard deviation of its score over photographs.

    The model fills the crop, so that views do not depend on the photograph.

    Args:
        model: seen from equidistant azimuths and a multiple of :data:`ELEVATION_STEP` near ``elevation``, degrees.
        own: the background of the descriptor; None for the default one.

    Returns:
        (VIEW_COUNT, C, rows, cols), float32.
    """
    return _read_views(model, round_elevation(elevation), own)


@lru_cache(maxsize=_CACHED_VIEWS)
def _read_views(model: PreparedModel, elevation: float, own: Background | None) -> Tensor:
    background, shrink = coarse_background(own)
    spec, whitener = background.spec, crop_whitener(background, shrink)
    facts = (model.digest, spec.to_json(), whitener.digest, shrink, elevation, code_key(), torch.__version__)
    key = hashlib.sha256(repr(facts).encode()).hexdigest()
    shape = VIEW_COUNT, spec.channels, whitener.rows, whitener.cols

    def describe_all() -> NDArray[np.float32]:
        azimuths = equidistant_azimuths(VIEW_COUNT)
        return describe_views(model, azimuths, elevation, background, shrink, DEFAULT_LIGHT).numpy()

    return torch.from_numpy(cached_array("views", key, shape, describe_all))


def round_elevation(elevation: float) -> float:
    return ELEVATION_STEP * round(elevation / ELEVATION_STEP)


def describe_views(
    model: PreparedModel, azimuths: Tensor, elevation: float, background: Background, shrink: int, light: Light
) -> Tensor:
    """Renders and describes views that fill the crop, as :func:`view_descriptors` returns them."""
    whitener = crop_whitener(background, shrink)
    poses = fit_to_box(level_poses(azimuths, elevation), model.hull, model.camera, CROP_FILL)
    renderer = model.renderer(detail=DETAIL, shrink=shrink)
    if light is not DEFAULT_LIGHT:
        renderer = Renderer(renderer.mesh, renderer.camera, light=light, supersampling=renderer.supersampling)

    def describe_poses(batch: Tensor) -> Tensor:
        descriptors = describe(renderer.render(batch, derivative=False).image[:, None], background.spec)
        return descriptors / deviations(whitener.energies(descriptors))[:, None, None, None]

    return torch.cat(run_in_batches(describe_poses, downsample_poses(poses, shrink)))


def forget_views() -> None:
    """Empties the caches of this module, which hold models with their renderers and views."""
    for cached in (prepared_model, _read_views):
        cached.cache_clear()


def equidistant_azimuths(count: int, first: float = 0.0) -> Tensor:
    """All around, (count,), float64, degrees."""
    return first + torch.arange(count, dtype=torch.float64) * (360 / count)


def azimuth_sweep(pose: Tensor, views: int) -> Tensor:
    """``views`` equidistant azimuths from a pose (6,) on, (views, 6); all else stays."""
    poses = pose.repeat(views, 1)
    poses[:, 0] += equidistant_azimuths(views)
    return poses


def reverse_depth(pose: Tensor) -> Tensor:
    """The pose (6,) from which an object with equal left and right has nearly the same outline, near and far exchanged.

    From far away the outline is the same, as of Necker's cube: only edges inside tell the two apart.
    """
    reversed_pose = pose.clone()
    reversed_pose[:2] = torch.stack([180 - pose[0], -pose[1]])
    return reversed_pose


def azimuth_distance(first: float, second: float) -> float:
    """Degrees between azimuths, in 0…180."""
    return abs((first - second + 180) % 360 - 180)


def select_different(poses: Tensor, apart: float, count: int) -> list[int]:
    """Indices of at most ``count`` of the poses (N, 6) whose rotations are over ``apart`` degrees from earlier ones."""
    turned = rotation_matrices(poses.double().numpy()).reshape(len(poses), 9)
    cosines = ((turned @ turned.T - 1) / 2).clip(-1, 1)
    near = np.degrees(np.arccos(cosines)) <= apart
    chosen: list[int] = []
    for k in range(len(poses)):
        if len(chosen) < count and not near[k, chosen].any():
            chosen.append(k)
    return chosen


def signed_angles(angles: Tensor) -> Tensor:
    """The same angles in -180…180 degrees."""
    return (angles + 180) % 360 - 180


def local_maxima(values: Tensor, count: int) -> Tensor:
    """Indices of the at most ``count`` highest local maxima on a circle of values (N,), the highest first."""
    highest = (values >= values.roll(1)) & (values >= values.roll(-1))
    indices = highest.nonzero().squeeze(1)
    order: Tensor = indices[values[indices].argsort(descending=True)]
    return order[:count]


def convex_hull(mesh: Mesh) -> Tensor:
    """The vertices (N, 3) of the convex hull: they determine the box around any view of a mesh."""
    points = mesh.vertices.detach().cpu().numpy()
    try:
        return torch.from_numpy(points[ConvexHull(points).vertices])
    except (QhullError, ValueError):  # points in one plane, or too few of them
        return torch.from_numpy(np.unique(points, axis=0))


def level_poses(azimuths: Tensor, elevations: float | Tensor) -> Tensor:
    """Poses (N, 6) at azimuths (N,) and elevations, degrees, not turned in the image plane and not yet placed."""
    poses = torch.tensor([0, 0, DISTANCE, 0, 0, 0], dtype=torch.float64).repeat(len(azimuths), 1)
    poses[:, 0], poses[:, 1] = azimuths, elevations
    return poses


def fit_to_box(poses: Tensor, points: Tensor, camera: Camera, size: tuple[float, float] | float | Tensor) -> Tensor:
    """Poses (B, 6) with the distance and shift at which the box of points (N, 3) is in the middle and has a given size.

    The size is width and height of a box of the same area, or the length of the longer side, perhaps (B,), pixels.
    """
    placed = poses.detach().double().numpy().copy()
    turned = _turn_points(placed, points)
    for round_ in range(_ROUNDS + 1):
        boxes = _project_boxes(turned, placed[:, 2], camera)
        low, high = boxes[:, :2] + placed[:, 4:], boxes[:, 2:] + placed[:, 4:]
        if round_ < _ROUNDS:
            sides = (high - low).clip(min=1e-6)
            if isinstance(size, tuple):
                zoom = np.sqrt(size[0] * size[1] / sides.prod(1))
            else:
                zoom = np.asarray(size) / sides.max(1)
            placed[:, 2] = (placed[:, 2] / zoom).clip(min=1.0)
        placed[:, 4:] -= (low + high) / 2
    return torch.from_numpy(placed).to(poses.dtype)


def tilt_views(poses: Tensor, tilts: Tensor) -> Tensor:
    """Level poses (B, 6) turned by tilts (B,), degrees counter-clockwise, about the middle of the image."""
    angle = torch.deg2rad(tilts)
    x, y = poses[:, 4], poses[:, 5]
    across, down = angle.cos() * x + angle.sin() * y, angle.cos() * y - angle.sin() * x
    return torch.cat([poses[:, :3], torch.stack([tilts, across, down], 1)], 1)


def bounding_boxes(poses: Tensor, points: Tensor, camera: Camera) -> Tensor:
    """The boxes x0, y0, x1, y1 around points (N, 3) at poses (B, 6), (B, 4), pixels from the middle of the image."""
    numbers = poses.double().numpy()
    boxes = _project_boxes(_turn_points(numbers, points), numbers[:, 2], camera)
    return torch.from_numpy(boxes) + poses[:, [4, 5, 4, 5]]


def _turn_points(poses: Doubles, points: Tensor) -> Doubles:
    """Points (N, 3) turned as at poses (B, 6), in the directions of the camera's axes, (B, 3, N)."""
    turned: Doubles = rotation_matrices(poses) @ points.double().numpy().T
    return turned


def _project_boxes(turned: Doubles, distances: Doubles, camera: Camera) -> Doubles:
    """The boxes (B, 4) around turned points (B, 3, N) at distances (B,), pixels from the projected origin."""
    screen = turned[:, :2] * (camera.focal / (turned[:, 2] + distances[:, np.newaxis]))[:, np.newaxis]
    return np.concatenate([screen.min(axis=2), screen.max(axis=2)], axis=1)
