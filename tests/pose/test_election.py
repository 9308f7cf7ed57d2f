"""The side on which poses of several models agree."""

from __future__ import annotations

from collections.abc import Iterator
from typing import cast

import pytest
import torch

from nablahog.pose import estimate_pose
from nablahog.pose.election import Side, consensus, sides
from nablahog.pose.hypothesis import Hypothesis
from nablahog.pose.prepared import PreparedPhotograph

from .common import SWIVEL, degrees_between, model, photographed


def poses(azimuths: list[float], coarse: list[float], fine: list[float] | None = None) -> list[Hypothesis]:
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
        )
        for k, at in enumerate(azimuths)
    ]


def elected(votes: list[Hypothesis], count: int) -> list[Side]:
    """The sides where nothing else says which azimuths are likely."""
    return sides(votes, count, torch.zeros(len(votes), dtype=torch.float64))


def test_a_side_that_is_likely_in_itself_needs_fewer_votes() -> None:
    votes = poses([0.0, 5.0, 180.0], [5.0, 5.0, 5.0])
    assert elected(votes, 1)[0].poses[0].model in "ab"
    likely = torch.tensor([0.0, 0.0, 3.0], dtype=torch.float64)
    assert sides(votes, 1, likely)[0].poses[0].model == "c"
    assert sides(votes, 1, likely + 100)[0].share == pytest.approx(sides(votes, 1, likely)[0].share)


def test_many_good_poses_outvote_the_best_one() -> None:
    azimuths, similarities = [200.0, 355, 361, 3, 90, 95, 180], [9.0, 8.7, 8.6, 8.7, 5.0, 5.0, 1.0]
    first, second, *_ = elected(poses(azimuths, similarities), 4)
    assert sorted(one.model for one in first.poses) == ["b", "c", "d"]
    assert [one.model for one in second.poses] == ["a"]
    first, *_ = elected(poses(azimuths, [14.0, *similarities[1:]]), 4)
    assert [one.model for one in first.poses] == ["a"]


def test_only_differences_of_similarities_count() -> None:
    azimuths, similarities = [0.0, 10, 200], [5.0, 5.2, 5.5]
    one, other = (elected(poses(azimuths, [each + more for each in similarities]), 3) for more in (0, 100))
    assert [side.share for side in one] == pytest.approx([side.share for side in other], rel=1e-5)


def test_shares_add_up_and_every_pose_is_on_one_side() -> None:
    generator = torch.Generator().manual_seed(1)
    azimuths = (torch.rand(36, generator=generator) * 720).tolist()
    found = elected(poses(azimuths, torch.rand(36, generator=generator).tolist()), 36)
    assert sum(side.share for side in found) == pytest.approx(1)
    assert sorted(one.azimuth for side in found for one in side.poses) == sorted(one for one in azimuths)


def test_the_viewpoint_is_the_mean_of_the_side_across_0() -> None:
    (side,) = elected(poses([358.0, 4.0], [5.0, 5.0]), 1)
    azimuth, elevation, theta = side.viewpoint.tolist()
    assert degrees_between(azimuth, 1.0) < 1e-3
    assert elevation == pytest.approx(18.1, abs=1e-3)
    assert theta == 0


def test_a_pose_that_fits_better_counts_more() -> None:
    (side,) = elected(poses([0.0, 10.0], [5.0, 5.0], [8.0, 5.0]), 1)
    assert side.poses[0].model == "a"
    assert degrees_between(float(side.viewpoint[0]), 0) < 0.5


def test_votes_of_a_pose_alone_are_its_weight() -> None:
    azimuths = torch.tensor([0.0, 100, 200], dtype=torch.float64)
    weights = torch.tensor([1.0, 0.5, 0.25], dtype=torch.float64)
    assert torch.allclose(consensus(azimuths, weights), weights)


@pytest.fixture
def own_threads() -> Iterator[None]:
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


@pytest.mark.usefixtures("own_threads")
def test_threads_do_not_change_the_pose_and_count_all_renderings() -> None:
    image, box = photographed(model(), 30, 15)
    others = {"swivel": model(SWIVEL), "wooden": model(6)}
    found = []
    for threads in (1, 2):
        torch.set_num_threads(threads)
        found.append(estimate_pose(image, others, box=box, initial=(0, 15)))
    assert torch.equal(found[0].pose, found[1].pose)
    assert (found[0].model, found[0].renderings) == (found[1].model, found[1].renderings)
