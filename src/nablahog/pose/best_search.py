"""The default search: views all around, coarse ascents from the best of them, fine ascents from the best of these."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import torch
from torch import Tensor

from .ascent import SCHEDULE
from .confidence import probabilities
from .evidence import gather_evidence
from .problem import PoseProblem
from .result import PoseEstimate
from .search_steps import SearchSteps
from .symmetry import compare_sides
from .viewpoint_prior import ViewpointPrior
from .vote import (
    Hypothesis,
    azimuth_evidence,
    compare_shares,
    interpolate_evidence,
    mean_viewpoint,
    measure_agreement,
    midway_azimuth,
    recognizes_models,
    select_promising,
    select_runners_up,
    sort_by_score,
    vote,
)

SHORT_SCHEDULE = SCHEDULE[:2]  # rounds of short ascents, enough to tell which side of the object a pose sees
_LONG_SCHEDULE = SCHEDULE[:3]  # rounds of long ascents: the full schedule without its last, dear rounds
_VOTED_SIDES = 4  # of the object that are voted for: the best one and the runners-up
_SHORT_ASCENTS, _CLIMBED_SHARE = 4, 0.6  # most short fine ascents of a single model, from the best coarse scores
_LONG_ASCENTS, _SHORT_SHARE = 3, 0.75  # most long ones, from the best ends of these; shares are of the best score
_LONG_SHARE = 0.9  # share of the best score with which the end of a long ascent starts a full one
_REPEATS = 2  # of rounds of a long ascent that ended far away
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


class BestSearch(SearchSteps):
    """Chooses among the poses that the steps of a search have found."""

    def choose_best(self, climbed: Sequence[Hypothesis]) -> PoseEstimate:
        """The best pose of a single model, or of a similarity for which there is no vote."""
        starts = select_promising(climbed, _SHORT_ASCENTS, _CLIMBED_SHARE)
        short = self.ascend(starts, SHORT_SCHEDULE)
        short += self.ascend(self.start_reversed(max(short, key=lambda hypothesis: hypothesis.score)), SHORT_SCHEDULE)
        chosen = select_promising(short, _LONG_ASCENTS, _SHORT_SHARE)
        # a single one needs no long ascent to be told from others
        long = self.ascend(chosen, _LONG_SCHEDULE, repeats=_REPEATS) if len(chosen) > 1 else chosen
        finalists = select_promising(long, _LONG_ASCENTS, _LONG_SHARE)
        best, *others = sort_by_score(self.ascend(finalists, repeats=_REPEATS))
        others += [end for ends, used in ((long, finalists), (short, chosen)) for end in ends if end not in used]
        refined = [best, *others]
        traced = [*refined, *(hypothesis for hypothesis in climbed if hypothesis not in starts)]
        return self._estimate(best, traced, compare_shares(best, refined, climbed), agreement=1.0)

    def choose_by_vote(self, tilted: Sequence[Hypothesis]) -> PoseEstimate:
        """The side on which poses of several models agree, and the best of these."""
        voters = self.ascend(tilted, SHORT_SCHEDULE)
        likely_azimuths = self.weigh_azimuths(voters)
        (on_side, share), *other_sides = vote(voters, _VOTED_SIDES, likely_azimuths)
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
        agreement = measure_agreement(best, voters, likely_azimuths)
        return self._estimate(best, traced, shares, agreement=agreement)

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

    def _estimate(
        self,
        best: Hypothesis,
        traced: Sequence[Hypothesis],
        shares: Mapping[Hypothesis, float],
        *,
        agreement: float,
    ) -> PoseEstimate:
        """The estimate of the best pose, with its runners-up and its confidence."""
        same_view, similar = compare_sides(self.problem.models[best.model], best.azimuth, float(best.pose[1]))
        known = self.calibrated and len(self.problem.models) == 1
        if known:
            viewpoint = best.pose[[0, 1, 3]]
            for azimuth in filter(self.problem.allows, (best.azimuth + 180, *similar)):
                viewpoint[0] = azimuth
                other_side = self.move_to_viewpoint(best, viewpoint)
                shares = {**shares, other_side: other_side.score / max(best.score, 1e-9)}
        runners_up = select_runners_up(shares, best, same_view)
        evidence = None
        if self.calibrated:
            prior = self._prior if self.voting else None
            evidence = gather_evidence(self.problem, best, agreement, [*runners_up.values()], prior)
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
            renderings=self.renderings,
            **attributes,
        )
