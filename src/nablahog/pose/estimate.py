"""estimate_pose(): from an object in a photograph and models of it to azimuth, elevation and distance (Section 3.2)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import torch
from torch import Tensor

from ..optimize import lbfgs
from ..render import Camera, Mesh
from .canvas import DISTANCE, Box, cut_out
from .matching import Kind, Model, Photograph, model_of
from .placing import place
from .search import UNITS, Hill, climb, momentum, summits, turn_table
from .similarity import Similarity
from .whitening import Background

Search: TypeAlias = Literal["best", "paper", "exhaustive"]
Ascent: TypeAlias = Literal["hill", "momentum", "lbfgs"]

VIEWS = 48  # of the coarse search around an object
ELEVATIONS = (0.0, 15.0, 30.0, 45.0)  # where nothing is known of it, degrees
EVERY_DEGREE = 360
PAPER_STARTS = 8  # azimuths all around, beside the initial one
_STARTS = 3  # views of the coarse search to climb from
_COARSE, _FINE = Hill(rounds=2, samples=16), Hill(rounds=3, samples=16, spread=0.5)
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
class PoseEstimate:
    """The pose found.

    Attributes:
        azimuth, elevation, theta: degrees; azimuth in 0…360.
        distance: units of the mesh.
        x, y: pixels of the photograph, from its middle to where the object's origin would be seen at theta 0.
        camera: that these are meant for; it sees the whole photograph.
        model: the name of the model that fits best.
        similarity: of its rendering to the photograph, as ``similarity_kind`` has it.
        similarity_kind: see :mod:`.similarity`.
        on_canvas: (6,): the same pose for the canvas, see :func:`.canvas.cut_out`.
        renderings: that the search has made.
        paths: of the searches from all starts, if the method keeps them.
    """

    azimuth: float
    elevation: float
    distance: float
    theta: float
    x: float
    y: float
    camera: Camera
    model: str
    similarity: float
    similarity_kind: Kind
    on_canvas: Tensor
    renderings: int
    paths: tuple[Path, ...] = field(default=(), repr=False)

    @property
    def pose(self) -> Tensor:
        """(1, 6), to render it with ``camera``."""
        values = (self.azimuth, self.elevation, self.distance, self.theta, self.x, self.y)
        return torch.tensor([values], dtype=torch.float64)


@dataclass(frozen=True, eq=False)
class _Found:
    """A pose (6,) on the canvas of a model, what has been paid for it, and how it was found."""

    model: str
    pose: Tensor
    value: float
    kind: Kind
    renderings: int
    paths: tuple[Path, ...] = ()


def estimate_pose(
    photograph: Tensor,
    models: Mesh | Mapping[str, Mesh],
    *,
    box: Box | None = None,
    initial: tuple[float, float] | None = None,
    method: Search = "best",
    similarity: Kind | None = None,
    ascent: Ascent = "hill",
    background: Background | None = None,
    seed: int = 0,
) -> PoseEstimate:
    """The pose at which a rendering of a model has the HOG most like the photograph's.

    Args:
        photograph: (C, H, W), float in 0…1, one channel or R, G, B.
        models: normalised meshes by name, or one mesh; all are tried, the best is returned.
        box: of the object, x0, y0, x1, y1 in pixels; by default the whole photograph.
        initial: azimuth and elevation to begin at, degrees; by default unknown.
        method: ``"best"``: views all around at the initial elevation (or at several, if unknown), then an ascent over
            all six parameters from the best of them, at last with smaller cells.  ``"paper"``: visual elements of the
            photograph, OpenDR's derivatives, momentum over azimuth and every few steps over distance, from the initial
            pose and 8 azimuths around.  ``"exhaustive"``: every degree of azimuth at the initial elevation.
        similarity: ``"dot"``, ``"whitened"`` or ``"calibrated"``, see :mod:`.similarity`; by default ``"dot"`` for the
            paper's method and ``"calibrated"`` for the others.
        ascent: of ``"best"``: ``"hill"``, fits of a quadratic to samples, see :func:`.search.climb`; ``"momentum"`` and
            ``"lbfgs"`` follow single derivatives.
        background: of the coarse descriptor, which also says which descriptor that is; by default that of
            :func:`.matching.pose_spec`, learned from photographs that come with scikit-image.
        seed: of what is sampled.

    Returns:
        The pose for the photograph, with the camera it is meant for.  Its distance goes with that camera's lens: how
        strong the perspective was, a photograph of one object hardly tells.

    Raises:
        ValueError: the photograph, the box, the models or an option is none of the above.
    """
    named = {"": models} if isinstance(models, Mesh) else dict(models)
    if not named:
        raise ValueError("expected at least one model, got none")
    if method not in _SEARCHES:
        raise ValueError(f"method must be one of {', '.join(map(repr, _SEARCHES))}, got {method!r}")
    if ascent not in ("hill", "momentum", "lbfgs"):
        raise ValueError(f"ascent must be 'hill', 'momentum' or 'lbfgs', got {ascent!r}")
    if similarity not in (None, "dot", "whitened", "calibrated"):
        raise ValueError(f"similarity must be 'dot', 'whitened' or 'calibrated', got {similarity!r}")
    if initial is not None and not (all(map(math.isfinite, initial)) and -90 <= initial[1] <= 90):
        raise ValueError(f"initial must be a finite azimuth and an elevation in -90…90, got {initial}")
    height, width = photograph.shape[-2:]
    canvas = cut_out(photograph, box or (0.0, 0.0, float(width), float(height)))
    task = _Task(
        Photograph(canvas, background),
        {name: model_of(mesh, canvas.camera) for name, mesh in named.items()},
        initial,
        similarity,
        ascent,
        torch.Generator().manual_seed(seed),
    )
    found = _SEARCHES[method](task)
    pose, camera = canvas.in_photograph(found.pose, height, width)
    values = pose.tolist()
    return PoseEstimate(
        azimuth=values[0] % 360,
        elevation=values[1],
        distance=values[2],
        theta=values[3],
        x=values[4],
        y=values[5],
        camera=camera,
        model=found.model,
        similarity=found.value,
        similarity_kind=found.kind,
        on_canvas=found.pose,
        renderings=found.renderings,
        paths=found.paths,
    )


@dataclass(frozen=True, eq=False)
class _Task:
    photograph: Photograph
    models: Mapping[str, Model]
    initial: tuple[float, float] | None
    similarity: Kind | None
    ascent: Ascent
    generator: torch.Generator

    def views(self, model: Model, azimuth: float, elevation: float, count: int) -> Tensor:
        """``count`` views around from an azimuth, (count, 6), each placed so that it fills the box."""
        canvas = self.photograph.canvas
        start = torch.tensor([azimuth, elevation, DISTANCE, 0, 0, 0], dtype=torch.float64)
        return place(turn_table(start, count), model.hull, canvas.camera, canvas.size)

    @property
    def elevations(self) -> tuple[float, ...]:
        return ELEVATIONS if self.initial is None else (self.initial[1],)


def _best(task: _Task) -> _Found:
    kind = task.similarity or "calibrated"
    template = task.photograph.template(kind)
    starts = []
    renderings = 0
    for name, model in task.models.items():
        similarity = model.similarity(template)
        for elevation in task.elevations:
            views = task.views(model, 0.0, elevation, VIEWS)
            values = similarity.values(views)
            starts += [(float(values[k]), name, views[k]) for k in summits(values, _STARTS)]
        renderings += similarity.renderings
    starts.sort(key=lambda start: -start[0])
    reached = []
    for _, name, view in starts[:_STARTS]:
        similarity = task.models[name].similarity(template)
        pose = _ascend(similarity, view, _COARSE, task)
        reached.append((float(similarity.values(pose[None])), name, pose))
        renderings += similarity.renderings
    value, name, pose = max(reached, key=lambda one: one[0])
    if kind == "calibrated":
        similarity = task.models[name].similarity(task.photograph.fine)
        pose = _ascend(similarity, pose, _FINE, task)
        value = float(similarity.values(pose[None]))
        renderings += similarity.renderings
    return _Found(name, pose, value, kind, renderings)


def _ascend(similarity: Similarity, pose: Tensor, hill: Hill, task: _Task) -> Tensor:
    if task.ascent == "hill":
        return climb(similarity, pose, hill, task.generator)
    if task.ascent == "momentum":
        return momentum(similarity, pose[None], steps=_ASCENT_STEPS, every=1)[0][0]

    def objective(points: Tensor, index: Tensor) -> tuple[Tensor, Tensor]:
        values, slopes = similarity.derivatives(pose + points * UNITS)
        return -values, -slopes * UNITS

    found = lbfgs(objective, torch.zeros_like(pose)[None], max_evaluations=_ASCENT_STEPS, first_step=0.3)
    return pose + found.x[0] * UNITS


def _paper(task: _Task) -> _Found:
    kind = task.similarity or "dot"
    template = task.photograph.template(kind)
    azimuth, elevation = task.initial or (0.0, ELEVATIONS[1])
    best, paths, renderings = [], [], 0
    for name, model in task.models.items():
        similarity = model.similarity(template, "opendr")
        starts = torch.cat(
            [task.views(model, azimuth, elevation, 1), task.views(model, 0.0, elevation, PAPER_STARTS)]
        )
        poses, values, path = momentum(similarity, starts)
        top = int(values.argmax())
        best.append((float(values[top]), name, poses[top]))
        paths += [Path(name, tuple(one[:, 0].tolist()), tuple(one[:, 1].tolist())) for one in path.unbind(1)]
        renderings += similarity.renderings
    value, name, pose = max(best, key=lambda one: one[0])
    return _Found(name, pose, value, kind, renderings, tuple(paths))


def _exhaustive(task: _Task) -> _Found:
    kind = task.similarity or "calibrated"
    template = task.photograph.template(kind)
    best, renderings = [], 0
    for name, model in task.models.items():
        similarity = model.similarity(template)
        for elevation in task.elevations:
            views = task.views(model, 0.0, elevation, EVERY_DEGREE)
            values = similarity.values(views)
            top = int(values.argmax())
            best.append((float(values[top]), name, views[top]))
        renderings += similarity.renderings
    value, name, pose = max(best, key=lambda one: one[0])
    return _Found(name, pose, value, kind, renderings)


_SEARCHES = {"best": _best, "paper": _paper, "exhaustive": _exhaustive}
