"""What a search for a pose is asked, and what it answers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import torch
from torch import Tensor

from ..hog.box import Box
from ..render import Camera, Mesh
from ..render.conventions import MatrixConvention, in_convention, moved_before, pose_matrix, turn_to
from .crop import FILL, crop_object
from .model import VIEW_COUNT, PreparedModel, equidistant_azimuths, fit_to_box, level_poses, signed_angles
from .options import FocalSource, SearchTrace, SimilarityKind
from .photograph import PreparedPhotograph
from .viewpoint_prior import ViewpointPrior

ELEVATIONS = (-15.0, 0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)
LEVEL = (-15.0, 0.0, 15.0)  # degrees of in-plane rotation tried when a pose is given
TILTS = (-45.0, -30.0, -15.0, 0.0, 15.0, 30.0, 45.0)  # degrees, when the pose is unknown
USUAL = (-10.0, 40.0)  # elevations of most photographs, degrees
STEEP, TURNED = (
    0.03,
    0.01,
)  # penalties of the calibrated similarity for each degree beyond these, and for each degree of rotation
_NEIGHBOURS = 8  # of 48 views that may differ although a model looks the same all around
SMALL = 0.5  # penalty for each halving of an object's size in a photograph where it may be anywhere


@dataclass(frozen=True, eq=False, repr=False)
class PoseEstimate:
    """A pose of an object in a photograph, and the model that it is for.

    Attributes:
        azimuth: of the camera around the object's vertical axis, degrees in 0…360: 0 sees the front, 90 the object's
            left side.
        elevation: of the camera above the object's horizon, degrees.
        distance: from the camera to the object's origin, in units of the mesh: of a normalised mesh, its diagonal.
        theta: counter-clockwise rotation of the picture, degrees.
        x, y: pixels of the photograph, to the right and down from its middle to the image of the object's origin.
        camera: the camera of this pose; it sees the whole photograph, and looks straight at the object.
        model: the name of the best model; "" for a single mesh.
        similarity: of the rendering to the photograph; for a runner-up maybe that of the coarse descriptor.
        similarity_kind: ``"patches"`` or ``"calibrated"``, see :mod:`.similarity`; a calibrated one is in standard
            deviations over arbitrary photographs, one of patches has no unit.
        crop_pose: (6,), float64: the same pose for the object's crop, see :func:`.crop.crop_object`.
        box: of the object, pixels: the one given, or the one where it was found.
        confidence: probability that the azimuth is within 15°, in 0…1, see :mod:`.vote`; None for similarities
            other than ``"calibrated"`` and methods other than ``"best"``.
        equivalent_azimuths: further azimuths from which the model looks the same, degrees; see :attr:`any_azimuth`.
        runners_up: the best poses from other sides, the best first.
        share: of a runner-up: its similarity divided by the best pose's; among several models, its votes divided by
            those for the best side.  1 for the best pose itself.
        renderings: the number that were compared with the photograph, cached views included.
        traces: of the searches from all starts; empty for ``"exhaustive"``.
        focal_from: the source of the focal length, ``"given"``, ``"exif"``, or ``"assumed"``; if assumed, the distance
            is not the true one.
        principal_point: x, y where the optical axis meets the photograph, pixels; None where the focal length is
            assumed.
        from_original: (4, 4), float64: of the model, see :class:`~nablahog.render.Mesh`.

    >>> mesh, camera = nablahog.sample_chairs()["wooden-0"], nablahog.Camera.from_field_of_view(30, 128, 128)
    >>> photograph = nablahog.render(mesh, torch.tensor([[30.0, 20, 2, 0, 0, 0]]), camera)[0]
    >>> box = (28, 12, 95, 125)  # x0, y0, x1, y1

    >>> estimate = nablahog.estimate_pose(photograph, mesh, box=box, initial=(0, 20), method="exhaustive")
    >>> nablahog.render(mesh, estimate.pose, estimate.camera).shape
    torch.Size([1, 1, 128, 128])
    >>> estimate.matrix("opengl").shape, estimate.intrinsics.shape
    (torch.Size([4, 4]), torch.Size([3, 3]))
    """

    azimuth: float
    elevation: float
    distance: float
    theta: float
    x: float
    y: float
    camera: Camera
    model: str
    similarity: float
    similarity_kind: SimilarityKind
    crop_pose: Tensor
    renderings: int
    box: Box
    traces: tuple[SearchTrace, ...] = ()
    confidence: float | None = None
    equivalent_azimuths: tuple[float, ...] = ()
    runners_up: tuple[PoseEstimate, ...] = ()
    share: float = 1.0
    focal_from: FocalSource = "assumed"
    principal_point: tuple[float, float] | None = None
    from_original: Tensor = field(default_factory=lambda: torch.eye(4, dtype=torch.float64))

    def __repr__(self) -> str:
        """Pose and figures, not the camera or the search."""
        model = f", model {self.model}" if self.model else ""
        sure = "" if self.confidence is None else f", confidence {self.confidence:.2f}"
        azimuth = "any" if self.any_azimuth else f"{self.azimuth:.1f}°"
        return (
            f"<PoseEstimate azimuth {azimuth}, elevation {self.elevation:.1f}°, theta {self.theta:.1f}°, "
            f"distance {self.distance:.2f}, x {self.x:.1f}, y {self.y:.1f}{model}, "
            f"{self.similarity_kind} similarity {self.similarity:.3g}{sure}, {self.renderings} renderings>"
        )

    @property
    def any_azimuth(self) -> bool:
        """Whether the model looks the same from all around, as a bottle does: no photograph tells its azimuth."""
        return len(self.equivalent_azimuths) >= VIEW_COUNT - _NEIGHBOURS

    @property
    def pose(self) -> Tensor:
        """(1, 6), float64, angles in degrees: what :func:`nablahog.render.render` takes together with ``camera``."""
        values = (self.azimuth, self.elevation, self.distance, self.theta, self.x, self.y)
        return torch.tensor([values], dtype=torch.float64)

    @property
    def distance_in_file_units(self) -> float:
        """From the camera to the middle of the model's bounding box, in the units of its file."""
        return self.distance * self._unit

    @property
    def intrinsics(self) -> Tensor:
        """(3, 3), float64, pixels: the camera's matrix, which projects what :meth:`matrix` maps to its frame.

        Its principal point is that of the photograph's camera; where that is unknown, the one of a camera that looks
        straight at the object, x and y from the photograph's middle.
        """
        place = self.principal_point or self._place
        focal = self.camera.focal
        return torch.tensor([[focal, 0, place[0]], [0, focal, place[1]], [0, 0, 1]], dtype=torch.float64)

    def matrix(self, convention: MatrixConvention = "opencv") -> Tensor:
        """The rigid motion (4, 4), float64, from the mesh as it is in its file to the camera's frame, in its units.

        With OpenCV's convention, a point X of the file is seen at :attr:`intrinsics` · (R X + t), divided by its last
        coordinate.

        Args:
            convention: of the camera's frame: ``"opencv"``, x right, y down and z forward, or ``"opengl"``, y up and z
                backward.

        Raises:
            ValueError: ``convention`` is neither.
        """
        unit = torch.tensor([self._unit] * 3 + [1], dtype=torch.float64)[:, None]
        return in_convention(unit * (self._motion @ self.from_original), convention)

    def render_arguments(self, mesh: Mesh) -> tuple[Mesh, Tensor, Camera]:
        """Arguments for :func:`nablahog.render` to draw the model over the photograph: mesh, pose (1, 6), camera.

        Where the focal length is assumed these are the mesh itself, :attr:`pose` and :attr:`camera`.  A known camera
        sees an object beside its optical axis a little stretched, as it is in the photograph.

        Args:
            mesh: the model, normalised.
        """
        if self.principal_point is None:
            return mesh, self.pose, self.camera
        return moved_before(mesh, self._motion, self.intrinsics, self.camera.height, self.camera.width)

    @property
    def _unit(self) -> float:  # of the mesh, in those of its file
        return 1 / float(self.from_original[:3, 0].norm())

    @property
    def _place(self) -> tuple[float, float]:
        """x, y of the object's origin in the photograph, pixels."""
        return self.camera.width / 2 + self.x, self.camera.height / 2 + self.y

    @property
    def _motion(self) -> Tensor:
        """(4, 4): from the normalised mesh to the frame of the camera."""
        motion = pose_matrix(self.pose[0])
        if self.principal_point is not None:
            x, y = (at - axis for at, axis in zip(self._place, self.principal_point, strict=True))
            ray = torch.tensor([x / self.camera.focal, y / self.camera.focal, 1.0], dtype=torch.float64)
            motion[:3] = turn_to(ray).T @ motion[:3]
        return motion


@dataclass(frozen=True, eq=False)
class PoseProblem:
    """A photograph, candidate models, and how to search."""

    image: Tensor  # (C, H, W), the whole photograph
    photograph: PreparedPhotograph  # the object's crop with its templates
    box: Box  # of the object, pixels of the photograph: the one given, or the one where it is most likely
    other_boxes: tuple[Box, ...] | None  # others that the object may be in; None if a box was given
    models: Mapping[str, PreparedModel]  # the candidates by name
    initial: tuple[float, float] | None  # azimuth and elevation to begin at, degrees; None if unknown
    within: float = 180.0  # degrees of azimuth on both sides of the initial one that are searched
    similarity: SimilarityKind | None = None  # its kind; None for that of the search
    viewpoints: ViewpointPrior | None = None  # counts among several models; None for views alone
    focal_from: FocalSource = "assumed"  # where the focal length is from
    generator: torch.Generator | None = None  # of random samples
    progress: Callable[[int, int, str], None] = lambda done, total, what: None  # as for :func:`.estimate.estimate_pose`
    watch: Callable[[str, Tensor], None] = lambda model, pose: None  # as for :func:`.estimate.estimate_pose`

    def each_model(self) -> Iterator[tuple[str, PreparedModel]]:
        """The models by name, one after the other, with progress."""
        for done, (name, model) in enumerate(self.models.items()):
            self.progress(done, len(self.models), name)
            yield name, model

    @cached_property
    def allowed(self) -> Tensor:
        """Which of the views around a model are searched, (VIEW_COUNT,), bool."""
        return allowed_azimuths(equidistant_azimuths(VIEW_COUNT), self.initial, self.within)

    def bounded(self, poses: Tensor) -> Tensor:
        """Poses (N, 6) with azimuths at most ``within`` degrees from the initial one."""
        if self.initial is None or self.within == 180:
            return poses
        off = signed_angles(poses[:, 0] - self.initial[0]).clamp(-self.within, self.within)
        return torch.cat([self.initial[0] + off[:, None], poses[:, 1:]], dim=1)

    def penalty(self, poses: Tensor, photograph: PreparedPhotograph) -> Tensor:
        """Penalties for the similarities of poses (N, 6) for a crop in comparisons, (N,).

        Few photographs are from high above, tilted, or of something small.  A pose or box that is given says more.
        """
        penalties = torch.zeros(len(poses), dtype=poses.dtype)
        if self.similarity not in (None, "calibrated"):
            return penalties
        if self.initial is None:
            penalties += view_penalty(poses[:, 1], poses[:, 3])
        if self.other_boxes is not None:
            penalties += SMALL * max(0.0, math.log2(max(self.image.shape[1:]) * photograph.crop.zoom / FILL))
        return penalties

    @cached_property
    def level_penalties(self) -> dict[float, float]:
        """Penalties of level views by their elevations, those to search at, degrees."""
        of_level = {each: level_poses(torch.zeros(1), each) for each in self.elevations}
        return {each: float(self.penalty(pose, self.photograph)) for each, pose in of_level.items()}

    @property
    def tilts(self) -> tuple[float, ...]:
        """In-plane rotations to search at, degrees."""
        return TILTS if self.initial is None else LEVEL

    @property
    def elevations(self) -> tuple[float, ...]:
        """Elevations to search at, degrees."""
        return ELEVATIONS if self.initial is None else (self.initial[1],)

    def level_views(self, model: PreparedModel, azimuths: Tensor, elevation: float) -> Tensor:
        """Poses (N, 6) at azimuths (N,) and an elevation, degrees, each placed so that it fills the box."""
        return self.fit(model, level_poses(azimuths, elevation))

    def fit(self, model: PreparedModel, poses: Tensor, photograph: PreparedPhotograph | None = None) -> Tensor:
        """Poses (N, 6) moved so that the model fills the object's box, or that of another crop."""
        crop = (photograph or self.photograph).crop
        return fit_to_box(poses, model.hull, crop.camera, crop.size)

    def cropped(self, box: Sequence[float]) -> PreparedPhotograph:
        """The crop of the photograph around another box, seen through the same lens."""
        crop = self.photograph.crop
        other = crop_object(self.image, box, focal=crop.focal, axis=crop.axis)
        return PreparedPhotograph(other, self.photograph.own_background)

    def estimate(self, model: str, pose: Tensor, **others: Any) -> PoseEstimate:
        """The estimate at a pose (6,) for the object's crop, with other attributes of :class:`.PoseEstimate`."""
        crop = self.photograph.crop
        moved, camera = crop.in_photograph(pose, *self.image.shape[1:])
        azimuth, elevation, distance, theta, x, y = moved.tolist()
        return PoseEstimate(
            azimuth % 360,
            elevation,
            distance,
            theta,
            x,
            y,
            camera,
            model,
            crop_pose=pose,
            box=self.box,
            focal_from=self.focal_from,
            principal_point=crop.axis,
            from_original=self.models[model].mesh.from_original,
            **others,
        )


def view_penalty(elevations: Tensor, tilts: Tensor) -> Tensor:
    """Penalties for the similarities of views at elevations (N,) and in-plane rotations (N,), degrees."""
    low, high = USUAL
    return STEEP * ((elevations - high).clamp(min=0) + (low - elevations).clamp(min=0)) + TURNED * tilts.abs()


def allowed_azimuths(azimuths: Tensor, initial: tuple[float, float] | None, within: float) -> Tensor:
    """Which azimuths (N,) are within degrees of the initial one, (N,), bool; the nearest always is."""
    if initial is None:
        return torch.ones(len(azimuths), dtype=torch.bool)
    distances = signed_angles(azimuths - initial[0]).abs()
    return distances <= max(within, float(distances.min()))
