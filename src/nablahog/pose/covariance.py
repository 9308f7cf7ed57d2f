"""The covariance of a pose, from the curvature of the similarity at its maximum (Laplace's approximation).

The calibrated similarity s is the score of a matched filter, in standard deviations over arbitrary photographs: the
logarithm of the likelihood of a pose is s²/2, whose Hessian at the maximum is s times that of s.  The covariance is
minus its inverse, but for factors near 1, one for each parameter, and floors.  These were fitted to scenes of known
models, so that 68 % of the true parameters are within one standard deviation.  They stand for what the curvature does
not show: the light, the look of the renderer, cells and pixels, and an assumed focal length.

It is conditional on the pose being the right one.  How likely that is, is the confidence.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from ..render import PARAMETERS
from .ascent import UNITS
from .crop import DISTANCE, ObjectCrop


class Scales(NamedTuple):
    """Of standard deviations in a crop, by parameter."""

    factors: Tensor  # (6,) of the standard deviations by the curvature
    floors: Tensor  # (6,) in :data:`.ascent.UNITS`, added to them in squares


def _scales(factors: tuple[float, ...], floors: tuple[float, ...]) -> Scales:
    return Scales(*(torch.tensor(numbers, dtype=torch.float64) for numbers in (factors, floors)))


KNOWN_FOCAL = _scales((0.95, 0.8, 1.25, 0.85, 0.65, 0.75), (0.12, 0.1, 0.12, 0.06, 0.08, 0.08))
ASSUMED_FOCAL = _scales((1.15, 1.05, 0.0, 1.08, 0.88, 1.1), (0.12, 0.1, 0.0, 0.06, 0.08, 0.08))
_FLATTEST = 0.1  # smallest curvature along an axis, as a fraction of the largest: a fit to jags may show less
_AZIMUTH, _ELEVATION, _DISTANCE, _THETA = map(PARAMETERS.index, ("azimuth", "elevation", "distance", "theta"))
_FROM_ABOVE = 2.0  # variance of the line of sight across the elevation, relative to that along it
_LEAST_COSINE = 0.01  # of elevations: at a pole nothing bounds the azimuth
_FAR = 0.7  # exponent of the distance in the factor of its standard deviation, beyond :data:`.crop.DISTANCE`
_STEP = 1e-3  # pixels, of central differences of a smooth map


def pose_covariance(
    similarity: float, hessian: Tensor, pose: Tensor, crop: ObjectCrop, size: Sequence[int], *, any_azimuth: bool
) -> Tensor:
    """The covariance (6, 6), float64, of a pose in a photograph.

    Args:
        similarity: calibrated, at its maximum.
        hessian: (6, 6) of the similarity there, per degree, unit and pixel of the crop.
        pose: (6,) at the maximum, for the crop.
        crop: of the photograph; its focal length is known if its axis is.
        size: height and width of the photograph, pixels.
        any_azimuth: whether the model looks the same from all around.

    Returns:
        Of azimuth, elevation, distance, theta, x and y in degrees, units of the mesh and pixels of the photograph.
        What is unknown has an infinite variance, and its covariances are 0: the distance where the focal length is
        assumed, and any azimuth.
    """
    factors, floors = ASSUMED_FOCAL if crop.axis is None else KNOWN_FOCAL
    units = UNITS.clone()
    relative = pose[_DISTANCE] / DISTANCE
    units[_DISTANCE] *= relative
    scaled = units * factors
    scaled[_DISTANCE] *= max(1.0, float(relative)) ** _FAR  # the steps of the ascent are absolute
    bends, axes = torch.linalg.eigh(-max(similarity, 1.0) * hessian * torch.outer(units, units))
    bends = bends.clamp(min=_FLATTEST * max(float(bends.abs().max()), 1e-9))
    inverse = (axes / bends) @ axes.T
    in_crop = inverse * torch.outer(scaled, scaled) + torch.diag((floors * units) ** 2)
    in_crop += _variance_from_above(in_crop, float(pose[_ELEVATION]))
    slopes = _photograph_slopes(pose, crop, size)
    covariance: Tensor = slopes @ in_crop @ slopes.T
    for parameter, unknown in ((_AZIMUTH, any_azimuth), (_DISTANCE, crop.axis is None)):
        if unknown:
            covariance[parameter], covariance[:, parameter] = 0, 0
            covariance[parameter, parameter] = math.inf
    return covariance


def _variance_from_above(covariance: Tensor, elevation: float) -> Tensor:
    """What turns of azimuth that a turn in the image plane undoes add to a covariance, (6, 6).

    Together they move the line of sight by cos(elevation) of a turn, as much as an error of elevation may, so the
    variance of azimuth grows as that of elevation / cos².  Up to 45° the curvature shows it.
    """
    sine, cosine = math.sin(math.radians(elevation)), math.cos(math.radians(elevation))
    turn = covariance.new_zeros(len(covariance))
    turn[_AZIMUTH], turn[_THETA] = 1, sine
    excess = _FROM_ABOVE * max(0.0, (sine / max(cosine, _LEAST_COSINE)) ** 2 - 1)
    added: Tensor = excess * covariance[_ELEVATION, _ELEVATION] * torch.outer(turn, turn)
    return added


def _photograph_slopes(pose: Tensor, crop: ObjectCrop, size: Sequence[int]) -> Tensor:
    """(6, 6): derivatives of the pose in the photograph by that in the crop, (6,), of which only x and y bend."""
    slopes = torch.eye(len(pose), dtype=pose.dtype)
    for place in (PARAMETERS.index("x"), PARAMETERS.index("y")):
        step = torch.zeros_like(pose)
        step[place] = _STEP
        after, before = (crop.place_in_photograph(moved, *size)[0] for moved in (pose + step, pose - step))
        slopes[:, place] = (after - before) / (2 * _STEP)
    return slopes


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
    across = (torch.eye(3, dtype=ray.dtype, device="cpu") - torch.outer(direction, direction)) * (
        distance / focal / length
    )
    slopes = torch.stack([direction, across[:, 0], across[:, 1]], 1)  # by distance, x and y
    places = [PARAMETERS.index(name) for name in ("distance", "x", "y")]
    in_space: Tensor = slopes @ covariance[places][:, places] @ slopes.T
    return in_space
