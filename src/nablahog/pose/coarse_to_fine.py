"""The default search: views all around, the best of them tilted, and an ascent from the best of these."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import torch
from torch import Tensor

from ..hog.box import Box
from .ascent import SCHEDULE, lbfgs_ascent, momentum_ascent, quadratic_ascent
from .candidates import candidates
from .confidence import Evidence
from .crop import ObjectCrop
from .placement import azimuth_distance, bounding_boxes, consensus, equidistant_azimuths, local_maxima
from .prepared import DETAIL, PreparedModel, PreparedPhotograph
from .problem import PoseProblem, RunnerUp, SearchResult, SearchTrace
from .pyramid import FOUND, ROUGH, Pyramid, pyramid
from .similarity import Similarity
from .symmetry import equivalent_azimuths
from .views import VIEW_COUNT, view_similarities

_SAME_BOX = 0.85  # intersection over union: a view whose box is as near fills the one given
_STARTS = 4  # local maxima of a model's views, at most, that are tilted
_NEARLY = 0.75  # of the best view's similarity: others that have as much may still turn out to be the best
_RIVAL = 0.8  # of the best view's similarity, after tilting
_VOTERS = 36  # views of several models that are tilted
_ASCENTS = 2  # from the best of these
_MORE_ASCENTS = 2  # where these come to little
_SURE = 6.5  # coarse similarity of views that fill the given box, from which on others are not searched
_SURE_AT_LAST = 8.0  # fine similarity, from which on no other ascents are tried
_RUNNERS_UP = 3  # poses from other sides that are kept
_SAME_SIDE = 15.0  # degrees: views that are closer look at the object from the same side
_TURNS, _TILTS = (-5.0, 0.0, 5.0), (-10.0, -5.0, 0.0, 5.0, 10.0)  # degrees of azimuth and in the image plane
_ASCENT_STEPS = 30


@dataclass(frozen=True, eq=False)
class _Hypothesis:
    """A pose of a model with its similarity.

    Attributes:
        similarity: what hypotheses are ranked by.
        model: its name.
        pose: (6,) for the crop.
        photograph: the crop around the object's box, or around a better one.
        trace: azimuth and coarse similarity of the poses so far.
    """

    similarity: float
    model: str
    pose: Tensor
    photograph: PreparedPhotograph
    trace: tuple[tuple[float, float], ...] = ()

    def refined(self, pose: Tensor, similarity: float, coarse: float) -> _Hypothesis:
        """A better pose, with its similarity and that of the coarse template."""
        return _Hypothesis(similarity, self.model, pose, self.photograph, (*self.trace, (float(pose[0]), coarse)))

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
    if search.searches_boxes and max(one.similarity for one in tilted) < _SURE:
        elsewhere = search.look_elsewhere()
        tilted += [search.tilt(view) for view in (elsewhere[:_VOTERS] if search.voting else _promising(elsewhere))]
    chosen = _elected(tilted) if search.voting else _with_rival(tilted)
    refined = [search.ascend(hypothesis) for hypothesis in chosen]
    if not search.voting and search.kind == "calibrated":
        for hypothesis in _others(tilted, chosen):
            if max(one.similarity for one in refined) >= _SURE_AT_LAST:
                break
            chosen.append(hypothesis)
            refined.append(search.ascend(hypothesis))
    best = max(refined, key=lambda one: one.similarity)
    traces = [one.search_trace() for one in [*refined, *(one for one in tilted if one not in chosen)]]
    elevation = min(problem.elevations, key=lambda each: abs(each - float(best.pose[1])))  # one with views
    same_view = equivalent_azimuths(problem.models[best.model], best.azimuth, elevation)
    runners_up = _runners_up(best, refined, tilted, same_view, problem.photograph.crop)
    evidence = None
    if search.kind == "calibrated":
        same = sum(azimuth_distance(one.azimuth, best.azimuth) <= _SAME_SIDE for one in tilted)
        agreement = same / len(tilted) if search.voting else 1.0
        evidence = Evidence(best.similarity, runners_up[0].share if runners_up else 0.0, agreement)
    pose = best.photograph.crop.converted(best.pose, problem.photograph.crop)
    return SearchResult(
        best.model,
        pose,
        best.similarity,
        search.kind,
        search.renderings,
        tuple(traces),
        runners_up,
        same_view,
        evidence,
    )


def _runners_up(
    best: _Hypothesis,
    refined: Sequence[_Hypothesis],
    tilted: Sequence[_Hypothesis],
    same_view: Sequence[float],
    crop: ObjectCrop,
) -> tuple[RunnerUp, ...]:
    """The best poses from sides that differ by more than the model's symmetry, for the crop, the best first.

    Of those that were not ascended from, similarities are compared with the highest before the ascents.
    """
    highest = max(one.similarity for one in tilted)
    shares = [(one.similarity / max(best.similarity, 1e-9), one) for one in refined if one is not best]
    started = [azimuth for one in refined for azimuth, _ in one.trace[:-1]]  # an ascent says more than its start
    shares += [
        (one.similarity / max(highest, 1e-9), one)
        for one in tilted
        if min(azimuth_distance(one.azimuth, azimuth) for azimuth in started) > 0
    ]
    sides = [best.azimuth, *same_view]
    found: list[RunnerUp] = []
    for share, one in sorted(shares, key=lambda each: -each[0]):
        if min(azimuth_distance(one.azimuth, side) for side in sides) > _SAME_SIDE:
            pose = one.photograph.crop.converted(one.pose, crop)
            found.append(RunnerUp(one.model, pose, min(max(share, 0.0), 1.0)))
            sides.append(one.azimuth)
    return tuple(found[:_RUNNERS_UP])


class _Search:
    """The steps of the search, their templates, and the number of renderings."""

    def __init__(self, problem: PoseProblem) -> None:
        self.problem = problem
        self.kind = problem.similarity or "calibrated"
        self.voting = len(problem.models) > 1 and self.kind == "calibrated"
        self.renderings = 0

    def look_around(self) -> list[_Hypothesis]:
        """The best views of each model at each elevation, the best of all first."""
        views: list[_Hypothesis] = []
        for name, model in self.problem.each_model():
            for elevation in self.problem.elevations:
                values = self._view_similarities(model, elevation)
                values[~self._allowed] = -torch.inf
                best = local_maxima(values, _STARTS)
                best = best[values[best].isfinite()]
                poses = self.problem.level_views(model, equidistant_azimuths(VIEW_COUNT)[best], elevation)
                for pose, value in zip(poses, values[best].tolist(), strict=True):
                    views.append(self._hypothesis(value, name, pose, self.problem.photograph))
                self.renderings += VIEW_COUNT
        return sorted(views, key=lambda view: -view.similarity)

    @cached_property
    def _allowed(self) -> Tensor:
        """Which of the views around a model are searched, (VIEW_COUNT,)."""
        return self.problem.allowed(equidistant_azimuths(VIEW_COUNT))

    @property
    def searches_boxes(self) -> bool:
        """Whether poses are compared whatever box they fill, which only the calibrated similarity allows."""
        return self.kind == "calibrated"

    def look_elsewhere(self) -> list[_Hypothesis]:
        """The best views that fill another box, or are tilted, the best of all first."""
        seen = [
            (value, name, photograph, pose)
            for name, model in self.problem.models.items()
            for photograph, around in self._pyramids
            for value, pose in self._around(model, photograph, around)
        ]
        best = sorted(seen, key=lambda one: -one[0])[: _VOTERS if self.voting else _STARTS]
        views = (self._reframed(*one) for one in best)
        return [view for view in views if view is not None]

    def _around(
        self, model: PreparedModel, photograph: PreparedPhotograph, around: Pyramid
    ) -> Iterator[tuple[float, Tensor]]:
        """Similarities of the best views of a model around a crop, and their poses for that."""
        found = candidates(model, photograph, around, self.problem.elevations, self._allowed, _STARTS)
        yield from zip(found.similarities.tolist(), found.poses, strict=True)

    def _reframed(self, value: float, name: str, photograph: PreparedPhotograph, pose: Tensor) -> _Hypothesis | None:
        """A view with the crop around it, unless it is there; None for views that fill the given box."""
        model, crop = self.problem.models[name], photograph.crop
        (box,) = bounding_boxes(pose[None], model.hull, crop.camera)
        if Box.of(box.tolist()).iou(crop.centred_box) >= _SAME_BOX:
            if pose[3] == 0 and photograph is self.problem.photograph:
                return None  # that view is there
            (pose,) = self.problem.fit(model, pose[None], photograph)
            return self._hypothesis(value, name, pose, photograph)
        other = self.problem.cropped(crop.box_in_photograph(box))
        return self._hypothesis(value, name, crop.converted(pose, other.crop), other)

    @cached_property
    def _pyramids(self) -> list[tuple[PreparedPhotograph, Pyramid]]:
        """Crops with what is around them."""
        problem = self.problem
        photographs = [problem.photograph, *map(problem.cropped, problem.boxes or ())]
        reach = ROUGH if problem.boxes is None else FOUND
        return [(one, pyramid(one, problem.image, problem.tilts, reach)) for one in photographs]

    def _hypothesis(self, value: float, name: str, pose: Tensor, photograph: PreparedPhotograph) -> _Hypothesis:
        hypothesis = _Hypothesis(value, name, pose, photograph, ((float(pose[0]), value),))
        self._watch(hypothesis, pose)
        return hypothesis

    def _watch(self, hypothesis: _Hypothesis, pose: Tensor) -> None:
        given = self.problem.photograph.crop
        self.problem.watch(hypothesis.model, hypothesis.photograph.crop.converted(pose, given))

    def _view_similarities(self, model: PreparedModel, elevation: float) -> Tensor:
        if self.kind == "calibrated":
            return view_similarities(model, self.problem.photograph.calibrated, elevation)
        # without calibration an object of another size has another similarity
        poses = self.problem.level_views(model, equidistant_azimuths(VIEW_COUNT), elevation)
        return self._similarity(model, self.problem.photograph, fine=False).values(poses)

    def tilt(self, view: _Hypothesis) -> _Hypothesis:
        """The best of small turns of azimuth and in the image plane.

        The two are hard to tell apart: seen from above, either moves the top of an object across its foot.
        """
        model = self.problem.models[view.model]
        coarse = self._similarity(model, view.photograph, fine=False)
        poses = view.pose.repeat(len(_TILTS) * len(_TURNS), 1)
        poses[:, [0, 3]] += torch.cartesian_prod(torch.tensor(_TURNS), torch.tensor(_TILTS))
        poses = self.problem.fit(model, poses, view.photograph)
        values = coarse.values(poses)
        self.renderings += len(poses)
        pose, value = poses[values.argmax()], float(values.max())
        self._watch(view, pose)
        return view.refined(pose, self._value(view, pose, fine=True) if self.voting else value, value)

    def ascend(self, start: _Hypothesis) -> _Hypothesis:
        """The highest similarity near a start."""
        fine = self._similarity(self.problem.models[start.model], start.photograph, fine=True)
        pose = self._ascend(fine, start)
        value = float(fine.values(pose[None]))
        self.renderings += fine.renderings
        return start.refined(pose, value, self._value(start, pose, fine=False))

    def _ascend(self, similarity: Similarity, start: _Hypothesis) -> Tensor:
        pose, visit = start.pose, partial(self._watch, start)
        if self.problem.ascent == "quadratic":
            return quadratic_ascent(similarity, pose, SCHEDULE, self.problem.generator, visit)
        if self.problem.ascent == "momentum":
            return momentum_ascent(similarity, pose[None], steps=_ASCENT_STEPS, distance_every=1, visit=visit)[0][0]
        return lbfgs_ascent(similarity, pose, _ASCENT_STEPS)

    def _value(self, of: _Hypothesis, pose: Tensor, *, fine: bool) -> float:
        self.renderings += 1
        model = self.problem.models[of.model]
        return float(self._similarity(model, of.photograph, fine=fine).values(pose[None]))

    def _similarity(self, model: PreparedModel, photograph: PreparedPhotograph, *, fine: bool) -> Similarity:
        """To a crop; of the kinds only the calibrated one has smaller cells in the last steps."""
        calibrated = self.kind == "calibrated"
        template = photograph.fine if fine and calibrated else photograph.template(self.kind)
        return model.similarity(template, detail=DETAIL, camera=photograph.crop.camera)


def _promising(views: Sequence[_Hypothesis]) -> list[_Hypothesis]:
    """The first of ``views``, which are the best first, and others that are nearly as good."""
    return [view for view in views[:_STARTS] if view.similarity >= _NEARLY * views[0].similarity]


def _others(tilted: Sequence[_Hypothesis], chosen: Sequence[_Hypothesis]) -> list[_Hypothesis]:
    """Further ones to ascend from where the chosen ones come to little: from other sides, the best first."""
    others: list[_Hypothesis] = []
    for one in sorted(tilted, key=lambda one: -one.similarity):
        sides = (azimuth_distance(one.azimuth, each.azimuth) for each in (*chosen, *others))
        if min(sides) > _SAME_SIDE and len(others) < _MORE_ASCENTS:
            others.append(one)
    return others


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
