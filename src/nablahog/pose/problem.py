"""The problem that a search for a pose solves."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import torch
from torch import Tensor

from ..inputs.boxes import Box
from ..render import PARAMETERS
from .crop import CROP_FILL, crop_object
from .model import (
    VIEW_COUNT,
    PreparedModel,
    azimuth_distance,
    equidistant_azimuths,
    fit_to_box,
    level_poses,
    signed_angles,
)
from .options import SimilarityKind
from .photograph import PreparedPhotograph
from .result import PoseEstimate
from .viewpoint_prior import ViewpointPrior

ELEVATIONS = (-15.0, 0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)
ELEVATION_OFFSETS = (-15.0, 0.0, 15.0)  # degrees from a given elevation at which views are searched
ELEVATION_ERROR = 5.0  # degrees: most given elevations are no further from the true one
KNOWN_TILTS = (-15.0, 0.0, 15.0)  # degrees of in-plane rotation tried when a pose is given
UNKNOWN_TILTS = (-45.0, -30.0, -15.0, 0.0, 15.0, 30.0, 45.0)  # degrees, when the pose is unknown
USUAL_ELEVATIONS = (-10.0, 40.0)  # elevations of most photographs, degrees
# penalties of the calibrated similarity for each degree beyond these, and for each degree of rotation
STEEP_PENALTY, TILT_PENALTY = 0.03, 0.01
_NEARLY_POLE = 80.0  # degrees of elevation from which on a tilt counts less
SMALL_PENALTY = 0.5  # penalty for each halving of an object's size in a photograph where it may be anywhere


@dataclass(frozen=True, eq=False)
class PoseProblem:
    """A photograph, candidate models, and how to search."""

    image: Tensor  # (C, H, W), the whole photograph
    photograph: PreparedPhotograph  # the object's crop with its templates
    box: Box  # of the object, pixels of the photograph: the one given, or the one where it is most likely
    other_boxes: tuple[Box, ...] | None  # others that the object may be in; None if a box was given
    models: Mapping[str, PreparedModel]  # the candidates by name
    initial: tuple[float, float] | None  # its rough azimuth and elevation, degrees; None if unknown
    within: float = 180.0  # degrees of azimuth on both sides of the initial one that are searched
    similarity: SimilarityKind = "calibrated"  # its kind
    viewpoints: ViewpointPrior | None = None  # used with several models; None to use views alone
    generator: torch.Generator | None = None  # of random samples
    progress: Callable[[int, int, str], None] = lambda done, total, what: None  # as for :func:`.estimate.estimate_pose`
    watch: Callable[[str, Tensor], None] = lambda model, pose: None  # as for :func:`.estimate.estimate_pose`

    def iterate_models(self) -> Iterator[tuple[str, PreparedModel]]:
        """The models by name, one after the other, with progress."""
        for done, (name, model) in enumerate(self.models.items()):
            self.progress(done, len(self.models), name)
            yield name, model
        self.progress(len(self.models), len(self.models), "refining the best views")

    @cached_property
    def allowed(self) -> Tensor:
        """Which of the views around a model are searched, (VIEW_COUNT,), bool."""
        return allowed_azimuths(equidistant_azimuths(VIEW_COUNT), self.initial, self.within)

    def allows(self, azimuth: float) -> bool:
        """Whether an azimuth, degrees, is searched."""
        return self.initial is None or azimuth_distance(azimuth, self.initial[0]) <= self.within

    def limit_azimuths(self, poses: Tensor) -> Tensor:
        """Poses (N, 6) with azimuths at most ``within`` degrees from the initial one, not beyond a pole."""
        if self.initial is None or self.within == 180:
            return poses
        off = signed_angles(poses[:, :1] - self.initial[0]).clamp(-self.within, self.within)
        return torch.cat([self.initial[0] + off, poses[:, 1:2].clamp(-90, 90), poses[:, 2:]], dim=1)

    def penalty(self, poses: Tensor, photograph: PreparedPhotograph) -> Tensor:
        """Penalties (N,), subtracted from the similarities of poses (N, 6) for a crop before these are compared.

        Few photographs are taken from high above, far from the given elevation, or tilted; and few without a given box
        are of something small.
        """
        penalties = torch.zeros(len(poses), dtype=poses.dtype)
        if self.similarity != "calibrated":
            return penalties
        penalties += view_penalty(poses[:, 1], poses[:, 3], self.initial)
        if self.other_boxes is not None:
            halvings = math.log2(max(self.image.shape[1:]) * photograph.crop.zoom / CROP_FILL)
            penalties += SMALL_PENALTY * max(0.0, halvings)
        return penalties

    @cached_property
    def level_penalties(self) -> dict[float, float]:
        """Penalties of level views, by all the elevations to search at, degrees."""
        poses = {elevation: level_poses(torch.zeros(1), elevation) for elevation in self.elevations}
        return {elevation: float(self.penalty(pose, self.photograph)) for elevation, pose in poses.items()}

    @property
    def tilts(self) -> tuple[float, ...]:
        """In-plane rotations to search at, degrees."""
        return UNKNOWN_TILTS if self.initial is None else KNOWN_TILTS

    @property
    def elevations(self) -> tuple[float, ...]:
        """Elevations to search at, degrees."""
        return ELEVATIONS if self.initial is None else elevations_around(self.initial)

    def level_views(self, model: PreparedModel, azimuths: Tensor, elevation: float) -> Tensor:
        """Poses (N, 6) at azimuths (N,) and an elevation, degrees, each placed so that it fills the box."""
        return self.fit(model, level_poses(azimuths, elevation))

    def fit(self, model: PreparedModel, poses: Tensor, photograph: PreparedPhotograph | None = None) -> Tensor:
        """Poses (N, 6) moved so that the model fills the object's box, or that of another crop."""
        crop = (photograph or self.photograph).crop
        return fit_to_box(poses, model.hull, crop.camera, crop.size)

    def crop_around(self, box: Sequence[float]) -> PreparedPhotograph:
        """The crop of the photograph around another box, seen through the same lens."""
        crop = self.photograph.crop
        other = crop_object(self.image, box, focal=crop.focal, axis=crop.axis)
        return PreparedPhotograph(other, self.photograph.own_background)

    def estimate(self, model: str, pose: Tensor, **attributes: Any) -> PoseEstimate:
        """The estimate at a pose (6,) for the object's crop, with other attributes of :class:`.PoseEstimate`."""
        crop = self.photograph.crop
        moved, camera = crop.place_in_photograph(pose, *self.image.shape[1:])
        return PoseEstimate(
            **dict(zip(PARAMETERS, wrap_angles(moved).tolist(), strict=True)),
            camera=camera,
            model=model,
            crop_pose=wrap_angles(pose),
            box=self.box,
            similarity_kind=self.similarity,
            principal_point=crop.axis,
            from_original=self.models[model].mesh.from_original,
            **attributes,
        )


def wrap_angles(pose: Tensor) -> Tensor:
    """The same pose (6,) with azimuth in 0…360, elevation in -90…90 and theta in -180…180, degrees."""
    wrapped = pose.clone()
    wrapped[1] = signed_angles(pose[1])
    if abs(wrapped[1]) > 90:  # seen over a pole
        wrapped[1] = wrapped[1].sign() * 180 - wrapped[1]
        wrapped[[0, 3]] += 180
    wrapped[0] = wrapped[0] % 360 % 360  # a little below 0 is rounded to 360 once
    wrapped[3] = signed_angles(wrapped[3])
    return wrapped


def wrap_hessian(hessian: Tensor, pose: Tensor) -> Tensor:
    """A Hessian (6, 6) at a pose (6,) for the parameters of :func:`wrap_angles`: over a pole, elevation falls."""
    signs = torch.ones_like(pose)
    signs[1] = -1 if abs(signed_angles(pose[1])) > 90 else 1
    return hessian * torch.outer(signs, signs)


def view_penalty(elevations: Tensor, tilts: Tensor, initial: tuple[float, float] | None = None) -> Tensor:
    """Penalties for the similarities of views at elevations (N,) and in-plane rotations (N,), degrees.

    All angles that describe a rotation, also beyond a pole, have the same penalty.  At a pole, from where nothing is
    upright, tilts have none.
    """
    low, high = USUAL_ELEVATIONS if initial is None else (initial[1] - ELEVATION_ERROR, initial[1] + ELEVATION_ERROR)
    elevations, tilts = signed_angles(elevations), signed_angles(tilts).abs()
    over = elevations.abs() > 90
    elevations = torch.where(over, 180 * elevations.sign() - elevations, elevations)
    tilts = torch.where(over, 180 - tilts, tilts)
    upright = (elevations.deg2rad().cos() / math.cos(math.radians(_NEARLY_POLE))).clamp(max=1)
    return (
        STEEP_PENALTY * ((elevations - high).clamp(min=0) + (low - elevations).clamp(min=0))
        + TILT_PENALTY * tilts * upright
    )


def elevations_around(initial: tuple[float, float]) -> tuple[float, ...]:
    """Elevations at which views are searched if a rough one is given, degrees."""
    return tuple(initial[1] + off for off in ELEVATION_OFFSETS if abs(initial[1] + off) <= 90)


def allowed_azimuths(azimuths: Tensor, initial: tuple[float, float] | None, within: float) -> Tensor:
    """Which azimuths (N,) are at most ``within`` degrees from the initial one, (N,), bool; the nearest always is."""
    if initial is None:
        return torch.ones(len(azimuths), dtype=torch.bool)
    distances = signed_angles(azimuths - initial[0]).abs()
    return distances <= max(within, float(distances.min()))
