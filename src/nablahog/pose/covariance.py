"""The covariance of a pose, from the curvature of the similarity at its maximum (Laplace's approximation).

The similarity is in standard deviations of a score, so it falls off around the true pose like the logarithm of a
likelihood, up to a factor: the covariance is the inverse of minus its Hessian, up to a scale.  Scales were fitted to
scenes of known models, so that 68 % of the true parameters are within one standard deviation.  They include what the
curvature does not show: the light, the look of the renderer, cells and pixels, and an assumed focal length.

It is conditional on the pose being the right one.  How likely that is, is the confidence.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from .ascent import UNITS
from .crop import ObjectCrop


class Scales(NamedTuple):
    """Of standard deviations in a crop, by parameter."""

    factors: Tensor  # (6,) of the standard deviations by the curvature
    floors: Tensor  # (6,) in :data:`.ascent.UNITS`, added to them in squares


def _scales(factors: tuple[float, ...], floors: tuple[float, ...]) -> Scales:
    return Scales(*(torch.tensor(numbers, dtype=torch.float64) for numbers in (factors, floors)))


KNOWN_FOCAL = _scales((0.22, 0.18, 0.32, 0.25, 0.18, 0.20), (0, 0, 0, 0, 0, 0))
ASSUMED_FOCAL = _scales((0.24, 0.22, 0.0, 0.27, 0.19, 0.27), (0, 0, 0, 0, 0, 0))
_FLATTEST = 0.05  # smallest curvature along an axis, as a fraction of the largest: a fit to jags may show less
_DISTANCE = 2  # the place of the distance among the parameters
_STEP = 1e-3  # of central differences of a smooth map, in degrees, units and pixels


def pose_covariance(hessian: Tensor, pose: Tensor, crop: ObjectCrop, size: Sequence[int]) -> Tensor:
    """The covariance (6, 6), float64, of a pose in a photograph.

    Args:
        hessian: (6, 6) of the similarity at its maximum, per degree, unit and pixel of the crop.
        pose: (6,) at the maximum, for the crop.
        crop: of the photograph; its focal length is known if its axis is.
        size: height and width of the photograph, pixels.

    Returns:
        Of azimuth, elevation, distance, theta, x and y in degrees, units of the mesh and pixels of the photograph.  The
        variance of the distance is infinite, and its covariances are 0, where the focal length is assumed.
    """
    factors, floors = ASSUMED_FOCAL if crop.axis is None else KNOWN_FOCAL
    units = UNITS.clone()
    units[_DISTANCE] *= pose[_DISTANCE] / 3.0
    scaled = units * factors
    bends, axes = torch.linalg.eigh(-hessian * torch.outer(units, units))
    bends = bends.clamp(min=_FLATTEST * max(float(bends.abs().max()), 1e-9))
    inverse = (axes / bends) @ axes.T
    in_crop = inverse * torch.outer(scaled, scaled) + torch.diag((floors * units) ** 2)
    slopes = _photograph_slopes(pose, crop, size)
    covariance: Tensor = slopes @ in_crop @ slopes.T
    if crop.axis is None:
        covariance[_DISTANCE], covariance[:, _DISTANCE] = 0, 0
        covariance[_DISTANCE, _DISTANCE] = math.inf
    return covariance


def _photograph_slopes(pose: Tensor, crop: ObjectCrop, size: Sequence[int]) -> Tensor:
    """(6, 6): derivatives of the pose in the photograph by that in the crop, (6,)."""
    columns = []
    for step in _STEP * torch.eye(len(pose), dtype=pose.dtype):
        after, before = (crop.place_in_photograph(moved, *size)[0] for moved in (pose + step, pose - step))
        columns.append((after - before) / (2 * _STEP))
    return torch.stack(columns, 1)


def position_covariance(covariance: Tensor, distance: float, ray: Tensor, focal: float) -> Tensor:
    """The covariance (3, 3) of the object's origin along the camera's axes, in units of the mesh.

    Args:
        covariance: (6, 6) of the pose.
        distance: to the object's origin, units of the mesh.
        ray: (3,), to the image of the origin, of depth 1.
        focal: focal length, pixels.
    """
    length = ray.norm()
    direction = ray / length
    across = (torch.eye(3, dtype=ray.dtype) - torch.outer(direction, direction)) * (distance / focal / length)
    slopes = torch.stack([direction, across[:, 0], across[:, 1]], 1)  # by distance, x and y
    places = torch.tensor([2, 4, 5])
    in_space: Tensor = slopes @ covariance[places][:, places] @ slopes.T
    return in_space
