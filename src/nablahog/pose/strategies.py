"""The searches by name: from a photograph and candidate models to the model and pose of highest similarity."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import torch
from torch import Tensor

from ..optimize import lbfgs
from .canvas import DISTANCE
from .matching import Kind, Model, Photograph
from .placing import place
from .search import UNITS, Hill, climb, consensus, momentum, summits, turn_table
from .similarity import Similarity

Search: TypeAlias = Literal["best", "paper", "exhaustive"]
Ascent: TypeAlias = Literal["hill", "momentum", "lbfgs"]

VIEWS = 48  # of the coarse search around an object
ELEVATIONS = (0.0, 15.0, 30.0, 45.0)  # where nothing is known of it, degrees
EVERY_DEGREE = 360
PAPER_STARTS = 8  # azimuths all around, beside the initial one
_STARTS = 3  # at most, views of the coarse search to climb from
_NEARLY = 0.75  # of the best view's similarity: others that reach so much may yet turn out to be the one
_RIVAL = 0.85  # of the best view's similarity, after tilting
_AROUND = 15.0  # degrees from where the models agree
_TURNS, _TILTS = (-6.0, -3.0, 0.0, 3.0, 6.0), (-10.0, -5.0, 0.0, 5.0, 10.0)  # degrees of azimuth and in the image plane
_ASCENT_STEPS = 30


@dataclass(frozen=True, eq=False)
class Path:
    """A search from one start.

    Attributes:
        model: the model's name.
        azimuths: on the way, degrees.
        similarities: there.
    """

    model: str
    azimuths: tuple[float, ...]
    similarities: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Found:
    """A pose (6,) on the canvas of a model, what has been paid for it, and how it was found."""

    model: str
    pose: Tensor
    value: float
    kind: Kind
    renderings: int
    paths: tuple[Path, ...] = ()


@dataclass(frozen=True, eq=False)
class Task:
    photograph: Photograph
    models: Mapping[str, Model]
    initial: tuple[float, float] | None
    similarity: Kind | None
    ascent: Ascent
    generator: torch.Generator
    progress: Callable[[int, int, str], None]

    def each_model(self) -> Iterator[tuple[str, Model]]:
        """The models by name, one after the other."""
        for done, (name, model) in enumerate(self.models.items()):
            self.progress(done, len(self.models), name)
            yield name, model

    def views(self, model: Model, azimuth: float, elevation: float, count: int) -> Tensor:
        """``count`` views around from an azimuth, (count, 6), each placed so that it fills the box."""
        canvas = self.photograph.canvas
        start = torch.tensor([azimuth, elevation, DISTANCE, 0, 0, 0], dtype=torch.float64)
        return place(turn_table(start, count), model.hull, canvas.camera, canvas.size)

    def tilted(self, model: Model, pose: Tensor) -> Tensor:
        """A view (6,) with the azimuths between it and its neighbours, each turned in the image plane, too, (N, 6).

        The two are hard to tell apart: seen from above, either moves the top of an object across its foot.
        """
        canvas = self.photograph.canvas
        poses = pose.repeat(len(_TILTS) * len(_TURNS), 1)
        poses[:, [0, 3]] += torch.cartesian_prod(torch.tensor(_TURNS), torch.tensor(_TILTS))
        return place(poses, model.hull, canvas.camera, canvas.size)

    @property
    def elevations(self) -> tuple[float, ...]:
        return ELEVATIONS if self.initial is None else (self.initial[1],)


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


def _best(task: Task) -> Found:
    kind = task.similarity or "calibrated"
    template = task.photograph.template(kind)
    starts, azimuths, all_values = [], [], []
    renderings = 0
    for name, model in task.each_model():
        similarity = model.similarity(template)
        for elevation in task.elevations:
            views = task.views(model, 0.0, elevation, VIEWS)
            values = similarity.values(views)
            for k in summits(values, _STARTS):
                value = float(values[k])
                starts.append(_Start(value, name, views[k], ((float(views[k, 0]), value),)))
            azimuths.append(views[:, 0])
            all_values.append(values)
        renderings += similarity.renderings
    support = torch.zeros(360)
    if len(task.models) > 1 and kind == "calibrated":
        # one wrong model may fit anywhere; where many fit is the object
        support = consensus(torch.cat(azimuths), torch.cat(all_values)).float()
    starts.sort(key=lambda start: -start.value)
    tried: list[_Start] = []
    for start in _promising(starts, int(support.argmax()) if support.any() else None):
        model = task.models[start.model]
        similarity = model.similarity(template)
        tilted = task.tilted(model, start.pose)
        values = similarity.values(tilted)
        value = float(values.max())
        tried.append(start.then(tilted[values.argmax()], value, value))
        renderings += similarity.renderings
    reached: list[_Start] = []
    rivals = _rivals(tried, support)
    for start in rivals:
        coarse = task.models[start.model].similarity(template)
        similarity = coarse if kind != "calibrated" else task.models[start.model].similarity(task.photograph.fine)
        pose = _ascend(similarity, start.pose, task)
        reached.append(start.then(pose, float(similarity.values(pose[None])), float(coarse.values(pose[None]))))
        renderings += coarse.renderings if similarity is coarse else coarse.renderings + similarity.renderings
    top = max(reached, key=lambda one: one.value + float(support[int(one.pose[0]) % 360]))
    paths = [one.path() for one in [*reached, *(one for one in tried if one not in rivals)]]
    return Found(top.model, top.pose, top.value, kind, renderings, tuple(paths))


def _rivals(tried: Sequence[_Start], support: Tensor) -> list[_Start]:
    """The best of those tried, and the best from elsewhere if it is nearly as good: front and back look much alike."""
    order = sorted(tried, key=lambda one: -one.value - float(support[int(one.pose[0]) % 360]))
    best = order[0]
    others = [
        one
        for one in order[1:]
        if abs(float(one.pose[0] - best.pose[0] + 180) % 360 - 180) > _AROUND and one.value >= _RIVAL * best.value
    ]
    return [best, *others[:1]]


def _promising(starts: Sequence[_Start], agreed: int | None) -> list[_Start]:
    """The best of ``starts``, the best first, and the best near an azimuth, if models agree on one."""
    chosen = [start for start in starts[:_STARTS] if start is starts[0] or start.value >= _NEARLY * starts[0].value]
    if agreed is not None:
        near = [start for start in starts if abs((float(start.pose[0]) - agreed + 180) % 360 - 180) <= _AROUND]
        chosen += [start for start in near[:_STARTS] if start not in chosen]
    return chosen


def _ascend(similarity: Similarity, pose: Tensor, task: Task) -> Tensor:
    if task.ascent == "hill":
        return climb(similarity, pose, Hill(), task.generator)
    if task.ascent == "momentum":
        return momentum(similarity, pose[None], steps=_ASCENT_STEPS, every=1)[0][0]

    def objective(points: Tensor, index: Tensor) -> tuple[Tensor, Tensor]:
        values, slopes = similarity.derivatives(pose + points * UNITS)
        return -values, -slopes * UNITS

    found = lbfgs(objective, torch.zeros_like(pose)[None], max_evaluations=_ASCENT_STEPS, first_step=0.3)
    return pose + found.x[0] * UNITS


def _paper(task: Task) -> Found:
    kind = task.similarity or "dot"
    template = task.photograph.template(kind)
    azimuth, elevation = task.initial or (0.0, ELEVATIONS[1])
    best, paths, renderings = [], [], 0
    for name, model in task.each_model():
        similarity = model.similarity(template, "opendr")
        starts = torch.cat([task.views(model, azimuth, elevation, 1), task.views(model, 0.0, elevation, PAPER_STARTS)])
        poses, values, path = momentum(similarity, starts)
        top = int(values.argmax())
        best.append((float(values[top]), name, poses[top]))
        paths += [Path(name, tuple(one[:, 0].tolist()), tuple(one[:, 1].tolist())) for one in path.unbind(1)]
        renderings += similarity.renderings
    value, name, pose = max(best, key=lambda one: one[0])
    return Found(name, pose, value, kind, renderings, tuple(paths))


def _exhaustive(task: Task) -> Found:
    kind = task.similarity or "calibrated"
    template = task.photograph.template(kind)
    best, renderings = [], 0
    for name, model in task.each_model():
        similarity = model.similarity(template)
        for elevation in task.elevations:
            views = task.views(model, 0.0, elevation, EVERY_DEGREE)
            values = similarity.values(views)
            top = int(values.argmax())
            best.append((float(values[top]), name, views[top]))
        renderings += similarity.renderings
    value, name, pose = max(best, key=lambda one: one[0])
    return Found(name, pose, value, kind, renderings)


SEARCHES = {"best": _best, "paper": _paper, "exhaustive": _exhaustive}
