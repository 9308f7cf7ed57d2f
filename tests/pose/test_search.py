"""The parts of the search: views all around, their summits, and the paper's momentum by hand."""

from __future__ import annotations

import pytest
import torch
from torch.testing import assert_close

from nablahog.pose.search import UNITS, consensus, momentum, summits, turn_table

from .hills import START, quadratic


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
