"""Views all around an object, what many of them say, and the paper's search from there."""

from __future__ import annotations

import torch
from torch import Tensor

from ..render import PARAMETERS
from .similarity import Similarity

UNITS = torch.tensor([3.0, 3.0, 0.06, 3.0, 1.5, 1.5], dtype=torch.float64)
"""Steps of the parameters that change a picture of a hundred pixels about as much: 3°, 3°, 2 % of the distance, …"""

_SURE = 0.8  # of calibrated similarity: a view that has so much less counts a factor e less
_BLUR = 8.0  # degrees


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
