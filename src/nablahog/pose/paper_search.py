"""The paper's search, gradient ascent with momentum over azimuth, and the exhaustive one that it is compared with."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import torch
from torch import Tensor

from ..render import PARAMETERS
from ..render.renderer import Method
from .ascent import UNITS
from .fit_box import equidistant_azimuths
from .model import DETAIL
from .options import SearchMethod, SearchTrace
from .pose_estimate import PoseEstimate
from .problem import ELEVATIONS, PoseProblem
from .similarity import Similarity

EVERY_DEGREE = 360
STARTS = 8  # azimuths all around, beside the initial one
LEARNING_RATE = 2.0
RENDERERS: dict[SearchMethod, tuple[Method, int]] = {"paper": ("opendr", 1), "paper-edges": ("edges", 2)}
"""How the paper's methods differentiate renderings, and with how many samples along the side of a pixel."""


def paper_search(problem: PoseProblem, *, method: SearchMethod) -> PoseEstimate:
    """Momentum from the initial pose and azimuths around, with the renderer of one of the paper's methods."""
    kind = problem.similarity or "patches"
    template = problem.photograph.template(kind)
    azimuth, elevation = problem.initial or (0.0, ELEVATIONS[1])
    azimuths = torch.cat([equidistant_azimuths(1, azimuth), equidistant_azimuths(STARTS)])
    best, traces, renderings = [], [], 0
    for name, model in problem.each_model():
        similarity = model.similarity(template, *RENDERERS[method], camera=problem.photograph.crop.camera)
        starts = problem.level_views(model, azimuths, elevation)
        poses, values, path = momentum_ascent(similarity, starts, visit=partial(problem.watch, name))
        top = int(values.argmax())
        best.append((float(values[top]), name, poses[top]))
        traces += [SearchTrace(name, tuple(one[:, 0].tolist()), tuple(one[:, 1].tolist())) for one in path.unbind(1)]
        renderings += similarity.renderings
    value, name, pose = max(best, key=lambda one: one[0])
    return problem.estimate(
        name, pose, similarity=value, similarity_kind=kind, renderings=renderings, traces=tuple(traces)
    )


def exhaustive_search(problem: PoseProblem) -> PoseEstimate:
    """The best of all whole degrees of azimuth at the elevations to search at."""
    kind = problem.similarity or "calibrated"
    template = problem.photograph.template(kind)
    best, renderings = [], 0
    for name, model in problem.each_model():
        similarity = model.similarity(template, detail=DETAIL, camera=problem.photograph.crop.camera)
        for elevation in problem.elevations:
            poses = problem.level_views(model, equidistant_azimuths(EVERY_DEGREE), elevation)
            values = similarity.values(poses)
            top = int(values.argmax())
            best.append((float(values[top]), name, poses[top]))
        renderings += similarity.renderings
    value, name, pose = max(best, key=lambda one: one[0])
    return problem.estimate(name, pose, similarity=value, similarity_kind=kind, renderings=renderings)


def momentum_ascent(
    similarity: Similarity,
    poses: Tensor,
    *,
    steps: int = 50,
    learning_rate: float = LEARNING_RATE,
    momentum: float = 0.9,
    distance_every: int = 4,
    visit: Callable[[Tensor], None] = lambda pose: None,
) -> tuple[Tensor, Tensor, Tensor]:
    """The paper's search: gradient ascent with momentum over azimuth, and every few steps over distance.

    The paper gives no rates.  Here the similarity is divided by that of each start, so that one rate serves all images,
    and the derivatives are taken in :data:`.ascent.UNITS`.

    Args:
        similarity: to be maximised.
        poses: (B, 6), the starts, all in one batch; angles in degrees.
        steps: gradient steps.
        learning_rate: of the steps.
        momentum: share of the velocity that remains after a step.
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
        free[0] = 1
        if step % distance_every == distance_every - 1:
            free[2] = 1
        velocity = torch.where(free > 0, momentum * velocity + learning_rate * slopes * UNITS / scale, velocity)
        poses = poses + free * velocity * UNITS
        poses[:, 2] = poses[:, 2].clamp(min=1.0)
    return best, best_value, torch.stack(path)
