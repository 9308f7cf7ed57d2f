"""Chairs in front of photographs, as the tests of poses need them."""

from __future__ import annotations

import math
from functools import lru_cache

import torch
from torch import Tensor

from nablahog.hog.gradient import gray
from nablahog.inputs.boxes import Box
from nablahog.io.images import sample_photograph
from nablahog.pose import PoseEstimate
from nablahog.render import Camera, Mesh, pose, render, silhouette

from ..chairs import chair

WOODEN, SWIVEL = 4, 2  # seeds of chairs that are quickly rendered


@lru_cache
def model(seed: int = WOODEN) -> Mesh:
    return chair(seed)


def photographed(mesh: Mesh, azimuth: float, elevation: float, *, behind: str = "") -> tuple[Tensor, Box]:
    """An object on white, or in front of a photograph, (1, 150, 180), with its box, away from the middle."""
    camera = Camera(300.0, 150, 180)
    at = pose(azimuth, elevation, 2.8, x=22, y=-8)
    background = gray(sample_photograph(behind)[None])[:, :, 100:250, 60:240] if behind else 1.0
    image = render(mesh, at, camera, background=background)[0]
    return image, box_around(silhouette(mesh, at, camera)[0, 0] > 0.5)


def box_around(mask: Tensor) -> Box:
    rows, cols = mask.nonzero().unbind(1)
    return Box(float(cols.min()), float(rows.min()), float(cols.max() + 1), float(rows.max() + 1))


def degrees_between(one: float, other: float) -> float:
    return abs((one - other + 180) % 360 - 180)


def errors(estimate: PoseEstimate, matrix: Tensor) -> tuple[float, float]:
    """Degrees of the rotation, and the distance of the places in diagonals of the chair."""
    unit = torch.tensor([model().unit] * 3 + [1], dtype=torch.float64)[:, None]
    found = (estimate.matrix() @ torch.linalg.inv(estimate.from_original)) / unit
    cosine = (float((found[:3, :3] @ matrix[:3, :3].T).trace()) - 1) / 2
    return math.degrees(math.acos(min(1.0, cosine))), float((found[:3, 3] - matrix[:3, 3]).norm())


def overlap(one: Tensor, other: Tensor) -> float:
    """Of two masks: shared pixels in those of either."""
    return float((one & other).sum() / (one | other).sum())


def columns(azimuths: Tensor, elevation: float = 15.0, distance: float = 3.0) -> Tensor:
    """Poses (N, 6) at azimuths (N,)."""
    return torch.cat([pose(float(azimuth), elevation, distance) for azimuth in azimuths])
