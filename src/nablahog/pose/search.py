"""Finding the pose of highest similarity: from views all around to a fraction of a degree.

Similarity is jagged below a degree: each sample that an edge passes moves the descriptor, so that even its true
derivative points the right way only in the mean.  Ascent along single derivatives gets stuck; what is fitted here to
many values and derivatives at once is the smooth hill under the jags.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ..render import PARAMETERS
from .similarity import Similarity

UNITS = torch.tensor([3.0, 3.0, 0.06, 3.0, 1.5, 1.5], dtype=torch.float64)
"""Steps of the parameters that change a picture of a hundred pixels about as much: 3°, 3°, 2 % of the distance, …"""

_PAIRS = torch.triu_indices(len(PARAMETERS), len(PARAMETERS))
_COEFFICIENTS = 1 + len(PARAMETERS) + _PAIRS.shape[1]
_STIFFNESS = 0.05  # of second derivatives towards 0, against one value or derivative each
_FLATTEST = 0.15  # of the steepest curvature: the least that is believed
_REACH = 2.0  # of the spread: how far from its samples the hill is believed
_SURE = 0.8  # of calibrated similarity: a view that has so much less counts a factor e less
_BLUR = 8.0  # degrees


@dataclass(frozen=True)
class Hill:
    """A quadratic fitted around a pose: rounds of samples, each closer than the one before.

    Attributes:
        rounds: fits.
        samples: renderings of a fit, an even number.
        spread: standard deviation of the first samples, in :data:`UNITS`.
        shrink: factor of the spread from round to round.
    """

    rounds: int = 3
    samples: int = 16
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

    Samples come in pairs on both sides of the pose, so that its own place and slope are fitted independently.
    """
    for number in range(hill.rounds):
        spread = hill.spread * hill.shrink**number
        half = torch.randn((hill.samples // 2, len(PARAMETERS)), generator=generator, dtype=torch.float64)
        offsets = torch.cat([half, -half])
        values, slopes = similarity.derivatives(pose + spread * offsets * UNITS)
        pose = pose + spread * UNITS * _top(offsets, values, spread * slopes * UNITS)
    return pose


def _top(offsets: Tensor, values: Tensor, slopes: Tensor) -> Tensor:
    """Where c + bᵀu + ½ uᵀAu is highest, fitted to values (N,) and slopes (N, 6) at offsets u (N, 6)."""
    count, parameters = offsets.shape
    first, second = _PAIRS
    once = torch.where(first == second, 0.5, 1.0).double()
    of_values = torch.cat([offsets.new_ones(count, 1), offsets, offsets[:, first] * offsets[:, second] * once], 1)
    of_slopes = offsets.new_zeros(count, parameters, _COEFFICIENTS)
    of_slopes[:, torch.arange(parameters), 1 + torch.arange(parameters)] = 1
    number = 1 + parameters + torch.arange(len(first))
    of_slopes[:, first, number] += offsets[:, second]
    off = first != second
    of_slopes[:, second[off], number[off]] += offsets[:, first[off]]
    rows = torch.cat([of_values, of_slopes.reshape(-1, _COEFFICIENTS)])
    right = torch.cat([values, slopes.reshape(-1)])
    scale = slopes.square().mean().sqrt().clamp(min=1e-12)
    stiff = offsets.new_zeros(_COEFFICIENTS)
    stiff[1 + parameters :] = _STIFFNESS
    normal = rows.T @ rows + torch.diag(stiff + 1e-9)
    found = torch.linalg.solve(normal, rows.T @ (right / scale))
    curvature = offsets.new_zeros(parameters, parameters)
    curvature[first, second] = curvature[second, first] = found[1 + parameters :]
    bends, axes = torch.linalg.eigh(curvature)
    steepest = bends.abs().max().clamp(min=1e-9)
    bends = bends.clamp(max=-_FLATTEST * float(steepest))
    way: Tensor = -axes @ ((axes.T @ found[1 : 1 + parameters]) / bends)
    capped: Tensor = way * (_REACH / way.norm().clamp(min=_REACH))
    return capped


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
