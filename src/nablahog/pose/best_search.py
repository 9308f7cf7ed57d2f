"""The default search: views all around, coarse ascents from the best of them, fine ascents from the best of these."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property, partial
from threading import Lock

import torch
from torch import Tensor

from ..inputs.boxes import Box
from ..runtime.pytorch import in_threads
from .ascent import SCHEDULE, Round, quadratic_ascent
from .confidence import probabilities
from .evidence import gather_evidence
from .model import (
    DETAIL,
    VIEW_COUNT,
    PreparedModel,
    bounding_boxes,
    equidistant_azimuths,
    equivalent_azimuths,
    local_maxima,
    reverse_depth,
    view_descriptors,
)
from .photograph import PreparedPhotograph
from .problem import PoseProblem, wrap_angles, wrap_hessian
from .result import PoseEstimate
from .similarity import Similarity
from .surroundings import FOUND, ROUGH, describe_surroundings, find_views
from .viewpoint_prior import ViewpointPrior
from .vote import (
    Hypothesis,
    azimuth_evidence,
    compare_shares,
    interpolate_evidence,
    mean_viewpoint,
    midway_azimuth,
    recognizes_models,
    select_promising,
    select_runners_up,
    sort_by_score,
    vote,
)

VOTERS = 36  # views of several models that are tilted and ascended from, inside the box and again around it
SHORT_SCHEDULE = SCHEDULE[:2]  # rounds of short ascents, enough to tell which side of the object a pose sees
_VOTED_SIDES = 4  # of the object that are voted for: the best one and the runners-up
_SAME_BOX = 0.85  # intersection over union from which on a view fills the box that was given
_VIEW_MAXIMA = 4  # local maxima of a model's views, at most, from which a search goes on
_OTHER_VIEWS = 6  # of a single model, of another box or tilted: the right one is nearly always among them
_SHORT_ASCENTS, _CLIMBED_SHARE = 4, 0.6  # most short fine ascents of a single model, from the best coarse scores
_FULL_ASCENTS, _SHORT_SHARE = 2, 0.9  # most full ones, from the best ends of these; shares are of the best score
_REPEATS = 2  # of rounds of a full ascent that ended far away
COARSE_SCHEDULE = Round(4, 1.0, slopes=True), Round(4, 0.8, slopes=True)  # of ascents from views of a single model
_TURNS, _TILTS = (-5.0, 0.0, 5.0), (-10.0, -5.0, 0.0, 5.0, 10.0)  # degrees of azimuth and in the image plane
# coarse similarities near views that fill the given box, from which on no other boxes are searched
_ENOUGH_TILTED, _ENOUGH_CLIMBED = 6.5, 8.0
_AVERAGED = 8  # best poses of the side with most votes, whose viewpoints are averaged


def best_search(problem: PoseProblem) -> PoseEstimate:
    """Searches views coarsely, climbs a little from the best of them, and ascends from the best of these.

    All ascents are over all parameters; the calibrated similarity has smaller cells in the last ones.  Of several
    models, views are only tilted before poses vote for a side of the object: a single wrong model may fit any side.
    """
    search = BestSearch(problem)
    approach, enough = (search.tilt, _ENOUGH_TILTED) if search.voting else (search.climb, _ENOUGH_CLIMBED)
    found = approach(search.find_level_views())
    if search.calibrated and max(hypothesis.similarity for hypothesis in found) < enough:
        found += approach(search.find_other_views())
    return search.choose_by_vote(found) if search.voting else search.choose_best(found)


class BestSearch:
    """The steps of the search, and the similarities that they have used."""

    def __init__(self, problem: PoseProblem) -> None:
        self.problem = problem
        self.calibrated = problem.similarity == "calibrated"  # only then can poses be compared whatever box they fill
        self.voting = len(problem.models) > 1 and self.calibrated
        self._similarities: list[Similarity] = []
        self._cached_views = 0  # that were compared with the photograph
        self._watching = Lock()

    def choose_best(self, climbed: Sequence[Hypothesis]) -> PoseEstimate:
        """The best pose of a single model, or of a similarity for which there is no vote."""
        starts = select_promising(climbed, _SHORT_ASCENTS, _CLIMBED_SHARE)
        short = self.ascend(starts, SHORT_SCHEDULE)
        short += self.ascend(self._start_reversed(max(short, key=lambda hypothesis: hypothesis.score)), SHORT_SCHEDULE)
        chosen = select_promising(short, _FULL_ASCENTS, _SHORT_SHARE)
        ended = self.ascend(chosen, repeats=_REPEATS)
        best = max(ended, key=lambda hypothesis: hypothesis.score)
        refined = [*ended, *(hypothesis for hypothesis in short if hypothesis not in chosen)]
        traced = [*refined, *(hypothesis for hypothesis in climbed if hypothesis not in starts)]
        return self._estimate(best, traced, compare_shares(best, refined, climbed), agreement=1.0)

    def choose_by_vote(self, tilted: Sequence[Hypothesis]) -> PoseEstimate:
        """The side on which poses of several models agree, and the best of these."""
        voters = self.ascend(tilted, SHORT_SCHEDULE)
        (on_side, share), *other_sides = vote(voters, _VOTED_SIDES, self.weigh_azimuths(voters))
        chosen = on_side[:_AVERAGED]
        ascended = self.ascend(chosen)
        agreeing = sort_by_score(ascended)
        viewpoint = mean_viewpoint(agreeing)
        if self._prior is not None:
            log_probabilities = self._prior.log_probabilities(agreeing[0].place.crop.image)[0]
            viewpoint[0] = midway_azimuth(viewpoint[0], log_probabilities)
        best = self.move_to_viewpoint(agreeing[0], viewpoint)
        traced = [*ascended, *(hypothesis for hypothesis in voters if hypothesis not in chosen)]
        shares = {poses[0]: other_share / share for poses, other_share in other_sides}
        return self._estimate(best, traced, shares, agreement=share)

    def find_level_views(self) -> list[Hypothesis]:
        """The best views of all models at all elevations, the best first."""
        azimuths, penalties = equidistant_azimuths(VIEW_COUNT), self.problem.level_penalties
        found: list[tuple[float, float, str, float, Tensor]] = []
        for name, model in self.problem.iterate_models():
            for elevation in self.problem.elevations:
                values = self._view_similarities(model, elevation)
                values[~self.problem.allowed] = -torch.inf
                best = local_maxima(values, _VIEW_MAXIMA)
                for value, azimuth in zip(values[best].tolist(), azimuths[best], strict=True):
                    found.append((value - penalties[elevation], value, name, elevation, azimuth))
        finite = sorted((view for view in found if math.isfinite(view[0])), key=lambda view: -view[0])
        return [self._place_level_view(*view[1:]) for view in finite[: VOTERS if self.voting else _VIEW_MAXIMA]]

    def find_other_views(self) -> list[Hypothesis]:
        """The best views of all models that fill another box or are tilted, the best first."""
        problem, found = self.problem, []
        maxima, most = (_VIEW_MAXIMA, VOTERS) if self.voting else (_OTHER_VIEWS, _OTHER_VIEWS)
        places = [problem.photograph, *map(problem.crop_around, problem.other_boxes or ())]
        reach = ROUGH if problem.other_boxes is None else FOUND
        surroundings = [describe_surroundings(place, problem.image, problem.tilts, reach) for place in places]
        for name, model in problem.models.items():
            for place, around in zip(places, surroundings, strict=True):
                views = find_views(model, place, around, problem.elevations, problem.allowed, maxima)
                for pose, value in zip(views[0], views[1].tolist(), strict=True):
                    found.append((value - float(problem.penalty(pose[None], place)), value, name, place, pose))
        best = sorted(found, key=lambda view: -view[0])[:most]
        reframed = (self._reframe(*view[1:]) for view in best)
        return [view for view in reframed if view is not None]

    def climb(self, views: Sequence[Hypothesis]) -> list[Hypothesis]:
        """The end of a short ascent of the coarse similarity from each view, or the view if it is no better."""
        climbed = self.ascend(views, COARSE_SCHEDULE, fine=False)
        return [max(pair, key=lambda hypothesis: hypothesis.score) for pair in zip(views, climbed, strict=True)]

    def tilt(self, views: Sequence[Hypothesis]) -> list[Hypothesis]:
        """The best of small turns of azimuth and in the image plane, of each view.

        The two are hard to tell apart: seen from above, either moves the top of an object across its foot.
        """
        similarities = [self._similarity(view) for view in views]  # made before threads ask for them
        return in_threads(lambda k: self._tilt(views[k], similarities[k]), len(views))

    def ascend(
        self, starts: Sequence[Hypothesis], rounds: Sequence[Round] = SCHEDULE, *, fine: bool = True, repeats: int = 0
    ) -> list[Hypothesis]:
        """The highest similarity near each start, of any models, by rounds of quadratic ascents."""
        similarities = [self._similarity(start, fine=fine) for start in starts]
        seeds = torch.randint(2**62, (len(starts),), generator=self.problem.generator).tolist()
        return in_threads(lambda k: self._ascend(starts[k], similarities[k], rounds, seeds[k], repeats), len(starts))

    @cached_property
    def _prior(self) -> ViewpointPrior | None:
        """The viewpoint prior, if it knows the models."""
        prior = self.problem.viewpoints
        return prior if prior is not None and recognizes_models(prior, list(self.problem.models.values())) else None

    def weigh_azimuths(self, poses: Sequence[Hypothesis]) -> Tensor:
        """Logarithms of the probabilities of the poses' azimuths for any model, (N,)."""
        # in a crop of its own a pose would confirm itself
        places = list(dict.fromkeys(hypothesis.place for hypothesis in poses))
        models = list(self.problem.models.values())
        evidence = azimuth_evidence(models, places, self.problem.level_penalties, self._prior)
        rows = torch.tensor([places.index(hypothesis.place) for hypothesis in poses])
        azimuths = torch.tensor([hypothesis.azimuth for hypothesis in poses], dtype=torch.float64)
        return interpolate_evidence(evidence[rows], azimuths)

    def move_to_viewpoint(self, start: Hypothesis, viewpoint: Tensor) -> Hypothesis:
        """The pose at another azimuth, elevation and in-plane rotation, (3,), degrees."""
        pose = start.pose.clone()
        pose[[0, 1, 3]] = viewpoint
        pose = self.problem.limit_azimuths(pose[None])[0]
        fine, coarse = (float(self._similarity(start, fine=fine).values(pose[None])) for fine in (True, False))
        return start.move(pose, fine, coarse)

    def _estimate(
        self,
        best: Hypothesis,
        traced: Sequence[Hypothesis],
        shares: Mapping[Hypothesis, float],
        *,
        agreement: float,
    ) -> PoseEstimate:
        """The estimate of the best pose, with its runners-up and its confidence."""
        elevation = min(self.problem.elevations, key=lambda elevation: abs(elevation - float(best.pose[1])))
        same_view = equivalent_azimuths(self.problem.models[best.model], best.azimuth, elevation)
        known = self.calibrated and len(self.problem.models) == 1
        if known:
            turned = self.move_to_viewpoint(best, best.pose[[0, 1, 3]] + torch.tensor([180.0, 0, 0]))
            shares = {**shares, turned: turned.similarity / max(best.similarity, 1e-9)}
        runners_up = select_runners_up(shares, [best.azimuth, *same_view])
        evidence = None
        if self.calibrated:
            evidence = gather_evidence(self.problem, best, agreement, [*runners_up.values()])
        confidences = [None] * (1 + len(runners_up)) if evidence is None else [*probabilities(evidence)]
        rivals = zip(runners_up.items(), confidences[1:], strict=True)
        return self._convert(
            best,
            traces=tuple(hypothesis.search_trace() for hypothesis in traced),
            runners_up=tuple(self._convert(rival, share=share, confidence=sure) for (rival, share), sure in rivals),
            equivalent_azimuths=same_view,
            covariance=best.covariance(self.problem.image.shape[1:], same_view) if known else None,
            confidence=confidences[0],
            evidence=evidence,
        )

    def _convert(self, hypothesis: Hypothesis, **attributes: object) -> PoseEstimate:
        """The hypothesis as an estimate."""
        pose = hypothesis.photograph.crop.convert_pose(hypothesis.pose, self.problem.photograph.crop)
        return self.problem.estimate(
            hypothesis.model,
            pose,
            similarity=hypothesis.similarity,
            renderings=self._cached_views + sum(similarity.renderings for similarity in self._similarities),
            **attributes,
        )

    def _view_similarities(self, model: PreparedModel, elevation: float) -> Tensor:
        """Similarities (VIEW_COUNT,) of views all around."""
        photograph = self.problem.photograph
        if self.calibrated:
            views = view_descriptors(model, elevation, photograph.own_background)
            self._cached_views += VIEW_COUNT
            return (views.flatten(1) @ photograph.calibrated.weights.flatten()).double()
        # without calibration the similarity depends on the size of the object
        poses = self.problem.level_views(model, equidistant_azimuths(VIEW_COUNT), elevation)
        return self._make_similarity(model, photograph).values(poses)

    def _place_level_view(self, value: float, name: str, elevation: float, azimuth: Tensor) -> Hypothesis:
        (pose,) = self.problem.level_views(self.problem.models[name], azimuth[None], elevation)
        return self._start(value, name, pose, self.problem.photograph, self.problem.photograph)

    def _reframe(self, value: float, name: str, place: PreparedPhotograph, pose: Tensor) -> Hypothesis | None:
        """A view with the crop around it; None for level views that fill the given box, which are there already."""
        model, crop = self.problem.models[name], place.crop
        (box,) = bounding_boxes(pose[None], model.hull, crop.camera)
        if Box(*box.tolist()).iou(crop.centred_box) >= _SAME_BOX:
            if pose[3] == 0 and place is self.problem.photograph:
                return None
            (pose,) = self.problem.fit(model, pose[None], place)
            return self._start(value, name, pose, place, place)
        other = self.problem.crop_around(crop.box_in_photograph(box))
        return self._start(value, name, crop.convert_pose(pose, other.crop), other, place)

    def _start(
        self, value: float, name: str, pose: Tensor, photograph: PreparedPhotograph, place: PreparedPhotograph
    ) -> Hypothesis:
        penalty = float(self.problem.penalty(pose[None], photograph))
        hypothesis = Hypothesis(value, name, pose, photograph, place, ((float(pose[0]), value),), penalty)
        self._watch(hypothesis, pose)
        return hypothesis

    def _start_reversed(self, hypothesis: Hypothesis) -> list[Hypothesis]:
        """A start at the pose with reversed depth, if its azimuth is allowed."""
        pose = reverse_depth(hypothesis.pose)
        if not torch.equal(self.problem.limit_azimuths(pose[None])[0], pose):
            return []
        value = float(self._similarity(hypothesis).values(pose[None]))
        return [self._start(value, hypothesis.model, pose, hypothesis.photograph, hypothesis.place)]

    def _tilt(self, view: Hypothesis, coarse: Similarity) -> Hypothesis:
        poses = view.pose.repeat(len(_TILTS) * len(_TURNS), 1)
        turns, tilts = (torch.tensor(angles, dtype=poses.dtype) for angles in (_TURNS, _TILTS))
        poses[:, [0, 3]] += torch.cartesian_prod(turns, tilts)
        poses = self.problem.fit(self.problem.models[view.model], self.problem.limit_azimuths(poses), view.photograph)
        values = coarse.values(poses)
        penalties = self.problem.penalty(poses, view.photograph)
        best = int((values - penalties).argmax())
        pose, value = poses[best], float(values[best])
        self._watch(view, pose)
        return view.move(pose, value, value, float(penalties[best]))

    def _ascend(
        self, start: Hypothesis, similarity: Similarity, rounds: Sequence[Round], seed: int, repeats: int
    ) -> Hypothesis:
        generator, limit = torch.Generator().manual_seed(seed), self.problem.limit_azimuths
        watch = partial(self._watch, start)
        pose, hessian = quadratic_ascent(similarity, start.pose, rounds, generator, watch, limit, repeats=repeats)
        value = float(similarity.values(pose[None]))
        climbing = similarity.template is start.photograph.template(self.problem.similarity)  # the coarse one itself
        coarse = value if climbing else float(self._similarity(start).values(pose[None]))
        penalty = float(self.problem.penalty(pose[None], start.photograph))
        return start.move(wrap_angles(pose), value, coarse, penalty, wrap_hessian(hessian, pose))

    def _watch(self, hypothesis: Hypothesis, pose: Tensor) -> None:
        crop = self.problem.photograph.crop
        with self._watching:
            self.problem.watch(hypothesis.model, hypothesis.photograph.crop.convert_pose(pose, crop))

    def _similarity(self, hypothesis: Hypothesis, *, fine: bool = False) -> Similarity:
        """The similarity to a hypothesis's crop; only the calibrated kind has smaller cells in the last steps."""
        return self._make_similarity(self.problem.models[hypothesis.model], hypothesis.photograph, fine=fine)

    def _make_similarity(
        self, model: PreparedModel, photograph: PreparedPhotograph, *, fine: bool = False
    ) -> Similarity:
        template = photograph.fine if fine and self.calibrated else photograph.template(self.problem.similarity)
        similarity = model.similarity(template, detail=DETAIL, camera=photograph.crop.camera)
        self._similarities.append(similarity)
        return similarity
