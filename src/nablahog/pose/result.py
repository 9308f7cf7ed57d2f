"""The result of a search for a pose, and its figures."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from torch import Tensor

from ..inputs.arrays import ArrayImage, as_photograph
from ..inputs.boxes import Box
from ..inputs.cameras import PhotographCamera, advise_on_size
from ..io.files import write_text
from ..metrics import rotation_error
from ..render import PARAMETERS, Camera, Mesh
from ..render.conventions import move_before_camera
from ..render.lens import IdealCamera
from ..runtime.pytorch import in_plain_mode
from .ascent import SearchTrace
from .confidence import Evidence
from .geometry import PoseGeometry
from .options import FocalSource, SimilarityKind
from .symmetry import looks_same_all_around

MIN_SIMILARITY = 5.0
"""A calibrated similarity below which a pose without a confidence may mean nothing: 9 of 10 boxes of photographs
without any chair stay below it (48 boxes, 24 models), and none of 48 scenes with one of the models."""

DOUBT = "this pose is more likely wrong than right"
"""How the warning of a doubtful pose ends."""
SECOND_CONFIDENCE = 0.15
"""Confidence of a runner-up above which it is shown beside the best pose."""
OPPOSITE = 30.0
"""Degrees that a rotation may be off a half turn around the object, and still sees its opposite side."""


@dataclass(frozen=True, eq=False, repr=False)
class PoseEstimate(PoseGeometry):
    """A pose of an object in a photograph, and the model that it is for.

    If the photograph's camera has a distortion or two focal lengths, the pose is for the ideal camera in its place:
    ``camera``, ``x``, ``y``, ``principal_point`` and :attr:`intrinsics` belong to the picture that :meth:`undistort`
    makes.  :meth:`matrix` belongs to both, since the camera did not move; ``box`` is in pixels of the photograph.

    Attributes:
        azimuth: of the camera around the object's vertical axis, degrees in 0…360: 0 sees the front, 90 the object's
            left side.
        elevation: of the camera above the object's horizon, degrees in -90…90.
        distance: from the camera to the object's origin, in units of the mesh: of a normalised mesh, its diagonal.
        theta: counter-clockwise rotation of the picture, degrees in -180…180.
        x, y: pixels of the photograph, to the right and down from its middle to the image of the object's origin.
        camera: the camera of this pose; it sees the whole photograph, and looks straight at the object.
        model: the name of the best model; of a single mesh, that of its file without the ending, or "".
        similarity: of the rendering to the photograph; for a runner-up maybe that of the coarse descriptor.
        similarity_kind: ``"patches"`` or ``"calibrated"``, see :mod:`.similarity`; a calibrated one is in standard
            deviations over arbitrary photographs, one of patches has no unit.
        crop_pose: (6,), float64: the same pose for the object's crop, see :func:`.crop.crop_object`.
        box: of the object, pixels: the one given, or the one where it was found.
        confidence: probability that the whole rotation is within 15°, in 0…1, see :mod:`.confidence`, of a runner-up
            that it is that one's; None for similarities other than ``"calibrated"`` and methods other than ``"best"``.
            It counts that the object may be seen from outside the range of ``within``, if views from there fit better.
            What is missing to 1 from the sum of a pose's and its runners-up's is that none of them is right.
        evidence: the figures that the confidence rests on; None for a runner-up, and if there is no confidence.
        equivalent_azimuths: further azimuths from which the model looks the same, degrees; see :attr:`any_azimuth`.
        runners_up: the best poses from other sides, the best first.
        share: of a runner-up: its similarity, less the penalty of a rare view, divided by the best pose's, in 0…1;
            where its search ended with large cells, both are similarities of these; among several models, its votes
            divided by those for the best side.  1 for the best pose itself.
        renderings: the number that were compared with the photograph, cached views included.
        traces: of the searches from all starts; empty for ``"exhaustive"``.
        focal_from: the source of the focal length, ``"given"``, ``"exif"``, or ``"assumed"``; if assumed, the distance
            is not the true one.
        principal_point: x, y where the optical axis meets the photograph, pixels; None where the focal length is
            assumed; :attr:`intrinsics` then has that of a camera that looks straight at the object.
        photograph_camera: the camera that took the photograph, with its ``matrix`` and ``distortion``, if that is not
            the ideal one; else None.
        from_original: (4, 4), float64: of the model, see :class:`~nablahog.render.Mesh`.
        covariance: (6, 6), float64, of :attr:`pose`, in degrees, units of the mesh and pixels, if the pose is the right
            one, see :mod:`.covariance`; the variance of the distance is infinite where the focal length is assumed, and
            that of the azimuth where :attr:`any_azimuth` is true.  None for several models, whose mean viewpoint is off
            by what they differ from the object, which no curvature shows; if the best one is the object's own, search
            again with it alone.  None, too, but for ``"best"`` with the similarity ``"calibrated"``.

    >>> mesh, camera = nablahog.sample_chairs()["wooden-0"], nablahog.Camera.from_field_of_view(30, 128, 128)
    >>> photograph = nablahog.render(mesh, torch.tensor([[30.0, 20, 2, 0, 0, 0]]), camera)[0]
    >>> box = (28, 12, 95, 125)  # x0, y0, x1, y1

    >>> estimate = nablahog.estimate_pose(photograph, mesh, box=box, initial=(0, 20), method="exhaustive")
    >>> nablahog.render(mesh, estimate.pose, estimate.camera).shape
    torch.Size([1, 1, 128, 128])
    >>> estimate.matrix("opengl").shape, estimate.intrinsics.shape
    (torch.Size([4, 4]), torch.Size([3, 3]))
    """

    model: str
    similarity: float
    similarity_kind: SimilarityKind
    crop_pose: Tensor
    renderings: int
    box: Box
    traces: tuple[SearchTrace, ...] = ()
    confidence: float | None = None
    evidence: Evidence | None = None
    equivalent_azimuths: tuple[float, ...] = ()
    runners_up: tuple[PoseEstimate, ...] = ()
    share: float = 1.0
    focal_from: FocalSource = "assumed"
    photograph_camera: PhotographCamera | None = None

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
        return looks_same_all_around(self.equivalent_azimuths)

    @property
    def half_turn(self) -> float | None:
        """Probability that the object is seen from the opposite side: the sum of the confidences of such runners-up.

        Front and back of many objects look alike.  None without a confidence, and for a runner-up.
        """
        if self.confidence is None or self.evidence is None:
            return None
        around = (rival for rival in self.runners_up if see_opposite_sides(self._view, rival._view))
        return math.fsum(rival.confidence or 0.0 for rival in around)

    @property
    def _view(self) -> tuple[float, float, float]:
        return self.azimuth, self.elevation, self.theta

    @property
    def second(self) -> PoseEstimate | None:
        """The most probable runner-up, if it is right with a probability above :data:`SECOND_CONFIDENCE`; else None."""
        likely = [rival for rival in self.runners_up if (rival.confidence or 0.0) > SECOND_CONFIDENCE]
        return max(likely, key=lambda rival: rival.confidence or 0.0, default=None)

    @in_plain_mode
    def undistort(self, photograph: Tensor | ArrayImage) -> Tensor:
        """The photograph as ``camera`` sees it: with square pixels and without distortion, by bicubic interpolation.

        Where both focal lengths are one, this is the picture of OpenCV's ``undistort`` with the same camera matrix.

        Args:
            photograph: (C, H, W), the one of this estimate, as :func:`nablahog.estimate_pose` takes it.

        Returns:
            (C, height, width), in 0…1, of bytes float32; of an ideal camera the photograph itself.

        Raises:
            ValueError: it is of another size.
        """
        image, taken_by = as_photograph("the photograph", photograph), self.photograph_camera or self.camera
        height, width = taken_by.height, taken_by.width
        if image.shape[1:] != (height, width):
            came = "x".join(map(str, image.shape[1:]))
            raise ValueError(f"the photograph must be the one of the estimate, of {height}x{width} pixels, got {came}")
        if self.photograph_camera is None:
            return image if image.is_floating_point() else image / 255
        return IdealCamera(self.photograph_camera).resample(image, Box(0, 0, self.camera.width, self.camera.height))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes all figures as JSON, with the names of an annotation of ``nablahog pose``; replaces the file whole.

        Raises:
            OSError: the file cannot be written.
        """
        write_text(path, json.dumps(pose_figures(self), indent=1, allow_nan=False) + "\n")

    def render_arguments(self, mesh: Mesh) -> tuple[Mesh, Tensor, Camera]:
        """Arguments for :func:`nablahog.render` to draw the model over the photograph: mesh, pose (1, 6), camera.

        Where the focal length is assumed these are the mesh itself, :attr:`pose` and :attr:`camera`.  A known camera
        sees an object beside its optical axis a little stretched, as it is in the photograph.

        Args:
            mesh: the model, normalised.
        """
        if self.principal_point is None:
            return mesh, self.pose, self.camera
        return move_before_camera(mesh, self._motion, self.intrinsics, self.camera.height, self.camera.width)


def see_opposite_sides(view: Sequence[float], other: Sequence[float]) -> bool:
    """Whether views (azimuth, elevation, theta), degrees, are a half turn around the object apart: :data:`OPPOSITE`."""
    azimuth, elevation, theta = view
    return float(rotation_error((azimuth + 180, elevation, theta), other)) <= OPPOSITE


def pose_figures(estimate: PoseEstimate) -> dict[str, Any]:
    """All figures, ready for JSON."""
    real = estimate.photograph_camera
    return {
        "image_size": [estimate.camera.height, estimate.camera.width],
        "box": list(estimate.box),
        "model": estimate.model,
        **_parameters(estimate),
        "distance_in_file_units": estimate.distance_in_file_units,
        "standard_deviations": _standard_deviations(estimate),
        "covariance": None if estimate.covariance is None else [_finite(row) for row in estimate.covariance.tolist()],
        "position": estimate.position.tolist(),
        "position_std": None if estimate.position_std is None else estimate.position_std.tolist(),
        "focal_length": estimate.camera.focal,
        "focal_length_from": estimate.focal_from,
        "principal_point": estimate.intrinsics[:2, 2].tolist(),
        "intrinsics": estimate.intrinsics.tolist(),
        "photograph_camera": None
        if real is None
        else {
            "camera_matrix": real.matrix,
            "dist_coeffs": list(real.distortion),
            "image_size": [real.height, real.width],
        },
        "matrix": estimate.matrix().tolist(),
        "matrix_world": estimate.camera_to_world.tolist(),
        "any_azimuth": estimate.any_azimuth,
        "equivalent_azimuths": list(estimate.equivalent_azimuths),
        "similarity": estimate.similarity,
        "similarity_kind": estimate.similarity_kind,
        "confidence": estimate.confidence,
        "warning": warning(estimate),
        "half_turn": estimate.half_turn,
        "second": None if estimate.second is None else _rival_figures(estimate.second),
        "runners_up": [_rival_figures(rival) for rival in estimate.runners_up],
        "renderings": estimate.renderings,
    }


def _rival_figures(rival: PoseEstimate) -> dict[str, Any]:
    return {"model": rival.model, **_parameters(rival), "share": rival.share, "confidence": rival.confidence}


def _parameters(estimate: PoseEstimate) -> dict[str, float]:
    return dict(zip(PARAMETERS, estimate.pose[0].tolist(), strict=True))


def _standard_deviations(estimate: PoseEstimate) -> dict[str, float | None] | None:
    """By the names of the parameters, None for what is unknown; None for all of them."""
    if estimate.standard_deviations is None:
        return None
    deviations = dict(zip(PARAMETERS, _finite(estimate.standard_deviations.tolist()), strict=True))
    distance = deviations["distance"]
    in_file_units = None if distance is None else distance * estimate.distance_in_file_units / estimate.distance
    return {**deviations, "distance_in_file_units": in_file_units}


def _finite(numbers: Sequence[float]) -> list[float | None]:
    return [number if math.isfinite(number) else None for number in numbers]


def warning(estimate: PoseEstimate) -> str | None:
    """A sentence if the pose is more likely wrong than right: by its confidence, or else by its similarity.

    Before it, or alone, one if the camera's numbers seem to be for photographs of another size.
    """
    camera, point = estimate.photograph_camera or estimate.camera, estimate.principal_point
    point = (camera.cx, camera.cy) if isinstance(camera, PhotographCamera) else point
    advice = None if point is None else advise_on_size(camera.height, camera.width, *point)
    if estimate.confidence is not None:
        reason = f"the confidence is {estimate.confidence:.2f}" if estimate.confidence < 0.5 else None
    elif estimate.similarity_kind == "calibrated" and estimate.similarity < MIN_SIMILARITY:
        reason = f"the similarity, {estimate.similarity:.1f}, is no higher than in photographs without the object"
    else:
        reason = None
    return "; ".join(filter(None, (advice, reason and f"{reason}: {DOUBT}"))) or None
