"""The default search: views all around, the best of them tilted, and an ascent from the best of these."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property, partial
from threading import Lock

import torch
from torch import Tensor

from ..hog.box import Box
from ..runtime.pytorch import in_threads
from .ascent import SCHEDULE, Round, quadratic_ascent
from .model import (
    DETAIL,
    VIEW_COUNT,
    PreparedModel,
    bounding_boxes,
    equidistant_azimuths,
    equivalent_azimuths,
    local_maxima,
    view_descriptors,
)
from .photograph import PreparedPhotograph
from .problem import PoseProblem
from .result import PoseEstimate
from .similarity import Similarity
from .surroundings import FOUND, ROUGH, Surroundings, describe_surroundings, find_views
from .viewpoint_prior import ViewpointPrior
from .vote import (
    Hypothesis,
    add_rival,
    azimuth_evidence,
    compare_shares,
    confidence,
    interpolate_evidence,
    mean_viewpoint,
    midway_azimuth,
    recognizes_models,
    runners_up,
    select_starts,
    sort_by_score,
    vote,
)

VOTERS = 36  # views of several models that are tilted and ascended from, inside the box and again around it
VOTING_SCHEDULE = SCHEDULE[:2]  # rounds of their ascents, enough to tell which side of the object they see
_SIDES = 4  # of the object that are voted for: the best one and the runners-up
_SAME_BOX = 0.85  # intersection over union from which on a view fills the box that was given
_STARTS = 4  # local maxima of a model's views, at most, that are tilted
_PROMISING_SHARE = 0.75  # of the best view's similarity: views above it may still turn out to be the best
_TURNS, _TILTS = (-5.0, 0.0, 5.0), (-10.0, -5.0, 0.0, 5.0, 10.0)  # degrees of azimuth and in the image plane
_ENOUGH_COARSE = 6.5  # coarse similarity of views that fill the given box, from which on no other boxes are searched
_ENOUGH_FINE = 8.0  # fine similarity from which on no further ascents are tried
_AVERAGED = 8  # best poses of the side with most votes, whose viewpoints are averaged


def best_search(problem: PoseProblem) -> PoseEstimate:
    """Searches views coarsely, tilts the best of them, and ascends over all parameters from the best of these.

    The calibrated similarity has smaller cells in the last step.  Of several models, poses vote for a side of the
    object first: a single wrong model may fit any side.
    """
    search = BestSearch(problem)
    tilted = search.tilt_each(search.select_promising(search.look_around()))
    if search.calibrated and max(hypothesis.similarity for hypothesis in tilted) < _ENOUGH_COARSE:
        tilted += search.tilt_each(search.select_promising(search.look_elsewhere()))
    return search.choose_by_vote(tilted) if search.voting else search.choose_best(tilted)


class BestSearch:
    """The steps of the search, their templates, and the number of renderings."""

    def __init__(self, problem: PoseProblem) -> None:
        self.problem = problem
        self.kind = problem.similarity or "calibrated"
        self.calibrated = self.kind == "calibrated"  # only then can poses be compared whatever box they fill
        self.voting = len(problem.models) > 1 and self.calibrated
        self.most_views = VOTERS if self.voting else _STARTS  # that are looked at closely
        self.renderings = 0
        self._lock = Lock()

    def choose_best(self, tilted: Sequence[Hypothesis]) -> PoseEstimate:
        """The best pose of a single model, or of a similarity for which there is no vote."""
        chosen = add_rival(tilted)
        refined = self.ascend_each(chosen)
        if self.calibrated:
            for start in select_starts(tilted, chosen):
                if max(hypothesis.similarity for hypothesis in refined) >= _ENOUGH_FINE:
                    break
                chosen.append(start)
                refined += self.ascend_each([start])
        best = max(refined, key=lambda hypothesis: hypothesis.score)
        traced = [*refined, *(hypothesis for hypothesis in tilted if hypothesis not in chosen)]
        return self._estimate(best, traced, compare_shares(best, refined, tilted), agreement=1.0)

    def choose_by_vote(self, tilted: Sequence[Hypothesis]) -> PoseEstimate:
        """The side on which poses of several models agree, and the best of these."""
        voters = self.ascend_each(tilted, VOTING_SCHEDULE)
        (on_side, share), *other_sides = vote(voters, _SIDES, self.azimuth_evidence(voters))
        chosen = on_side[:_AVERAGED]
        ascended = self.ascend_each(chosen)
        agreeing = sort_by_score(ascended)
        viewpoint = mean_viewpoint(agreeing)
        if self._prior is not None:
            log_probabilities = self._prior.log_probabilities(agreeing[0].place.crop.image)[0]
            viewpoint[0] = midway_azimuth(viewpoint[0], log_probabilities)
        best = self.view_from(viewpoint, agreeing[0])
        traced = [*ascended, *(hypothesis for hypothesis in voters if hypothesis not in chosen)]
        shares = [(other_share / share, poses[0]) for poses, other_share in other_sides]
        return self._estimate(best, traced, shares, agreement=share)

    def look_around(self) -> list[Hypothesis]:
        """The best views of all models at all elevations, at most :attr:`most_views`, the best first."""
        azimuths, penalties = equidistant_azimuths(VIEW_COUNT), self.problem.level_penalties
        found: list[tuple[float, float, str, float, Tensor]] = []
        for name, model in self.problem.each_model():
            for elevation in self.problem.elevations:
                values = self._view_similarities(model, elevation)
                values[~self.problem.allowed] = -torch.inf
                best = local_maxima(values, _STARTS)
                for value, azimuth in zip(values[best].tolist(), azimuths[best], strict=True):
                    found.append((value - penalties[elevation], value, name, elevation, azimuth))
                self.renderings += VIEW_COUNT
        finite = sorted((view for view in found if math.isfinite(view[0])), key=lambda view: -view[0])
        return [self._level_view(*view[1:]) for view in finite[: self.most_views]]

    def look_elsewhere(self) -> list[Hypothesis]:
        """The best views of all models that fill another box or are tilted, the best first."""
        found = []
        for name, model in self.problem.models.items():
            for place, around in self._surroundings:
                views = find_views(model, place, around, self.problem.elevations, self.problem.allowed, _STARTS)
                for pose, value in zip(views[0], views[1].tolist(), strict=True):
                    found.append((value - float(self.problem.penalty(pose[None], place)), value, name, place, pose))
        best = sorted(found, key=lambda view: -view[0])[: self.most_views]
        views_elsewhere = (self._reframed(*view[1:]) for view in best)
        return [view for view in views_elsewhere if view is not None]

    def select_promising(self, views: Sequence[Hypothesis]) -> Sequence[Hypothesis]:
        """Those ``views``, the best first, that are nearly as good as the best; all for a vote."""
        if self.voting or not views:
            return views
        least = views[0].score - (1 - _PROMISING_SHARE) * abs(views[0].score)
        return [view for view in views if view.score >= least]

    def tilt_each(self, views: Sequence[Hypothesis]) -> list[Hypothesis]:
        """The best of small turns of azimuth and in the image plane, of each view.

        The two are hard to tell apart: seen from above, either moves the top of an object across its foot.
        """
        similarities = [self._similarity(view, fine=False) for view in views]  # made before threads ask for them
        return in_threads(lambda k: self._tilt(views[k], similarities[k]), len(views))

    def ascend_each(self, starts: Sequence[Hypothesis], rounds: Sequence[Round] = SCHEDULE) -> list[Hypothesis]:
        """The highest similarity near each start, of any models, by rounds of quadratic ascents."""
        similarities = [self._similarity(start, fine=True) for start in starts]
        seeds = torch.randint(2**62, (len(starts),), generator=self.problem.generator).tolist()
        return in_threads(lambda k: self._ascend(starts[k], similarities[k], rounds, seeds[k]), len(starts))

    @cached_property
    def _prior(self) -> ViewpointPrior | None:
        """The viewpoint prior, if it knows the models."""
        prior = self.problem.viewpoints
        return prior if prior is not None and recognizes_models(prior, list(self.problem.models.values())) else None

    def azimuth_evidence(self, poses: Sequence[Hypothesis]) -> Tensor:
        """Logarithms of the probabilities of the poses' azimuths for any model, (N,)."""
        # in a crop of its own a pose would confirm itself
        places = list(dict.fromkeys(hypothesis.place for hypothesis in poses))
        models = list(self.problem.models.values())
        evidence = azimuth_evidence(models, places, self.problem.level_penalties, self._prior)
        rows = torch.tensor([places.index(hypothesis.place) for hypothesis in poses])
        azimuths = torch.tensor([hypothesis.azimuth for hypothesis in poses], dtype=torch.float64)
        return interpolate_evidence(evidence[rows], azimuths)

    def view_from(self, viewpoint: Tensor, start: Hypothesis) -> Hypothesis:
        """A pose at another azimuth, elevation and in-plane rotation, (3,), degrees."""
        pose = start.pose.clone()
        pose[[0, 1, 3]] = viewpoint
        pose = self.problem.limit_azimuths(pose[None])[0]
        return start.move(pose, self._value(start, pose, fine=True), self._value(start, pose, fine=False))

    def _estimate(
        self,
        best: Hypothesis,
        traced: Sequence[Hypothesis],
        shares: Sequence[tuple[float, Hypothesis]],
        *,
        agreement: float,
    ) -> PoseEstimate:
        """The estimate of the best pose, with its runners-up and its confidence."""
        with_views = self.problem.elevations
        elevation = min(with_views, key=lambda elevation: abs(elevation - float(best.pose[1])))
        same_view = equivalent_azimuths(self.problem.models[best.model], best.azimuth, elevation)
        others = runners_up(shares, best, same_view)
        rivals = tuple(self._as_estimate(hypothesis, share=share) for hypothesis, share in others)
        rival = rivals[0].share if rivals else 0.0
        lead = best.similarity - max((estimate.similarity for estimate in rivals), default=-math.inf)
        known = len(self.problem.models) == 1
        return self._as_estimate(
            best,
            traces=tuple(hypothesis.search_trace() for hypothesis in traced),
            runners_up=rivals,
            equivalent_azimuths=same_view,
            confidence=confidence(best.similarity, rival, lead, agreement, known_model=known)
            if self.calibrated
            else None,
        )

    def _as_estimate(self, hypothesis: Hypothesis, **attributes: object) -> PoseEstimate:
        pose = hypothesis.photograph.crop.convert_pose(hypothesis.pose, self.problem.photograph.crop)
        return self.problem.estimate(
            hypothesis.model,
            pose,
            similarity=hypothesis.similarity,
            similarity_kind=self.kind,
            renderings=self.renderings,
            **attributes,
        )

    @cached_property
    def _surroundings(self) -> list[tuple[PreparedPhotograph, Surroundings]]:
        """The crops of all boxes with their surroundings."""
        problem = self.problem
        photographs = [problem.photograph, *map(problem.crop_around, problem.other_boxes or ())]
        reach = ROUGH if problem.other_boxes is None else FOUND
        return [(crop, describe_surroundings(crop, problem.image, problem.tilts, reach)) for crop in photographs]

    def _view_similarities(self, model: PreparedModel, elevation: float) -> Tensor:
        """Similarities (VIEW_COUNT,) of views all around."""
        photograph = self.problem.photograph
        if self.calibrated:
            views = view_descriptors(model, elevation, photograph.own_background)
            return (views.flatten(1) @ photograph.calibrated.weights.flatten()).double()
        # without calibration the similarity depends on the size of the object
        poses = self.problem.level_views(model, equidistant_azimuths(VIEW_COUNT), elevation)
        return self._similarity_of(model, photograph, fine=False).values(poses)

    def _level_view(self, value: float, name: str, elevation: float, azimuth: Tensor) -> Hypothesis:
        (pose,) = self.problem.level_views(self.problem.models[name], azimuth[None], elevation)
        return self._hypothesis(value, name, pose, self.problem.photograph, self.problem.photograph)

    def _reframed(self, value: float, name: str, place: PreparedPhotograph, pose: Tensor) -> Hypothesis | None:
        """A view with the crop around it; None for level views that fill the given box, which are there already."""
        model, crop = self.problem.models[name], place.crop
        (box,) = bounding_boxes(pose[None], model.hull, crop.camera)
        if Box.of(box.tolist()).iou(crop.centred_box) >= _SAME_BOX:
            if pose[3] == 0 and place is self.problem.photograph:
                return None
            (pose,) = self.problem.fit(model, pose[None], place)
            return self._hypothesis(value, name, pose, place, place)
        other = self.problem.crop_around(crop.box_in_photograph(box))
        return self._hypothesis(value, name, crop.convert_pose(pose, other.crop), other, place)

    def _hypothesis(
        self, value: float, name: str, pose: Tensor, photograph: PreparedPhotograph, place: PreparedPhotograph
    ) -> Hypothesis:
        penalty = float(self.problem.penalty(pose[None], photograph))
        hypothesis = Hypothesis(value, name, pose, photograph, place, ((float(pose[0]), value),), penalty)
        self._watch(hypothesis, pose)
        return hypothesis

    def _tilt(self, view: Hypothesis, coarse: Similarity) -> Hypothesis:
        poses = view.pose.repeat(len(_TILTS) * len(_TURNS), 1)
        poses[:, [0, 3]] += torch.cartesian_prod(torch.tensor(_TURNS), torch.tensor(_TILTS))
        poses = self.problem.fit(self.problem.models[view.model], self.problem.limit_azimuths(poses), view.photograph)
        values = coarse.values(poses)
        self._count(len(poses))
        penalties = self.problem.penalty(poses, view.photograph)
        best = int((values - penalties).argmax())
        pose, value = poses[best], float(values[best])
        self._watch(view, pose)
        return view.move(pose, value, value, float(penalties[best]))

    def _ascend(self, start: Hypothesis, fine: Similarity, rounds: Sequence[Round], seed: int) -> Hypothesis:
        generator = torch.Generator().manual_seed(seed)
        watch = partial(self._watch, start)
        pose = quadratic_ascent(fine, start.pose, rounds, generator, watch, self.problem.limit_azimuths)
        value = float(fine.values(pose[None]))
        self._count(fine.renderings)
        penalty = float(self.problem.penalty(pose[None], start.photograph))
        return start.move(pose, value, self._value(start, pose, fine=False), penalty)

    def _watch(self, hypothesis: Hypothesis, pose: Tensor) -> None:
        crop = self.problem.photograph.crop
        with self._lock:
            self.problem.watch(hypothesis.model, hypothesis.photograph.crop.convert_pose(pose, crop))

    def _value(self, hypothesis: Hypothesis, pose: Tensor, *, fine: bool) -> float:
        self._count(1)
        return float(self._similarity(hypothesis, fine=fine).values(pose[None]))

    def _count(self, renderings: int) -> None:
        with self._lock:
            self.renderings += renderings

    def _similarity(self, hypothesis: Hypothesis, *, fine: bool) -> Similarity:
        return self._similarity_of(self.problem.models[hypothesis.model], hypothesis.photograph, fine=fine)

    def _similarity_of(self, model: PreparedModel, photograph: PreparedPhotograph, *, fine: bool) -> Similarity:
        """The similarity to a crop; only the calibrated kind has smaller cells in the last steps."""
        template = photograph.fine if fine and self.calibrated else photograph.template(self.kind)
        return model.similarity(template, detail=DETAIL, camera=photograph.crop.camera)
