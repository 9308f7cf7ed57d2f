"""The default search: views all around, the best of them tilted, and an ascent from the best of these."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial

import torch
from torch import Tensor

from ..hog import HOGSpec
from .ascent import SCHEDULE, lbfgs_ascent, momentum_ascent, quadratic_ascent
from .crop import FILL
from .placement import azimuth_distance, consensus, equidistant_azimuths, fit_to_box, level_poses, local_maxima
from .prepared import DETAIL, PreparedModel
from .problem import PoseProblem, SearchResult, SearchTrace
from .similarity import (
    ElementTemplate,
    Similarity,
    Template,
    describe,
    deviations,
    downsampled_poses,
    in_batches,
    white_background,
)
from .whitening import Whitener

VIEW_COUNT = 48  # azimuths around an object
ELEVATION_STEP = 5.0  # degrees between the elevations that there are views of
_CACHED = 512  # sets of views, of half a megabyte
_STARTS = 4  # local maxima of a model's views, at most, that are tilted
_NEARLY = 0.75  # of the best view's similarity: others that have as much may still turn out to be the best
_RIVAL = 0.8  # of the best view's similarity, after tilting
_VOTERS = 36  # views of several models that are tilted
_ASCENTS = 2  # from the best of these
_SAME_SIDE = 15.0  # degrees: views that are closer look at the object from the same side
_TURNS, _TILTS = (-5.0, 0.0, 5.0), (-10.0, -5.0, 0.0, 5.0, 10.0)  # degrees of azimuth and in the image plane
_ASCENT_STEPS = 30


@dataclass(frozen=True, eq=False)
class _Hypothesis:
    """A pose of a model with its similarity.

    Attributes:
        similarity: what hypotheses are ranked by.
        model: its name.
        pose: (6,).
        trace: azimuth and coarse similarity of the poses so far.
    """

    similarity: float
    model: str
    pose: Tensor
    trace: tuple[tuple[float, float], ...] = ()

    def refined(self, pose: Tensor, similarity: float, coarse: float) -> _Hypothesis:
        """A better pose, with its similarity and that of the coarse template."""
        return _Hypothesis(similarity, self.model, pose, (*self.trace, (float(pose[0]), coarse)))

    @property
    def azimuth(self) -> float:
        return float(self.pose[0])

    def search_trace(self) -> SearchTrace:
        azimuths, similarities = zip(*self.trace, strict=True)
        return SearchTrace(self.model, azimuths, similarities)


def coarse_to_fine(problem: PoseProblem) -> SearchResult:
    """Searches views coarsely, tilts the best of them, and ascends over all parameters from the best of these.

    The calibrated similarity has smaller cells in the last step.  Several models are compared by these: one wrong model
    may fit anywhere, so that views of all models vote for an azimuth first.
    """
    search = _Search(problem)
    views = search.look_around()
    tilted = [search.tilt(view) for view in (views[:_VOTERS] if search.voting else _promising(views))]
    chosen = _elected(tilted) if search.voting else _with_rival(tilted)
    refined = [search.ascend(hypothesis) for hypothesis in chosen]
    best = max(refined, key=lambda one: one.similarity)
    traces = [one.search_trace() for one in [*refined, *(one for one in tilted if one not in chosen)]]
    return SearchResult(best.model, best.pose, best.similarity, search.kind, search.renderings, tuple(traces))


class _Search:
    """The steps of the search, their templates, and the number of renderings."""

    def __init__(self, problem: PoseProblem) -> None:
        self.problem = problem
        self.kind = problem.similarity or "calibrated"
        self.coarse = problem.photograph.template(self.kind)
        self.fine: Template = problem.photograph.fine if self.kind == "calibrated" else self.coarse
        self.voting = len(problem.models) > 1 and self.kind == "calibrated"
        self.renderings = 0

    def look_around(self) -> list[_Hypothesis]:
        """The best views of each model at each elevation, the best of all first."""
        views: list[_Hypothesis] = []
        for name, model in self.problem.each_model():
            for elevation in self.problem.elevations:
                values = self._view_similarities(model, elevation)
                best = local_maxima(values, _STARTS)
                poses = self.problem.level_views(model, equidistant_azimuths(VIEW_COUNT)[best], elevation)
                for pose, value in zip(poses, values[best].tolist(), strict=True):
                    views.append(_Hypothesis(value, name, pose, ((float(pose[0]), value),)))
                    self.problem.watch(name, pose)
                self.renderings += VIEW_COUNT
        return sorted(views, key=lambda view: -view.similarity)

    def _view_similarities(self, model: PreparedModel, elevation: float) -> Tensor:
        if self.kind == "calibrated":
            return view_similarities(model, self.problem.photograph.calibrated, elevation)
        # without calibration an object of another size has another similarity
        poses = self.problem.level_views(model, equidistant_azimuths(VIEW_COUNT), elevation)
        return self._similarity(model, self.coarse).values(poses)

    def tilt(self, view: _Hypothesis) -> _Hypothesis:
        """The best of small turns of azimuth and in the image plane.

        The two are hard to tell apart: seen from above, either moves the top of an object across its foot.
        """
        model = self.problem.models[view.model]
        coarse = self._similarity(model, self.coarse)
        poses = view.pose.repeat(len(_TILTS) * len(_TURNS), 1)
        poses[:, [0, 3]] += torch.cartesian_prod(torch.tensor(_TURNS), torch.tensor(_TILTS))
        poses = self.problem.fit(model, poses)
        values = coarse.values(poses)
        self.renderings += len(poses)
        pose, value = poses[values.argmax()], float(values.max())
        self.problem.watch(view.model, pose)
        return view.refined(pose, self._value(model, self.fine, pose) if self.voting else value, value)

    def ascend(self, start: _Hypothesis) -> _Hypothesis:
        """The highest similarity near a start."""
        model = self.problem.models[start.model]
        fine = self._similarity(model, self.fine)
        pose = self._ascend(fine, start)
        value = float(fine.values(pose[None]))
        self.renderings += fine.renderings
        return start.refined(pose, value, self._value(model, self.coarse, pose))

    def _ascend(self, similarity: Similarity, start: _Hypothesis) -> Tensor:
        pose, visit = start.pose, partial(self.problem.watch, start.model)
        if self.problem.ascent == "quadratic":
            return quadratic_ascent(similarity, pose, SCHEDULE, self.problem.generator, visit)
        if self.problem.ascent == "momentum":
            return momentum_ascent(similarity, pose[None], steps=_ASCENT_STEPS, distance_every=1, visit=visit)[0][0]
        return lbfgs_ascent(similarity, pose, _ASCENT_STEPS)

    def _value(self, model: PreparedModel, template: Template, pose: Tensor) -> float:
        self.renderings += 1
        return float(self._similarity(model, template).values(pose[None]))

    @staticmethod
    def _similarity(model: PreparedModel, template: Template) -> Similarity:
        return model.similarity(template, detail=DETAIL)


def _promising(views: Sequence[_Hypothesis]) -> list[_Hypothesis]:
    """The first of ``views``, which are the best first, and others that are nearly as good."""
    best, *others = views[:_STARTS]
    return [best, *(view for view in others if view.similarity >= _NEARLY * best.similarity)]


def _elected(tilted: Sequence[_Hypothesis]) -> list[_Hypothesis]:
    """The best around the azimuth with most votes, with a rival of the same model.

    The poses of one model can be compared as those of different models cannot.
    """
    azimuths, similarities = torch.stack([one.pose[0] for one in tilted]), [one.similarity for one in tilted]
    elected = float(consensus(azimuths, torch.tensor(similarities)).argmax())
    near = [one for one in tilted if azimuth_distance(one.azimuth, elected) <= _SAME_SIDE]
    best = sorted(near, key=lambda one: -one.similarity)[:_ASCENTS]
    return [*best, *_rival(best[0], [one for one in tilted if one.model == best[0].model and one not in best])]


def _with_rival(tilted: Sequence[_Hypothesis]) -> list[_Hypothesis]:
    """The best, with a rival."""
    best = max(tilted, key=lambda one: one.similarity)
    return [best, *_rival(best, tilted)]


def _rival(best: _Hypothesis, others: Sequence[_Hypothesis]) -> list[_Hypothesis]:
    """The best from another side, if it is nearly as good: front and back look much alike."""
    elsewhere = [one for one in others if azimuth_distance(one.azimuth, best.azimuth) > _SAME_SIDE]
    rival = max(elsewhere, key=lambda one: one.similarity, default=best)
    return [rival] if rival is not best and rival.similarity >= _RIVAL * best.similarity else []


def view_similarities(model: PreparedModel, template: ElementTemplate, elevation: float) -> Tensor:
    """Calibrated similarities (VIEW_COUNT,) of a template to views of a model at about an elevation, degrees.

    The views fill the crop, instead of the box of an object, so that they do not depend on the photograph.
    """
    assert template.whitener is not None
    rounded = ELEVATION_STEP * round(elevation / ELEVATION_STEP)
    views = _view_descriptors(model, template.spec, template.whitener, template.shrink, rounded)
    return (views @ template.weights.flatten()).double()


@lru_cache(maxsize=_CACHED)
def _view_descriptors(model: PreparedModel, spec: HOGSpec, whitener: Whitener, shrink: int, elevation: float) -> Tensor:
    """Descriptors (VIEW_COUNT, N) of views, each divided by the standard deviation of its score over photographs."""
    poses = fit_to_box(level_poses(equidistant_azimuths(VIEW_COUNT), elevation), model.hull, model.camera, FILL)
    renderer = model.renderer(detail=DETAIL, shrink=shrink)
    compiled, background = renderer.compiled, white_background(renderer.camera)

    def describe_views(some: Tensor) -> Tensor:
        descriptors = describe(compiled.render(some, background, False).image[:, None], spec)
        return descriptors.flatten(1) / deviations(whitener.energies(descriptors))[:, None]

    return torch.cat(in_batches(describe_views, downsampled_poses(poses, shrink)))
