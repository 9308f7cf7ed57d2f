"""The circle of azimuths: views all around, local maxima, and votes."""

from __future__ import annotations

import pytest
import torch

from nablahog.pose.placement import (
    azimuth_distance,
    azimuth_sweep,
    equidistant_azimuths,
    local_maxima,
)

from .quadratics import START


def test_equidistant_azimuths() -> None:
    assert equidistant_azimuths(4, 30).tolist() == [30, 120, 210, 300]


def test_distances_go_round() -> None:
    assert azimuth_distance(350, 20) == azimuth_distance(20, 350) == azimuth_distance(380, -10) == 30
    assert azimuth_distance(0, 180) == 180


def test_azimuth_sweep() -> None:
    poses = azimuth_sweep(START, 4)
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
def test_local_maxima(values: list[float], count: int, expected: list[int]) -> None:
    assert local_maxima(torch.tensor(values).double(), count).tolist() == expected


def test_every_circle_has_a_local_maximum() -> None:
    assert len(local_maxima(torch.zeros(8), 3)) == 3
    for values in torch.rand(20, 48):
        assert local_maxima(values, 1).item() == values.argmax()
