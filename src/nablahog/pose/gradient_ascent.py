"""Ascents along single derivatives: the paper's, with momentum, and L-BFGS."""

from __future__ import annotations

import torch
from torch import Tensor

from ..optimize import lbfgs
from ..render import PARAMETERS
from .similarity import Similarity

UNITS = torch.tensor([3.0, 3.0, 0.06, 3.0, 1.5, 1.5], dtype=torch.float64)
"""Steps of the parameters that change a picture of a hundred pixels about as much: 3°, 3°, 2 % of the distance, …"""


def momentum_ascent(
    similarity: Similarity,
    poses: Tensor,
    *,
    steps: int = 50,
    learning_rate: float = 5.0,
    momentum: float = 0.9,
    distance_every: int = 4,
) -> tuple[Tensor, Tensor, Tensor]:
    """The paper's search: gradient ascent with momentum over azimuth, every few steps over the distance, too.

    The paper gives no rates.  Here the similarity is divided by that of each start, so that one rate serves all images,
    and the derivatives are taken in :data:`UNITS`.

    Args:
        similarity: to be maximised.
        poses: (B, 6), the starts, all in one batch; angles in degrees.
        steps: gradient steps.
        learning_rate: of the steps.
        momentum: share of the velocity that remains after a step.
        distance_every: steps from one that moves the distance to the next.

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
        free = torch.zeros(len(PARAMETERS), dtype=poses.dtype)
        free[0] = 1
        if step % distance_every == distance_every - 1:
            free[2] = 1
        velocity = torch.where(free > 0, momentum * velocity + learning_rate * slopes * UNITS / scale, velocity)
        poses = poses + free * velocity * UNITS
        poses[:, 2] = poses[:, 2].clamp(min=1.0)
    return best, best_value, torch.stack(path)


def lbfgs_ascent(similarity: Similarity, pose: Tensor, evaluations: int) -> Tensor:
    """The best pose (6,) of L-BFGS over all parameters from ``pose`` (6,) on."""

    def objective(points: Tensor, index: Tensor) -> tuple[Tensor, Tensor]:
        values, slopes = similarity.derivatives(pose + points * UNITS)
        return -values, -slopes * UNITS

    minimum = lbfgs(objective, torch.zeros_like(pose)[None], max_evaluations=evaluations, first_step=0.3)
    return pose + minimum.x[0] * UNITS
