"""The paper's gradient ascent with momentum, step by step."""

from __future__ import annotations

import torch
from torch.testing import assert_close

from nablahog.pose.ascent import UNITS, momentum_ascent
from nablahog.pose.model import azimuth_distance, azimuth_sweep

from .quadratics import START, quadratic


def test_momentums_first_steps_by_hand() -> None:
    _, similarity = quadratic(START + torch.tensor([2.0, 1, -1, 0, 0, 0]).double() * UNITS)
    start = START[None]
    learning_rate, momentum = 0.1, 0.5
    value, slope = similarity.derivatives(start)
    options = {"learning_rate": learning_rate, "momentum": momentum}
    best, values, path = momentum_ascent(similarity, start, steps=2, distance_every=2, **options)
    assert path.shape == (3, 1, 2)
    first = learning_rate * slope[0, 0] * UNITS[0] / value[0]
    second_pose = start.clone()
    second_pose[0, 0] += first * UNITS[0]
    second_value, second_slope = similarity.derivatives(second_pose)
    second = momentum * first + learning_rate * second_slope[0, 0] * UNITS[0] / value[0]
    third_pose = second_pose.clone()
    third_pose[0, 0] += second * UNITS[0]
    third_pose[0, 2] += learning_rate * second_slope[0, 2] * UNITS[2] / value[0] * UNITS[2]  # every other step
    third_value, _ = similarity.derivatives(third_pose)
    expected = torch.stack([start[0, 0], second_pose[0, 0], third_pose[0, 0]])
    assert_close(path[:, 0, 0], expected)
    assert_close(path[:, 0, 1], torch.cat([value, second_value, third_value]))
    top = int(torch.cat([value, second_value, third_value]).argmax())
    assert_close(values, path[top, :, 1])
    assert_close(best, torch.cat([start, second_pose, third_pose])[top : top + 1])


def test_momentum_ascends_and_keeps_the_best() -> None:
    _, similarity = quadratic(START + torch.tensor([4.0, 0, 0, 0, 0, 0]).double() * UNITS)
    starts = azimuth_sweep(START, 36)[[0, 1, 2]]
    best, values, path = momentum_ascent(similarity, starts)
    assert (values >= path[0, :, 1]).all()
    assert_close(values, path[..., 1].amax(0))
    assert_close(similarity.derivatives(best)[0], values)
    assert torch.equal(best[:, [1, 3, 4, 5]], starts[:, [1, 3, 4, 5]])
    assert (best[:, 2] != starts[:, 2]).any()
    assert azimuth_distance(float(best[0, 0]), 112) < 4


def test_momentum_keeps_its_distance() -> None:
    _, similarity = quadratic(START - torch.tensor([0, 0, 200.0, 0, 0, 0]).double() * UNITS)
    best, _, _ = momentum_ascent(similarity, START[None], distance_every=1)
    assert best[0, 2] >= 1
