"""Finding the pose of highest similarity: from views all around to a fraction of a degree.

Similarity is jagged below a degree: each sample that an edge passes moves the descriptor, so that even its true
derivative points the right way only in the mean.  Ascent along single derivatives gets stuck; what is fitted here to
many values and derivatives at once is the smooth hill under the jags.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ..render import PARAMETERS
from .similarity import Similarity

UNITS = torch.tensor([3.0, 3.0, 0.06, 3.0, 1.5, 1.5], dtype=torch.float64)
"""Steps of the parameters that change a picture of a hundred pixels about as much: 3°, 3°, 2 % of the distance, …"""

_FIRST, _SECOND = np.triu_indices(len(PARAMETERS))  # the parameters of a quadratic's second-order coefficients
_COEFFICIENTS = 1 + len(PARAMETERS) + len(_FIRST)
_STIFFNESS = 0.05  # of second derivatives towards 0, against one value or derivative each
_FLATTEST = 0.15  # of the steepest curvature: the least that is believed
_REACH = 2.0  # of the spread: how far from its samples the hill is believed
_SURE = 0.8  # of calibrated similarity: a view that has so much less counts a factor e less
_BLUR = 8.0  # degrees


@dataclass(frozen=True)
class Hill:
    """A quadratic fitted around a pose: rounds of samples, each closer than the one before, which still count.

    Attributes:
        samples: new renderings of each round, even numbers.
        spread: root mean square of the first samples' parameters, in :data:`UNITS`.
        shrink: factor of the spread from round to round.
    """

    samples: tuple[int, ...] = (12, 8, 8)
    spread: float = 0.8
    shrink: float = 0.6


def turn_table(pose: Tensor, views: int) -> Tensor:
    """``views`` equidistant azimuths from a pose (6,), (views, 6)."""
    poses = pose.repeat(views, 1)
    poses[:, 0] += torch.arange(views, dtype=poses.dtype) * (360 / views)
    return poses


def summits(values: Tensor, count: int) -> Tensor:
    """Indices of the at most ``count`` highest local maxima on a circle of values (N,), the highest first."""
    highest = (values >= values.roll(1)) & (values >= values.roll(-1))
    found = highest.nonzero().squeeze(1)
    order: Tensor = found[values[found].argsort(descending=True)]
    return order[:count]


def consensus(azimuths: Tensor, values: Tensor) -> Tensor:
    """How much views of several models (N,) speak for each whole degree of azimuth, (360,), from their calibrated
    similarities."""
    weights = torch.exp((values - values.max()) / _SURE).to(azimuths)
    degrees = torch.arange(360, dtype=azimuths.dtype)
    apart = (degrees[:, None] - azimuths + 180) % 360 - 180
    return torch.exp(-0.5 * (apart / _BLUR) ** 2) @ weights


def climb(similarity: Similarity, pose: Tensor, hill: Hill, generator: torch.Generator) -> Tensor:
    """The top of the hill around ``pose`` (6,).

    Samples come in pairs on both sides of the pose, so that its own place and slope are fitted independently, and along
    directions at right angles, so that few of them say something about all.  Those of rounds before count the less the
    farther away they have turned out to be.
    """
    poses, values, slopes = pose.new_empty(0, len(pose)), pose.new_empty(0), pose.new_empty(0, len(pose))
    for number, count in enumerate(hill.samples):
        unit = hill.spread * hill.shrink**number * UNITS
        sampled = pose + _pairs(count, generator) * unit
        found = similarity.derivatives(sampled)
        poses, values, slopes = (
            torch.cat(both) for both in zip((poses, values, slopes), (sampled, *found), strict=True)
        )
        offsets = (poses - pose) / unit
        beyond = (offsets.square().mean(1).sqrt() - 1).clamp(min=0)
        pose = pose + unit * _top(offsets, values, slopes * unit, torch.exp(-0.5 * beyond**2))
    return pose


def _pairs(count: int, generator: torch.Generator) -> Tensor:
    """Offsets (count, 6) of root mean square 1, the second half opposite to the first, which is at right angles."""
    size = len(PARAMETERS)
    some = torch.randn((math.ceil(count / (2 * size)), size, size), generator=generator, dtype=torch.float64)
    half = math.sqrt(size) * torch.linalg.qr(some).Q.reshape(-1, size)[: count // 2]
    return torch.cat([half, -half])


def _top(offsets: Tensor, values: Tensor, slopes: Tensor, weights: Tensor) -> Tensor:
    """Where c + bᵀu + ½ uᵀAu is highest, fitted to values (N,) and slopes (N, 6) at offsets u (N, 6), weighted (N,)."""
    u, count, parameters = offsets.numpy(), *offsets.shape
    second_order = 1 + parameters + np.arange(len(_FIRST))
    rows = np.zeros((count, 1 + parameters, _COEFFICIENTS))  # of each sample: its value's, and its slope's
    rows[:, 0, 0] = 1
    rows[:, 0, 1 : 1 + parameters] = u
    rows[:, 0, second_order] = u[:, _FIRST] * u[:, _SECOND] * np.where(_FIRST == _SECOND, 0.5, 1)
    rows[:, 1 + np.arange(parameters), 1 + np.arange(parameters)] = 1
    rows[:, 1 + _FIRST, second_order] = u[:, _SECOND]
    rows[:, 1 + _SECOND, second_order] = u[:, _FIRST]
    scale = max(float(slopes.square().mean().sqrt()), 1e-12)
    right = torch.cat([values[:, None], slopes], 1).numpy() / scale
    weighted = (rows * weights.numpy()[:, None, None]).reshape(-1, _COEFFICIENTS)
    stiff = np.full(_COEFFICIENTS, 1e-9)
    stiff[second_order] += _STIFFNESS
    normal = weighted.T @ rows.reshape(-1, _COEFFICIENTS) + np.diag(stiff)
    found = np.linalg.solve(normal, weighted.T @ right.reshape(-1))
    curvature = np.zeros((parameters, parameters))
    curvature[_FIRST, _SECOND] = curvature[_SECOND, _FIRST] = found[second_order]
    bends, axes = np.linalg.eigh(curvature)
    bends = np.minimum(bends, -_FLATTEST * max(np.abs(bends).max(), 1e-9))
    way = -axes @ ((axes.T @ found[1 : 1 + parameters]) / bends)
    return torch.from_numpy(way * (_REACH / max(float(np.linalg.norm(way)), _REACH)))


def momentum(
    similarity: Similarity, poses: Tensor, *, steps: int = 50, rate: float = 5.0, kept: float = 0.9, every: int = 4
) -> tuple[Tensor, Tensor, Tensor]:
    """The paper's search: gradient ascent with momentum over azimuth, in every ``every``-th step over distance, too.

    The paper gives no rates.  Here the similarity is divided by that of each start, so that one rate serves all images,
    and the derivatives are taken in :data:`UNITS`.

    Args:
        similarity: to climb.
        poses: (B, 6), the starts, all in one batch.
        steps: gradient steps.
        rate: of the steps.
        kept: share of the velocity that each step keeps.
        every: how often distance takes part.

    Returns:
        The best pose of each path (B, 6), its similarity (B,), and the azimuths and similarities on the way
        (steps + 1, B, 2).
    """
    poses = poses.clone()
    velocity = torch.zeros_like(poses)
    scale = torch.ones(len(poses), 1, dtype=poses.dtype)
    best, best_value = poses.clone(), torch.full((len(poses),), -torch.inf, dtype=poses.dtype)
    path = []
    for step in range(steps + 1):
        values, slopes = similarity.derivatives(poses)
        if step == 0:
            scale = values.abs().clamp(min=1e-9)[:, None]
        better = values > best_value
        best[better], best_value[better] = poses[better], values[better]
        path.append(torch.stack([poses[:, 0], values], dim=1))
        free = torch.zeros(len(PARAMETERS), dtype=poses.dtype)
        free[0] = 1
        if step % every == every - 1:
            free[2] = 1
        pushed = kept * velocity + rate * slopes * UNITS / scale
        velocity = torch.where(free > 0, pushed, velocity)
        poses = poses + free * velocity * UNITS
        poses[:, 2] = poses[:, 2].clamp(min=1.0)
    return best, best_value, torch.stack(path)
