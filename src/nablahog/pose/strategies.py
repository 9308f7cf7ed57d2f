"""The searches by name: from a photograph and candidate models to the model and pose of highest similarity."""

from __future__ import annotations

import torch

from .best import best
from .gallery import azimuths
from .matching import DETAIL
from .search import momentum
from .task import ELEVATIONS, Found, Path, Task

EVERY_DEGREE = 360
PAPER_STARTS = 8  # azimuths all around, beside the initial one


def _paper(task: Task) -> Found:
    kind = task.similarity or "dot"
    template = task.photograph.template(kind)
    azimuth, elevation = task.initial or (0.0, ELEVATIONS[1])
    tops, paths, renderings = [], [], 0
    for name, model in task.each_model():
        similarity = model.similarity(template, "opendr")
        starts = task.views(model, torch.cat([azimuths(1, azimuth), azimuths(PAPER_STARTS)]), elevation)
        poses, values, path = momentum(similarity, starts)
        top = int(values.argmax())
        tops.append((float(values[top]), name, poses[top]))
        paths += [Path(name, tuple(one[:, 0].tolist()), tuple(one[:, 1].tolist())) for one in path.unbind(1)]
        renderings += similarity.renderings
    value, name, pose = max(tops, key=lambda one: one[0])
    return Found(name, pose, value, kind, renderings, tuple(paths))


def _exhaustive(task: Task) -> Found:
    kind = task.similarity or "calibrated"
    template = task.photograph.template(kind)
    tops, renderings = [], 0
    for name, model in task.each_model():
        similarity = model.similarity(template, detail=DETAIL)
        for elevation in task.elevations:
            views = task.views(model, azimuths(EVERY_DEGREE), elevation)
            values = similarity.values(views)
            top = int(values.argmax())
            tops.append((float(values[top]), name, views[top]))
        renderings += similarity.renderings
    value, name, pose = max(tops, key=lambda one: one[0])
    return Found(name, pose, value, kind, renderings)


SEARCHES = {"best": best, "paper": _paper, "exhaustive": _exhaustive}
