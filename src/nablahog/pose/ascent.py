"""Ascents over poses: the paper's, with momentum, and one by quadratic fits to samples, to a fraction of a degree.

Similarity is jagged below a degree: the descriptor jumps a little whenever an edge passes a sample of a pixel, so that
even the true derivative points uphill only on average, and ascent along single derivatives gets stuck.  A quadratic
fitted to many values and derivatives at once follows the smooth function under the jags.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from ..render import PARAMETERS
from .similarity import Similarity

UNITS = torch.tensor([3.0, 3.0, 0.06, 3.0, 1.5, 1.5], dtype=torch.float64)
"""Steps of the parameters that change a picture of 100 pixels about equally: 3°, 3°, 2 % of the distance, …"""

# A quadratic c + bᵀu + ½ uᵀAu is a sum over pairs of the numbers (1, u); its coefficients are c, b and A's upper half.
_FIRST, _SECOND = np.triu_indices(1 + len(PARAMETERS))
_FACTORS = np.where((_FIRST == _SECOND) & (_FIRST > 0), 0.5, 1.0)
_UNIT = np.eye(1 + len(PARAMETERS))
_DERIVATIVES = _FACTORS * (_UNIT[:, None, _FIRST] * _UNIT[1:, _SECOND] + _UNIT[:, None, _SECOND] * _UNIT[1:, _FIRST])
_VALUE_WEIGHT = 8.0  # weight of a value relative to that of a derivative: jags are steep, but not high
_SLOPE_WEIGHTS = 1 / np.square([0.94, 0.93, 0.64, 1.5, 1.15, 1.0])  # weights of derivatives, by their errors in UNITS
_STIFFNESS = 0.05  # weight of a prior of 0 on second derivatives, relative to that of a derivative
_FLATTEST = 0.15  # smallest curvature along an axis, as a fraction of the largest
_LONGEST_STEP = 2.0  # longest step, in spreads
_FAR_STEP = 0.99 * _LONGEST_STEP  # a step that was cut: the maximum may be farther


@dataclass(frozen=True, eq=False)
class SearchTrace:
    """The poses that a search from one start went through.

    Attributes:
        model: the model's name.
        azimuths: degrees, in order, of any turn.
        similarities: at these poses.
    """

    model: str
    azimuths: tuple[float, ...]
    similarities: tuple[float, ...]


class Maximum(NamedTuple):
    """The maximum of the quadratic that was fitted last."""

    pose: Tensor  # (6,), float64, angles in degrees
    hessian: Tensor  # (6, 6), float64: second derivatives of the similarity, per degree, unit and pixel


class Round(NamedTuple):
    """Renderings around a pose, before it is moved."""

    samples: int  # their number, even
    spread: float  # root mean square of their offsets, in :data:`UNITS`
    slopes: bool  # whether to use their derivatives; without, a round takes two thirds of the time


SCHEDULE = (
    Round(4, 0.8, slopes=True),
    Round(4, 0.7, slopes=True),
    Round(4, 0.6, slopes=True),
    Round(12, 0.6, slopes=False),
    Round(12, 0.6, slopes=False),
)
"""Slopes show the curvature early; values locate the maximum better in the end."""


def quadratic_ascent(
    similarity: Similarity,
    pose: Tensor,
    rounds: Sequence[Round],
    generator: torch.Generator,
    visit: Callable[[Tensor], None] = lambda pose: None,
    bounded: Callable[[Tensor], Tensor] = lambda poses: poses,
    *,
    repeats: int = 0,
) -> Maximum:
    """The maximum of a quadratic that is fitted again after each round of samples.

    Samples come in pairs on both sides of the pose, which fits value and slope there independently, and along
    orthogonal directions, which covers all parameters with few samples.  Samples of earlier rounds have less weight
    the farther they are from the present pose.

    Args:
        similarity: to be maximised.
        pose: (6,), float64, the start, angles in degrees.
        rounds: of samples, at least one.
        generator: of the directions.
        visit: called with the pose (6,) after each round.
        bounded: moves poses (N, 6) into the range allowed.
        repeats: how often, at most, rounds with slopes are done again because their step was cut.
    """
    most = sum(round_.samples for round_ in rounds) + repeats * max(round_.samples for round_ in rounds)
    directions = _draw_directions(most // 2, generator)
    poses, samples = pose.new_empty(0, len(pose)), pose.new_empty(0, 1 + len(pose))
    hessian = pose.new_zeros(len(pose), len(pose))
    pending = list(rounds)
    while pending:
        count, spread, slopes = pending[0]
        unit = spread * UNITS
        half, directions = directions[: count // 2], directions[count // 2 :]
        sampled = pose + torch.cat([half, -half]) * unit
        poses, samples = torch.cat([poses, sampled]), torch.cat([samples, _sample(similarity, sampled, slopes)])
        offsets = (poses - pose) / unit
        beyond = (offsets.square().mean(1).sqrt() - 1).clamp(min=0)
        weights = torch.exp(-0.5 * beyond**2)
        offset, curvature = _fit_maximum(offsets, samples[:, 0], samples[:, 1:] * unit, weights)
        pose, hessian = pose + unit * offset, curvature / torch.outer(unit, unit)
        pose = bounded(pose[None])[0]
        visit(pose)
        if slopes and repeats and float(offset.norm()) > _FAR_STEP:
            repeats -= 1
        else:
            pending.pop(0)
    return Maximum(pose, hessian)


def _sample(similarity: Similarity, poses: Tensor, slopes: bool) -> Tensor:
    """Values and derivatives (N, 7) at poses (N, 6); derivatives are NaN unless asked for."""
    if slopes:
        values, derivatives = similarity.derivatives(poses)
        return torch.cat([values[:, None], derivatives], 1)
    return functional.pad(similarity.values(poses)[:, None], (0, len(PARAMETERS)), value=math.nan)


def _draw_directions(count: int, generator: torch.Generator) -> Tensor:
    """Offsets (count, 6) of root mean square 1, orthogonal within each group of six."""
    size = len(PARAMETERS)
    normal = torch.randn((math.ceil(count / size), size, size), generator=generator, dtype=torch.float64)
    directions: Tensor = math.sqrt(size) * torch.linalg.qr(normal).Q.reshape(-1, size)[:count]
    return directions


def _fit_maximum(offsets: Tensor, values: Tensor, slopes: Tensor, weights: Tensor) -> tuple[Tensor, Tensor]:
    """Offset (6,) of the maximum and Hessian A (6, 6) of c + bᵀu + ½ uᵀAu, fitted by weighted least squares.

    Offsets u are (N, 6), values and weights (N,), slopes (N, 6), NaN where unknown.  For the offset, curvatures are
    made negative, at least :data:`_FLATTEST` of the largest, and the step is cut to :data:`_LONGEST_STEP`.
    """
    numbers = functional.pad(offsets, (1, 0), value=1.0).numpy()  # (1, u)
    known = ~np.isnan(slopes[:, 0].numpy())
    known_slopes, pose_weights = slopes.numpy()[known], weights.numpy()
    # makes the weights of values and slopes comparable
    scale = max(np.sqrt(np.square(known_slopes).mean()), 1e-12) if known.any() else 1.0
    slope_terms = (numbers[known] @ _DERIVATIVES.reshape(len(_UNIT), -1)).reshape(-1, len(_FIRST))
    terms = np.concatenate([_FACTORS * numbers[:, _FIRST] * numbers[:, _SECOND], slope_terms])
    row_weights = np.concatenate([_VALUE_WEIGHT * pose_weights, np.outer(pose_weights[known], _SLOPE_WEIGHTS).ravel()])
    weighted = row_weights[:, np.newaxis] * terms
    targets = np.concatenate([values.numpy(), known_slopes.ravel()]) / scale
    stiff = np.where(_FIRST > 0, _STIFFNESS, 0) + 1e-9
    quadratic = np.empty_like(_UNIT)
    quadratic[_FIRST, _SECOND] = np.linalg.solve(weighted.T @ terms + np.diag(stiff), weighted.T @ targets)
    gradient, hessian = quadratic[0, 1:], np.triu(quadratic[1:, 1:])
    hessian += np.triu(hessian, 1).T
    bends, axes = np.linalg.eigh(hessian, UPLO="U")
    bends = np.minimum(bends, -_FLATTEST * max(np.abs(bends).max(), 1e-9))
    step = -axes @ ((axes.T @ gradient) / bends)
    step *= _LONGEST_STEP / max(float(np.linalg.norm(step)), _LONGEST_STEP)
    return torch.from_numpy(step), torch.from_numpy(scale * hessian)


def momentum_ascent(
    similarity: Similarity,
    poses: Tensor,
    *,
    steps: int = 50,
    learning_rate: float = 2.0,
    momentum: float = 0.9,
    distance_every: int = 4,
    visit: Callable[[Tensor], None] = lambda pose: None,
) -> tuple[Tensor, Tensor, Tensor]:
    """The paper's search: gradient ascent with momentum over azimuth, and every few steps over distance.

    The paper gives no rates.  Here the similarity is divided by that of each start, so that one rate serves all images,
    and the derivatives are taken in :data:`UNITS`.

    Args:
        similarity: to be maximised.
        poses: (B, 6), the starts, all in one batch; angles in degrees.
        steps, learning_rate, momentum: of the gradient steps; momentum is the share of the velocity that remains.
        distance_every: steps from one that moves the distance to the next.
        visit: called with the most similar pose (6,) of each step.

    Returns:
        The best pose of each path (B, 6), its similarity (B,), and azimuths and similarities along the paths
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
        visit(poses[values.argmax()])
        free = torch.zeros(len(PARAMETERS), dtype=poses.dtype)
        free[0], free[2] = 1, step % distance_every == distance_every - 1
        velocity = torch.where(free > 0, momentum * velocity + learning_rate * slopes * UNITS / scale, velocity)
        poses = poses + free * velocity * UNITS
        poses[:, 2] = poses[:, 2].clamp(min=1.0)
    return best, best_value, torch.stack(path)
