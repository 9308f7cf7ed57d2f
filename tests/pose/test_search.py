"""The parts of the search: views all around, their summits, the fitted hill, and the paper's momentum by hand."""

from __future__ import annotations

from typing import cast

import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from nablahog.pose import search
from nablahog.pose.search import UNITS, Hill, climb, consensus, momentum, summits, turn_table
from nablahog.pose.similarity import Similarity

START = torch.tensor([100.0, 10, 3, 0, 5, -5], dtype=torch.float64)


class Quadratic:
    """A hill with its top at ``top``, in units of the parameters, jagged by ``jags``."""

    def __init__(self, top: Tensor, bend: Tensor, jags: float = 0.0) -> None:
        self.top, self.bend, self.jags, self.seen = top, bend, jags, 0

    def derivatives(self, poses: Tensor) -> tuple[Tensor, Tensor]:
        self.seen += len(poses)
        u = (poses - self.top) / UNITS
        jag, steep = self.jags * torch.sin(50 * u), 50 * self.jags * torch.cos(50 * u)
        values = 7 - 0.5 * torch.einsum("ni,ij,nj->n", u, self.bend, u) + jag.sum(1)
        return values, (steep - u @ self.bend) / UNITS


def quadratic(top: Tensor, jags: float = 0.0) -> tuple[Quadratic, Similarity]:
    mixed = torch.randn(6, 6, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    hill = Quadratic(top, torch.eye(6, dtype=torch.float64) + 0.2 * mixed @ mixed.T, jags)
    return hill, cast(Similarity, hill)


def test_turn_table() -> None:
    poses = turn_table(START, 4)
    assert poses[:, 0].tolist() == [100, 190, 280, 370]
    assert (poses[:, 1:] == START[1:]).all()
    assert START[0] == 100


@pytest.mark.parametrize(
    ("values", "count", "expected"),
    [
        ([1, 5, 2, 3, 9, 0, 4, 3], 9, [4, 1, 6]),
        ([1, 5, 2, 3, 9, 0, 4, 3], 2, [4, 1]),
        ([9, 5, 2, 3, 1, 8], 3, [0, 3]),  # the last is beside the first
        ([0, 1, 2, 3], 3, [3]),
        ([4], 3, [0]),
    ],
)
def test_summits(values: list[float], count: int, expected: list[int]) -> None:
    assert summits(torch.tensor(values).double(), count).tolist() == expected


def test_every_circle_has_a_summit() -> None:
    assert len(summits(torch.zeros(8), 3)) == 3
    for values in torch.rand(20, 48):
        assert summits(values, 1).item() == values.argmax()


def test_consensus_is_where_many_views_are_good() -> None:
    azimuths = torch.tensor([200.0, 355, 1, 3, 90, 95, 180], dtype=torch.float64)
    values = torch.tensor([9.0, 8.7, 8.6, 8.7, 5.0, 5.0, 1.0], dtype=torch.float64)
    # three that are almost as good as the best one alone
    assert degrees(int(consensus(azimuths, values).argmax()), 0) <= 3
    assert degrees(int(consensus(azimuths, values - 100).argmax()), 0) <= 3
    values[0] = 14
    assert degrees(int(consensus(azimuths, values).argmax()), 200) == 0


def degrees(one: float, other: float) -> float:
    return abs((one - other + 180) % 360 - 180)


def fitted(hill: Quadratic, count: int = 16) -> Tensor:
    half = torch.randn(count // 2, 6, dtype=torch.float64, generator=torch.Generator().manual_seed(2))
    offsets = torch.cat([half, -half])
    values, slopes = hill.derivatives(START + offsets * UNITS)
    return search._top(offsets, values, slopes * UNITS, torch.ones(count).double())


def test_the_top_of_an_exact_quadratic(monkeypatch: pytest.MonkeyPatch) -> None:
    away = torch.tensor([0.5, -0.3, 0.2, 0.1, -0.6, 0.4], dtype=torch.float64)
    hill, _ = quadratic(START + away * UNITS)
    assert (fitted(hill, 24) - away).norm() < 0.1 * away.norm()  # curvature is held back a little,
    monkeypatch.setattr(search, "_STIFFNESS", 0.0)
    assert_close(fitted(hill), away, rtol=0, atol=1e-6)  # and by nothing else


def test_samples_without_weight_do_not_count() -> None:
    away = torch.tensor([0.5, -0.3, 0.2, 0.1, -0.6, 0.4], dtype=torch.float64)
    offsets, weights = torch.randn(40, 6, dtype=torch.float64), torch.ones(40).double()
    values, slopes = quadratic(START + away * UNITS)[0].derivatives(START + offsets * UNITS)
    expected = search._top(offsets[8:], values[8:], slopes[8:] * UNITS, weights[8:])
    weights[:8], values[:8] = 0, 1e3
    assert_close(search._top(offsets, values, slopes * UNITS, weights), expected, rtol=0, atol=0.05)


@pytest.mark.parametrize("count", [6, 12, 16])
def test_samples_are_opposite_pairs_at_right_angles(count: int) -> None:
    offsets = search._pairs(count, torch.Generator().manual_seed(0))
    assert offsets.shape == (count, 6)
    assert torch.equal(offsets[: count // 2], -offsets[count // 2 :])
    assert_close(offsets.square().mean(1), torch.ones(count).double())
    basis = offsets[: min(6, count // 2)]
    assert_close(basis @ basis.T, 6 * torch.eye(len(basis)).double())


def test_a_top_far_away_is_only_approached() -> None:
    away = torch.tensor([9.0, 0, 0, 0, 0, 0], dtype=torch.float64)
    found = fitted(quadratic(START + away * UNITS)[0])
    assert found.norm() == pytest.approx(search._REACH)
    assert found[0] > 0.9 * search._REACH


def test_a_valley_is_left_uphill() -> None:
    away = torch.tensor([0.3, 0, 0, 0.1, 0, 0], dtype=torch.float64)
    hill, _ = quadratic(START + away * UNITS)
    hill.bend = -hill.bend
    assert torch.dot(fitted(hill), -away @ -hill.bend) > 0


def test_a_plain_has_no_top() -> None:
    offsets = torch.randn(8, 6, dtype=torch.float64)
    found = search._top(offsets, torch.ones(8).double(), torch.zeros(8, 6).double(), torch.ones(8).double())
    assert torch.isfinite(found).all()
    assert found.norm() <= search._REACH + 1e-9


def test_climbing_a_jagged_hill() -> None:
    """Slopes of jags are ten times those of the hill."""
    away = torch.tensor([1.5, -1, 0.8, 0.5, -0.6, 1], dtype=torch.float64)
    hill, similarity = quadratic(START + away * UNITS, jags=0.1)
    before = START.clone()
    reached = climb(similarity, START, Hill(samples=(24,) * 4), torch.Generator().manual_seed(3))
    assert torch.equal(before, START)
    assert hill.seen == 4 * 24
    assert ((reached - START) / UNITS - away).norm() < 0.35 * away.norm()
    again = climb(similarity, START, Hill(samples=(24,) * 4), torch.Generator().manual_seed(3))
    assert torch.equal(again, reached)


def test_momentums_first_steps_by_hand() -> None:
    _, similarity = quadratic(START + torch.tensor([2.0, 1, -1, 0, 0, 0]).double() * UNITS)
    start = START[None]
    rate, kept = 0.1, 0.5
    value, slope = similarity.derivatives(start)
    best, values, path = momentum(similarity, start, steps=2, rate=rate, kept=kept, every=2)
    assert path.shape == (3, 1, 2)
    first = rate * slope[0, 0] * UNITS[0] / value[0]
    second_pose = start.clone()
    second_pose[0, 0] += first * UNITS[0]
    second_value, second_slope = similarity.derivatives(second_pose)
    second = kept * first + rate * second_slope[0, 0] * UNITS[0] / value[0]
    third_pose = second_pose.clone()
    third_pose[0, 0] += second * UNITS[0]
    third_pose[0, 2] += rate * second_slope[0, 2] * UNITS[2] / value[0] * UNITS[2]  # every other step
    third_value, _ = similarity.derivatives(third_pose)
    expected = torch.stack([start[0, 0], second_pose[0, 0], third_pose[0, 0]])
    assert_close(path[:, 0, 0], expected)
    assert_close(path[:, 0, 1], torch.cat([value, second_value, third_value]))
    top = int(torch.cat([value, second_value, third_value]).argmax())
    assert_close(values, path[top, :, 1])
    assert_close(best, torch.cat([start, second_pose, third_pose])[top : top + 1])


def test_momentum_climbs_and_keeps_the_best() -> None:
    _, similarity = quadratic(START + torch.tensor([4.0, 0, 0, 0, 0, 0]).double() * UNITS)
    starts = turn_table(START, 36)[[0, 1, 2]]
    best, values, path = momentum(similarity, starts, rate=2.0)
    assert (values >= path[0, :, 1]).all()
    assert_close(values, path[..., 1].amax(0))
    assert_close(similarity.derivatives(best)[0], values)
    assert torch.equal(best[:, [1, 3, 4, 5]], starts[:, [1, 3, 4, 5]])
    assert (best[:, 2] != starts[:, 2]).any()
    assert degrees(float(best[0, 0]), 112) < 4


def test_momentum_keeps_its_distance() -> None:
    _, similarity = quadratic(START - torch.tensor([0, 0, 200.0, 0, 0, 0]).double() * UNITS)
    best, _, _ = momentum(similarity, START[None], every=1)
    assert best[0, 2] >= 1
