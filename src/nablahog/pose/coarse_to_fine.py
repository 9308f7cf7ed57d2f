"""The default search: views all around, the best of them tilted, and an ascent from the best of these."""

from __future__ import annotations

from collections.abc import Sequence

from .confidence import Evidence
from .crop import ObjectCrop
from .election import SAME_SIDE, Side, sides
from .hypothesis import Hypothesis
from .placement import azimuth_distance
from .problem import PoseProblem, RunnerUp, SearchResult
from .search import VOTE, Search

_RIVAL = 0.8  # of the best view's similarity, after tilting
_MORE_ASCENTS = 2  # where the best and its rival come to little
_SURE = 6.5  # coarse similarity of views that fill the given box, from which on others are not searched
_SURE_AT_LAST = 8.0  # fine similarity, from which on no other ascents are tried
_MOST_OF_A_SIDE = 8  # poses, on the elected side, whose mean viewpoint is taken
_RUNNERS_UP = 3  # poses from other sides that are kept


def coarse_to_fine(problem: PoseProblem) -> SearchResult:
    """Searches views coarsely, tilts the best of them, and ascends over all parameters from the best of these.

    The calibrated similarity has smaller cells in the last step.  Several models are compared by these: one wrong model
    may fit anywhere, so that poses of all models vote for a side of the object.
    """
    search = Search(problem)
    tilted = search.tilt_each(search.promising(search.look_around()))
    if search.searches_boxes and max(one.similarity for one in tilted) < _SURE:
        tilted += search.tilt_each(search.promising(search.look_elsewhere()))
    return _of_several(search, tilted) if search.voting else _of_one(search, tilted)


def _of_one(search: Search, tilted: Sequence[Hypothesis]) -> SearchResult:
    """The best pose of a single model, or of a similarity for which there is no vote."""
    chosen = _with_rival(tilted)
    refined = search.ascend_each(chosen)
    if search.kind == "calibrated":
        for hypothesis in _others(tilted, chosen):
            if max(one.similarity for one in refined) >= _SURE_AT_LAST:
                break
            chosen.append(hypothesis)
            refined += search.ascend_each([hypothesis])
    best = max(refined, key=lambda one: one.score)
    runners_up = _runners_up(best, refined, tilted, search.same_view(best), search.problem.photograph.crop)
    evidence = Evidence(best.similarity, runners_up[0].share if runners_up else 0.0, 1.0)
    return search.result(best, [*refined, *(one for one in tilted if one not in chosen)], runners_up, evidence)


def _of_several(search: Search, tilted: Sequence[Hypothesis]) -> SearchResult:
    """The side on which poses of several models agree, and the best of these."""
    voters = search.ascend_each(tilted, VOTE)
    elected, *others = sides(voters, 1 + _RUNNERS_UP, search.azimuth_evidence(voters))
    chosen = elected.poses[:_MOST_OF_A_SIDE]
    ascended = search.ascend_each(chosen)
    elected = Side(tuple(sorted(ascended, key=lambda one: -one.score)), elected.share)
    best = search.seen_from(elected.viewpoint, elected.poses[0])
    shares = [(side.share / elected.share, side.poses[0]) for side in others]
    runners_up = _from_other_sides(shares, best, search.same_view(best), search.problem.photograph.crop)
    evidence = Evidence(best.similarity, runners_up[0].share if runners_up else 0.0, elected.share)
    return search.result(best, [*ascended, *(one for one in voters if one not in chosen)], runners_up, evidence)


def _runners_up(
    best: Hypothesis,
    refined: Sequence[Hypothesis],
    tilted: Sequence[Hypothesis],
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
    return _from_other_sides(shares, best, same_view, crop)


def _from_other_sides(
    shares: Sequence[tuple[float, Hypothesis]], best: Hypothesis, same_view: Sequence[float], crop: ObjectCrop
) -> tuple[RunnerUp, ...]:
    """Those with the highest shares that are on other sides than the best pose and than each other, for the crop."""
    azimuths = [best.azimuth, *same_view]
    found: list[RunnerUp] = []
    for share, one in sorted(shares, key=lambda each: -each[0]):
        if min(azimuth_distance(one.azimuth, azimuth) for azimuth in azimuths) > SAME_SIDE:
            pose = one.photograph.crop.converted(one.pose, crop)
            found.append(RunnerUp(one.model, pose, min(max(share, 0.0), 1.0)))
            azimuths.append(one.azimuth)
    return tuple(found[:_RUNNERS_UP])


def _others(tilted: Sequence[Hypothesis], chosen: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Further ones to ascend from where the chosen ones come to little: from other sides, the best first."""
    others: list[Hypothesis] = []
    for one in sorted(tilted, key=lambda one: -one.score):
        sides = (azimuth_distance(one.azimuth, each.azimuth) for each in (*chosen, *others))
        if min(sides) > SAME_SIDE and len(others) < _MORE_ASCENTS:
            others.append(one)
    return others


def _with_rival(tilted: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The best, with a rival."""
    best = max(tilted, key=lambda one: one.score)
    return [best, *_rival(best, tilted)]


def _rival(best: Hypothesis, others: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The best from another side, if it is nearly as good: front and back look much alike."""
    elsewhere = [one for one in others if azimuth_distance(one.azimuth, best.azimuth) > SAME_SIDE]
    rival = max(elsewhere, key=lambda one: one.score, default=best)
    return [rival] if rival is not best and rival.similarity >= _RIVAL * best.similarity else []
