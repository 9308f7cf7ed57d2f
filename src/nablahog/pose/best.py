"""The best search by name: views all around, the best of them tilted, and a hill climbed from the best of these."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from ..optimize import lbfgs
from .gallery import VIEWS, around, azimuths
from .hill import HILL, climb
from .matching import DETAIL, Model
from .placing import place
from .search import UNITS, consensus, momentum, summits
from .similarity import Similarity, Template
from .task import Found, Path, Task

_STARTS = 4  # views of a model, at most, to go on with
_NEARLY = 0.75  # of the best view's similarity: others that reach so much may yet turn out to be the one
_RIVAL = 0.8  # of the best view's similarity, after tilting
_CROWD = 36  # views of several models that are tilted
_CLIMBED = 2  # of these
_AROUND = 15.0  # degrees: views that are closer look at the object from the same side
_TURNS, _TILTS = (-5.0, 0.0, 5.0), (-10.0, -5.0, 0.0, 5.0, 10.0)  # degrees of azimuth and in the image plane
_ASCENT_STEPS = 30


@dataclass(frozen=True, eq=False)
class _Start:
    """A pose (6,) of a model, how similar it is, and azimuths with similarities on the way there."""

    value: float
    model: str
    pose: Tensor
    way: tuple[tuple[float, float], ...] = ()

    def then(self, pose: Tensor, value: float, coarse: float) -> _Start:
        """A better pose, with its similarity and that of the coarse descriptor."""
        return _Start(value, self.model, pose, (*self.way, (float(pose[0]), coarse)))

    def path(self) -> Path:
        azimuths, similarities = zip(*self.way, strict=True)
        return Path(self.model, azimuths, similarities)


def best(task: Task) -> Found:
    """A coarse search over azimuths, and an ascent over all parameters from the best of them.

    The calibrated similarity has finer cells in the end.  It is what several models are compared by: one wrong model
    may fit anywhere; where many fit is the object.
    """
    kind = task.similarity or "calibrated"
    template = task.photograph.template(kind)
    finer = task.photograph.fine if kind == "calibrated" else template
    crowd = len(task.models) > 1 and kind == "calibrated"
    starts, renderings = _look_around(task, template)
    tried: list[_Start] = []
    for start in starts[:_CROWD] if crowd else _promising(starts):
        similarity, fine = _similarities(task.models[start.model], template, finer)
        tilted = _tilted(task, start)
        values = similarity.values(tilted)
        pose, value = tilted[values.argmax()], float(values.max())
        tried.append(start.then(pose, float(fine.values(pose[None])) if crowd else value, value))
        renderings += similarity.renderings + fine.renderings
    reached: list[_Start] = []
    chosen = _agreed(tried) if crowd else _rivals(tried)
    for start in chosen:
        similarity, fine = _similarities(task.models[start.model], template, finer)
        pose = _ascend(fine, start.pose, task)
        reached.append(start.then(pose, float(fine.values(pose[None])), float(similarity.values(pose[None]))))
        renderings += similarity.renderings + fine.renderings
    top = max(reached, key=lambda one: one.value)
    paths = [one.path() for one in [*reached, *(one for one in tried if one not in chosen)]]
    return Found(top.model, top.pose, top.value, kind, renderings, tuple(paths))


def _similarities(model: Model, template: Template, finer: Template) -> tuple[Similarity, Similarity]:
    """To look around by, and to climb by."""
    return model.similarity(template, detail=DETAIL), model.similarity(finer, detail=DETAIL)


def _look_around(task: Task, template: Template) -> tuple[list[_Start], int]:
    """The best views of each model at each elevation, the best of all first, and how many were looked at."""
    starts: list[_Start] = []
    looked = 0
    for name, model in task.each_model():
        for elevation in task.elevations:
            if template.whitener is None:  # an object of another size has another similarity
                views = task.views(model, azimuths(), elevation)
                values = model.similarity(template, detail=DETAIL).values(views)
            else:
                values = around(model, template, elevation)
            best = summits(values, _STARTS)
            for view, value in zip(task.views(model, azimuths()[best], elevation), values[best].tolist(), strict=True):
                starts.append(_Start(value, name, view, ((float(view[0]), value),)))
            looked += VIEWS
    return sorted(starts, key=lambda start: -start.value), looked


def _tilted(task: Task, start: _Start) -> Tensor:
    """A view with the azimuths between it and its neighbours, each turned in the image plane, too, (N, 6).

    The two are hard to tell apart: seen from above, either moves the top of an object across its foot.
    """
    poses = start.pose.repeat(len(_TILTS) * len(_TURNS), 1)
    poses[:, [0, 3]] += torch.cartesian_prod(torch.tensor(_TURNS), torch.tensor(_TILTS))
    canvas = task.photograph.canvas
    return place(poses, task.models[start.model].hull, canvas.camera, canvas.size)


def _promising(starts: Sequence[_Start]) -> list[_Start]:
    """The first of ``starts``, which are the best first, and others that are nearly as good."""
    best, *others = starts[:_STARTS]
    return [best, *(start for start in others if start.value >= _NEARLY * best.value)]


def _agreed(tried: Sequence[_Start]) -> list[_Start]:
    """The best of those tried around the azimuth that most of them speak for, with a rival of the same model: its own
    poses can be compared as those of different models cannot."""
    support = consensus(torch.stack([one.pose[0] for one in tried]), torch.tensor([one.value for one in tried]))
    middle = float(support.argmax())
    near = [one for one in tried if _apart(float(one.pose[0]), middle) <= _AROUND]
    best = sorted(near, key=lambda one: -one.value)[:_CLIMBED]
    return [*best, *_rival(best[0], [one for one in tried if one.model == best[0].model and one not in best])]


def _rivals(tried: Sequence[_Start]) -> list[_Start]:
    """The best of those tried, with a rival."""
    best = max(tried, key=lambda one: one.value)
    return [best, *_rival(best, tried)]


def _rival(best: _Start, others: Sequence[_Start]) -> list[_Start]:
    """The best from elsewhere, if it is nearly as good: front and back look much alike."""
    elsewhere = [one for one in others if _apart(float(one.pose[0]), float(best.pose[0])) > _AROUND]
    found = max(elsewhere, key=lambda one: one.value, default=best)
    return [found] if found is not best and found.value >= _RIVAL * best.value else []


def _apart(one: float, other: float) -> float:
    """Degrees between azimuths."""
    return abs((one - other + 180) % 360 - 180)


def _ascend(similarity: Similarity, pose: Tensor, task: Task) -> Tensor:
    if task.ascent == "hill":
        return climb(similarity, pose, HILL, task.generator)
    if task.ascent == "momentum":
        return momentum(similarity, pose[None], steps=_ASCENT_STEPS, every=1)[0][0]

    def objective(points: Tensor, index: Tensor) -> tuple[Tensor, Tensor]:
        values, slopes = similarity.derivatives(pose + points * UNITS)
        return -values, -slopes * UNITS

    found = lbfgs(objective, torch.zeros_like(pose)[None], max_evaluations=_ASCENT_STEPS, first_step=0.3)
    return pose + found.x[0] * UNITS
