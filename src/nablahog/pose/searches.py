"""The searches by name: from a photograph and candidate models to the model and pose of highest similarity."""

from __future__ import annotations

from collections.abc import Callable

import torch

from .coarse_to_fine import coarse_to_fine
from .gradient_ascent import momentum_ascent
from .options import SearchMethod
from .placement import equidistant_azimuths
from .prepared import DETAIL
from .problem import ELEVATIONS, PoseProblem, SearchResult, SearchTrace

EVERY_DEGREE = 360
PAPER_STARTS = 8  # azimuths all around, beside the initial one


def _paper(problem: PoseProblem) -> SearchResult:
    kind = problem.similarity or "dot"
    template = problem.photograph.template(kind)
    azimuth, elevation = problem.initial or (0.0, ELEVATIONS[1])
    azimuths = torch.cat([equidistant_azimuths(1, azimuth), equidistant_azimuths(PAPER_STARTS)])
    best, traces, renderings = [], [], 0
    for name, model in problem.each_model():
        similarity = model.similarity(template, "opendr")
        poses, values, path = momentum_ascent(similarity, problem.level_views(model, azimuths, elevation))
        top = int(values.argmax())
        best.append((float(values[top]), name, poses[top]))
        traces += [SearchTrace(name, tuple(one[:, 0].tolist()), tuple(one[:, 1].tolist())) for one in path.unbind(1)]
        renderings += similarity.renderings
    value, name, pose = max(best, key=lambda one: one[0])
    return SearchResult(name, pose, value, kind, renderings, tuple(traces))


def _exhaustive(problem: PoseProblem) -> SearchResult:
    kind = problem.similarity or "calibrated"
    template = problem.photograph.template(kind)
    best, renderings = [], 0
    for name, model in problem.each_model():
        similarity = model.similarity(template, detail=DETAIL)
        for elevation in problem.elevations:
            poses = problem.level_views(model, equidistant_azimuths(EVERY_DEGREE), elevation)
            values = similarity.values(poses)
            top = int(values.argmax())
            best.append((float(values[top]), name, poses[top]))
        renderings += similarity.renderings
    value, name, pose = max(best, key=lambda one: one[0])
    return SearchResult(name, pose, value, kind, renderings)


SEARCHES: dict[SearchMethod, Callable[[PoseProblem], SearchResult]] = {
    "best": coarse_to_fine,
    "paper": _paper,
    "exhaustive": _exhaustive,
}
