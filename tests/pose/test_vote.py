"""Rivals of a pose, and the side on which poses of several models agree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, cast

import pytest
import torch
from torch import Tensor

from nablahog.pose import estimate_pose
from nablahog.pose.best_search import BestSearch
from nablahog.pose.photograph import PreparedPhotograph
from nablahog.pose.vote import (
    Hypothesis,
    compare_shares,
    mean_viewpoint,
    measure_agreement,
    midway_azimuth,
    select_other_sides,
    select_promising,
    select_runners_up,
    vote,
)

from ..hog.zoo import threads
from .common import SWIVEL, degrees_between, model, photographed

Sides = list[tuple[list[Hypothesis], float]]


def poses(
    azimuths: list[float], coarse: list[float], fine: list[float] | None = None, penalty: list[float] | None = None
) -> list[Hypothesis]:
    """Hypotheses with these similarities, of models a, b, c, …; their elevation is a tenth of the azimuth."""
    photograph = cast(PreparedPhotograph, None)
    return [
        Hypothesis(
            (fine or coarse)[k],
            chr(97 + k),
            torch.tensor([at, at / 10, 3.0, 0, 0, 0], dtype=torch.float64),
            photograph,
            photograph,
            ((at, coarse[k]),),
            penalty[k] if penalty else 0.0,
        )
        for k, at in enumerate(azimuths)
    ]


def voted(voters: list[Hypothesis], count: int) -> Sides:
    """The sides where nothing else says which azimuths are likely."""
    return vote(voters, count, torch.zeros(len(voters), dtype=torch.float64))


def models_of(side: tuple[list[Hypothesis], float]) -> str:
    return "".join(one.model for one in side[0])


def test_a_side_that_is_likely_in_itself_needs_fewer_votes() -> None:
    voters = poses([0.0, 5.0, 180.0], [5.0, 5.0, 5.0])
    assert models_of(voted(voters, 1)[0]) == "ab"
    likely = torch.tensor([0.0, 0.0, 3.0], dtype=torch.float64)
    assert models_of(vote(voters, 1, likely)[0]) == "c"
    assert vote(voters, 1, likely + 100)[0][1] == pytest.approx(vote(voters, 1, likely)[0][1])


def test_agreement_is_the_mean_angle_to_the_best_rotation() -> None:
    level = [
        replace(pose, pose=pose.pose * torch.tensor([1, 0, 1, 1, 1, 1])) for pose in poses([0.0, 9, 180], [5.0] * 3)
    ]
    assert measure_agreement(level[0], level, torch.zeros(3, dtype=torch.float64)) == pytest.approx(1 - (9 + 90) / 270)
    likely = torch.tensor([1.0, 1.0, -99.0], dtype=torch.float64)
    assert measure_agreement(level[0], level, likely) == pytest.approx(1 - 9 / 180)
    tilted = replace(level[0], pose=level[0].pose + torch.tensor([0, 0, 0, 45, 0, 0]))
    assert measure_agreement(tilted, level[:1], likely[:1]) == pytest.approx(0.5)
    assert measure_agreement(level[0], level[:1], likely[:1]) == pytest.approx(1)


def test_many_good_poses_outvote_the_best_one() -> None:
    azimuths, similarities = [200.0, 355, 361, 3, 90, 95, 180], [9.0, 8.7, 8.6, 8.7, 5.0, 5.0, 1.0]
    first, second, *_ = voted(poses(azimuths, similarities), 4)
    assert (sorted(models_of(first)), models_of(second)) == (["b", "c", "d"], "a")
    first, *_ = voted(poses(azimuths, [14.0, *similarities[1:]]), 4)
    assert models_of(first) == "a"


def test_a_vote_is_the_exponential_of_the_similarity_without_the_penalty() -> None:
    """Shares of two sides with known weights: exp((0.7 coarse + 0.3 fine - penalty) / 0.8)."""
    (first, share), (second, other) = voted(poses([0.0, 180.0], [5.0, 5.0], [6.0, 5.0], [0.0, 0.5]), 2)
    assert (first[0].model, second[0].model) == ("a", "b")
    assert share / other == pytest.approx(torch.tensor((0.3 + 0.5) / 0.8).exp().item(), rel=1e-5)
    assert share + other == pytest.approx(1)
    (first, _), _ = voted(poses([0.0, 180.0], [5.0, 5.0], None, [0.5, 0.0]), 2)
    assert first[0].model == "b"


class VoteAlone(BestSearch):
    """A search that chooses among poses whose ascents end where they begin, and whose moves change nothing else."""

    def __init__(self) -> None:
        self._prior = None  # a cached property

    def ascend(self, starts: Sequence[Hypothesis], *_: Any, **__: Any) -> list[Hypothesis]:
        return [*starts]

    def weigh_azimuths(self, poses: Sequence[Hypothesis]) -> Tensor:
        return torch.zeros(len(poses), dtype=torch.float64)

    def move_to_viewpoint(self, start: Hypothesis, viewpoint: Tensor) -> Hypothesis:
        return replace(start, pose=start.pose.index_copy(0, torch.tensor([0, 1, 3]), viewpoint))

    def _estimate(self, best: Any, traced: Any, shares: Any, *, agreement: float) -> Any:
        return best, traced, shares, agreement


def test_the_best_pose_of_the_side_with_most_votes_is_moved_to_the_mean_of_that_side() -> None:
    """Others are traced, too; a rival is the best of its side, with its votes as a share of the winner's."""
    voters = poses([200.0, 4, -4, 0], [6.0, 5.0, 6.0, 5.5], [6.0, 5.0, 6.0, 5.5])
    best, traced, shares, agreement = cast(Any, VoteAlone().choose_by_vote(voters))
    assert best.model == "c"
    assert best.similarity == 6
    trace = best.search_trace()
    assert (trace.model, trace.azimuths, trace.similarities) == ("c", (-4,), (6,))
    assert -4 < best.azimuth < 0
    assert sorted(one.model for one in traced) == ["a", "b", "c", "d"]
    sides = voted(voters, 2)
    assert shares == {voters[0]: sides[1][1] / sides[0][1]}
    assert agreement == measure_agreement(best, voters, torch.zeros(4, dtype=torch.float64))


def test_shares_add_up_and_every_pose_is_on_one_side() -> None:
    generator = torch.Generator().manual_seed(1)
    azimuths = (torch.rand(36, generator=generator) * 720).tolist()
    sides = voted(poses(azimuths, torch.rand(36, generator=generator).tolist()), 36)
    assert sum(share for _, share in sides) == pytest.approx(1)
    assert sorted(one.azimuth for side, _ in sides for one in side) == sorted(azimuths)


def test_the_viewpoint_is_the_mean_of_the_side_across_0() -> None:
    azimuth, elevation, theta = mean_viewpoint(poses([358.0, 4.0], [5.0, 5.0])).tolist()
    assert degrees_between(azimuth, 1.0) < 1e-3
    assert elevation == pytest.approx(18.1, abs=1e-3)
    assert theta == 0


def test_the_viewpoint_of_one_pose_is_its_own() -> None:
    assert mean_viewpoint(poses([300.0], [5.0])).tolist() == pytest.approx([300, 30, 0])


def test_a_pose_that_fits_better_counts_more() -> None:
    ((side, _),) = voted(poses([0.0, 10.0], [5.0, 5.0], [8.0, 5.0]), 1)
    assert side[0].model == "a"
    assert degrees_between(float(mean_viewpoint(side)[0]), 0) < 0.5


def promising(azimuths: list[float], similarities: list[float], penalty: list[float] | None = None) -> list[float]:
    return [one.azimuth for one in select_promising(poses(azimuths, similarities, penalty=penalty), 3, 0.7)]


def test_promising_poses_differ_and_are_nearly_as_good_as_the_best() -> None:
    assert promising([0, 10, 90, 180], [5.0, 4.9, 4.3, 4.5]) == [0, 180, 90]
    assert promising([0, 10, 180], [5.0, 4.9, 3.4]) == [0]
    assert promising([0, 100, 200, 300], [5.0, 4.0, 4.5, 4.2]) == [0, 200, 300]
    assert promising([0, 180], [5.0, 4.9], penalty=[0.5, 0.0]) == [180, 0]
    assert promising([0, 180], [-1.0, -5.0]) == [0]  # the best, however bad it is


def test_poses_of_one_side_that_are_tilted_otherwise_differ() -> None:
    upright, tilted = poses([0, 5], [5.0, 4.9])
    tilted.pose[3] = 20
    assert select_promising([upright, tilted], 2) == [upright, tilted]


def test_from_straight_above_azimuth_and_tilt_are_the_same_rotation() -> None:
    views = poses([0, 30, 30], [5.0, 4.9, 4.8])
    for view, tilt in zip(views, (0, 30, -30), strict=True):
        view.pose[1], view.pose[3] = 90, tilt
    assert len(select_promising(views, 3)) == 2  # one of the tilts undoes the turn; the other doubles it


def test_runners_up_look_from_elsewhere() -> None:
    views = poses([0, 100, 110, 5, 200], [3.0, 2.0, 1.9, 2.5, 1.0])
    assert [one.azimuth for one in select_other_sides(views, [views[0].pose[[0, 1, 3]]], 2)] == [100, 200]
    for view in views:
        view.pose[1], view.pose[3] = 89, view.azimuth  # nearly the same rotation
    assert select_other_sides(views, [views[0].pose[[0, 1, 3]]], 2) == []


def test_runners_up_are_no_symmetric_views() -> None:
    views = poses([0, 90, 180, 270], [4.0, 3.0, 3.5, 2.0])
    best = views[0].move(views[0].pose, 6.0, 5.0)
    others = select_runners_up(compare_shares(best, [best], views), best, [180.0])
    assert [(one.azimuth, share) for one, share in others.items()] == [(90, 0.75), (270, 0.5)]


@pytest.mark.slow
def test_threads_do_not_change_the_pose_and_count_all_renderings() -> None:
    image, box = photographed(model(), 30, 15)
    others = {"swivel": model(SWIVEL), "wooden": model(6)}
    estimates = []
    for count in (1, 2):
        with threads(count):
            estimates.append(estimate_pose(image, others, box=box, initial=(0, 15)))
    torch.testing.assert_close(estimates[0].pose, estimates[1].pose, atol=1e-4, rtol=0)  # networks round differently
    assert (estimates[0].model, estimates[0].renderings) == (estimates[1].model, estimates[1].renderings)
    paths = [(trace.model, trace.azimuths) for trace in estimates[0].traces]
    for model_name, path in paths:  # each start has one trace, to the end of its last ascent
        assert sum((model_name, path) == (name, longer[: len(path)]) for name, longer in paths) == 1


def test_the_midway_azimuth_is_between_the_search_and_what_is_likely_on_its_side() -> None:
    log_probabilities = torch.full((48,), -torch.inf)
    log_probabilities[[0, 1]] = -1000.0  # 0° and 7.5°, whose probabilities underflow
    log_probabilities[24] = 0.0  # the opposite side does not count
    azimuth = midway_azimuth(torch.tensor(359.0, dtype=torch.float64), log_probabilities)
    assert float(azimuth) == pytest.approx(359 + 4.75 / 2)
