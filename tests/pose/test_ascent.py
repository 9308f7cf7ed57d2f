"""The fitted quadratic and the ascent to its maximum, and the paper's gradient ascent with momentum, step by step."""

from __future__ import annotations

from typing import cast

import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from nablahog.pose import ascent
from nablahog.pose.ascent import UNITS, Round, momentum_ascent, quadratic_ascent
from nablahog.pose.model import azimuth_distance, azimuth_sweep
from nablahog.pose.similarity import Similarity

START = torch.tensor([100.0, 10, 3, 0, 5, -5], dtype=torch.float64)


class Quadratic:
    """A quadratic with its maximum at ``top``, in units of the parameters, jagged by ``jags``."""

    def __init__(self, top: Tensor, bend: Tensor, jags: float = 0.0) -> None:
        self.top, self.bend, self.jags, self.samples = top, bend, jags, 0

    def values(self, poses: Tensor) -> Tensor:
        return self.derivatives(poses)[0]

    def derivatives(self, poses: Tensor) -> tuple[Tensor, Tensor]:
        self.samples += len(poses)
        u = (poses - self.top) / UNITS
        jag, steep = self.jags * torch.sin(50 * u), 50 * self.jags * torch.cos(50 * u)
        values = 7 - 0.5 * torch.einsum("ni,ij,nj->n", u, self.bend, u) + jag.sum(1)
        return values, (steep - u @ self.bend) / UNITS


def quadratic(top: Tensor, jags: float = 0.0) -> tuple[Quadratic, Similarity]:
    mixed = torch.randn(6, 6, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    function = Quadratic(top, torch.eye(6, dtype=torch.float64) + 0.2 * mixed @ mixed.T, jags)
    return function, cast(Similarity, function)


def fitted(top: Quadratic, count: int = 16) -> Tensor:
    half = torch.randn(count // 2, 6, dtype=torch.float64, generator=torch.Generator().manual_seed(2))
    offsets = torch.cat([half, -half])
    values, slopes = top.derivatives(START + offsets * UNITS)
    return ascent._fit_maximum(offsets, values, slopes * UNITS, torch.ones(count).double())[0]


def test_the_top_of_an_exact_quadratic(monkeypatch: pytest.MonkeyPatch) -> None:
    away = torch.tensor([0.5, -0.3, 0.2, 0.1, -0.6, 0.4], dtype=torch.float64)
    top, _ = quadratic(START + away * UNITS)
    assert (fitted(top, 24) - away).norm() < 0.1 * away.norm()  # curvature is held back a little,
    monkeypatch.setattr(ascent, "_STIFFNESS", 0.0)
    assert_close(fitted(top), away, rtol=0, atol=1e-6)  # and by nothing else


def test_curvature_is_held_back_so_that_the_top_seems_farther() -> None:
    """Slopes at the start are exact, since samples come in pairs; a smaller curvature puts the maximum beyond."""
    away = torch.tensor([0.5, -0.3, 0.2, 0.1, -0.6, 0.4], dtype=torch.float64)
    top, _ = quadratic(START + away * UNITS)
    for count in (16, 24, 48):
        assert fitted(top, count) @ away > 1.001 * away @ away


def test_samples_without_weight_do_not_count() -> None:
    away = torch.tensor([0.5, -0.3, 0.2, 0.1, -0.6, 0.4], dtype=torch.float64)
    offsets, weights = torch.randn(40, 6, dtype=torch.float64), torch.ones(40).double()
    values, slopes = quadratic(START + away * UNITS)[0].derivatives(START + offsets * UNITS)
    expected, _ = ascent._fit_maximum(offsets[8:], values[8:], slopes[8:] * UNITS, weights[8:])
    weights[:8], values[:8] = 0, 1e3
    output, _ = ascent._fit_maximum(offsets, values, slopes * UNITS, weights)
    assert_close(output, expected, rtol=0, atol=0.05)


def test_the_hessian_of_an_exact_quadratic(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ascent, "_STIFFNESS", 0.0)
    top, similarity = quadratic(START + 0.3 * UNITS)
    _, hessian = quadratic_ascent(similarity, START, ascent.SCHEDULE, torch.Generator().manual_seed(3))
    assert_close(-hessian * torch.outer(UNITS, UNITS), top.bend, rtol=0, atol=1e-5)


@pytest.mark.parametrize("count", [3, 6, 8, 18])
def test_directions_are_at_right_angles(count: int) -> None:
    offsets = ascent._draw_directions(count, torch.Generator().manual_seed(0))
    assert_close(offsets.square().mean(1), torch.ones(count).double())
    for basis in offsets.split(6):
        assert_close(basis @ basis.T, 6 * torch.eye(len(basis)).double())


def test_values_alone_know_the_top() -> None:
    away = torch.tensor([0.5, -0.3, 0.2, 0.1, -0.6, 0.4], dtype=torch.float64)
    offsets = torch.randn(80, 6, dtype=torch.float64, generator=torch.Generator().manual_seed(2))
    values, slopes = quadratic(START + away * UNITS)[0].derivatives(START + offsets * UNITS)
    weights = torch.ones(80).double()
    output, _ = ascent._fit_maximum(offsets, values, torch.full_like(slopes, torch.nan), weights)
    assert (output - away).norm() < 0.1 * away.norm()
    some = torch.where(torch.arange(80)[:, None] < 8, slopes * UNITS, torch.nan)
    assert (ascent._fit_maximum(offsets, values, some, weights)[0] - away).norm() < (output - away).norm()


def test_a_top_far_away_is_only_approached() -> None:
    away = torch.tensor([9.0, 0, 0, 0, 0, 0], dtype=torch.float64)
    output = fitted(quadratic(START + away * UNITS)[0])
    assert output.norm() == pytest.approx(ascent._LONGEST_STEP)
    assert output[0] > 0.9 * ascent._LONGEST_STEP


def test_a_valley_is_left_uphill() -> None:
    away = torch.tensor([0.3, 0, 0, 0.1, 0, 0], dtype=torch.float64)
    top, _ = quadratic(START + away * UNITS)
    top.bend = -top.bend
    assert torch.dot(fitted(top), -away @ -top.bend) > 0


def test_a_plain_has_no_top() -> None:
    offsets = torch.randn(8, 6, dtype=torch.float64)
    values, slopes = torch.ones(8).double(), torch.zeros(8, 6).double()
    output, _ = ascent._fit_maximum(offsets, values, slopes, torch.ones(8).double())
    assert torch.isfinite(output).all()
    assert output.norm() <= ascent._LONGEST_STEP + 1e-9


def test_ascent_on_a_jagged_quadratic() -> None:
    """Slopes of jags are ten times those of the quadratic."""
    away = torch.tensor([1.5, -1, 0.8, 0.5, -0.6, 1], dtype=torch.float64)
    top, similarity = quadratic(START + away * UNITS, jags=0.1)
    rounds = [Round(24, 0.8 * 0.6**k, slopes=k < 2) for k in range(4)]
    before = START.clone()
    result, _ = quadratic_ascent(similarity, START, rounds, torch.Generator().manual_seed(3))
    assert torch.equal(before, START)
    assert top.samples == 4 * 24
    assert ((result - START) / UNITS - away).norm() < 0.35 * away.norm()
    again, _ = quadratic_ascent(similarity, START, rounds, torch.Generator().manual_seed(3))
    assert torch.equal(again, result)


def test_a_far_top_is_reached_by_repeats_alone() -> None:
    away = torch.tensor([9.0, 0, 0, 0, 0, 0], dtype=torch.float64)
    left = []
    for repeats in (0, 8):
        top, similarity = quadratic(START + away * UNITS)
        pose, _ = quadratic_ascent(
            similarity, START, ascent.SCHEDULE, torch.Generator().manual_seed(3), repeats=repeats
        )
        left.append(float(((pose - START) / UNITS - away).norm()))
        most = sum(round_.samples for round_ in ascent.SCHEDULE) + 4 * repeats
        assert top.samples <= most
    assert left[0] > 2 > 0.1 > left[1]


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
