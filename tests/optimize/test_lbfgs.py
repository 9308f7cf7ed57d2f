"""Batched L-BFGS on problems with known minima."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from nablahog import native
from nablahog.optimize import StopReason, lbfgs
from nablahog.optimize.lbfgs import NativeVectors, Vectors
from nablahog.optimize.lbfgs_decisions import Decisions, SearchState, decide

ARMIJO, CURVATURE = 1e-4, 0.9  # Nocedal & Wright, p. 62


def starts(batch: int, n: int, seed: int = 0, dtype: torch.dtype = torch.float64) -> Tensor:
    return torch.randn((batch, n), generator=torch.Generator().manual_seed(seed), dtype=dtype)


needs_library = pytest.mark.skipif(not native.available(), reason="needs the compiled loops")
both = pytest.mark.parametrize("kind", [Vectors, pytest.param(NativeVectors, marks=needs_library)])


@both
@pytest.mark.parametrize("n", [9, 64, 1100])
def test_the_direction_is_that_of_the_two_loops(kind: type[Vectors], n: int) -> None:
    # the recursion on the vectors themselves, Nocedal & Wright, algorithm 7.4
    gradient, x, pairs = starts(1, n), starts(1, n), []
    vectors, state = kind(x, gradient, 3, 1.0), SearchState.from_values(np.zeros(1), 3)
    for seed in range(1, 8):
        s = starts(1, n, seed)
        y = s * torch.linspace(0.5, 3, n) + 0.1 * starts(1, n, seed + 100)
        if seed == 6:
            state, pairs = state.without_pairs(np.ones(1, bool)), []  # whose vectors are still there
        gradient, x, pairs = gradient + y, x + s, [*pairs, (s[0], y[0])][-3:]
        vectors.direction[:], vectors.slopes[:] = s, -1e9  # so steep that any trial is far down and flat enough
        dots = vectors.dots(gradient)
        state, decisions = decide(state, np.ones(1, bool), vectors.slopes, np.array([-1e15 * seed]), dots)
        vectors.take_step(decisions, gradient)
        q, alphas = gradient[0].clone(), []
        for s_i, y_i in reversed(pairs):
            alphas.append(s_i @ q / (s_i @ y_i))
            q -= alphas[-1] * y_i
        q *= pairs[-1][0] @ pairs[-1][1] / (pairs[-1][1] @ pairs[-1][1])
        for (s_i, y_i), alpha in zip(pairs, reversed(alphas), strict=True):
            q += s_i * (alpha - y_i @ q / (s_i @ y_i))
        torch.testing.assert_close(vectors.direction[0], -q)
        torch.testing.assert_close(vectors.x, x)
        torch.testing.assert_close(vectors.gradient, gradient)
        assert vectors.slopes[0] == pytest.approx(float(-q @ gradient[0]))
        assert vectors.peaks[0] == gradient.abs().max()


@needs_library
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("n", [1, 63, 64, 1025, 2500])
@pytest.mark.parametrize("memory", [1, 2, 5])
def test_loops_do_what_pytorch_does(n: int, dtype: torch.dtype, memory: int) -> None:
    plain, loops = (
        kind(starts(4, n, 1, dtype), starts(4, n, 2, dtype), memory, 1.0) for kind in (Vectors, NativeVectors)
    )
    rounding = 1e-4 if dtype == torch.float32 else 1e-12

    def same(one: Tensor | np.ndarray, other: Tensor | np.ndarray) -> None:
        one, other = torch.as_tensor(one), torch.as_tensor(other)
        torch.testing.assert_close(one, other, rtol=rounding, atol=rounding * float(other.abs().max()))

    for turn in range(2 * memory + 1):
        gradient, numbers = starts(4, n, 10 + turn, dtype), starts(4, 2 * memory + 1, 50 + turn, dtype).numpy() / 9
        steps = np.array([0, 0.1, 0.5, 2], numbers.dtype)  # the first stays, the second stores nothing
        stores = np.array([False, False, True, turn != 1])
        same(loops.dots(gradient), plain.dots(gradient))
        for vectors in (plain, loops):
            vectors.take_step(Decisions(steps, steps == 0, stores, numbers), gradient)
        for name in ("x", "gradient", "direction", "slopes", "peaks"):
            same(getattr(loops, name), getattr(plain, name))
    assert torch.equal(loops.x[0], starts(4, n, 1, dtype)[0])
    assert not loops.dots(gradient)[1, :-4].any()


def wolfe(value: float, slope: float, trial: float, step: float, low: float, high: float) -> tuple[float, float, float]:
    """The next step in its bracket, one problem by itself, where the trial was not accepted."""
    if trial <= value + ARMIJO * step * slope:
        low = step
        if high == np.inf:
            return 2 * step, low, high
        guess = step
    else:
        high = step
        guess = -slope * step**2 / (2 * (trial - value - step * slope))
    if low > 0:
        guess = (low + high) / 2
    tenth = (high - low) / 10
    return (low + tenth if np.isnan(guess) else min(max(guess, low + tenth), high - tenth)), low, high


@pytest.mark.parametrize("memory", [1, 4])
def test_decisions(memory: int) -> None:
    """Random states of line searches: bracketed or not, without pairs or with some; NaN."""
    batch, rng = 400, np.random.default_rng(memory)
    state, dots = SearchState.from_values(rng.normal(size=batch), memory), rng.normal(size=(batch, 2 * memory + 4))
    for _ in range(3):
        state, _ = decide(state, np.ones(batch, bool), np.full(batch, -9.0), state.values - 20, dots)
        dots = rng.normal(size=dots.shape)
    lows = np.abs(rng.normal(size=batch)) * (rng.normal(size=batch) > 0)
    highs = np.where(rng.normal(size=batch) > 0, np.inf, lows + 9)
    steps, slopes = lows + np.abs(rng.normal(size=batch)), -np.abs(rng.normal(size=batch))
    trials, dots = state.values + 0.5 * rng.normal(size=batch), rng.normal(size=dots.shape)
    trials[::17] = np.nan
    for k, share in ((1, 0.9), (2, 1.1)):  # of Armijo's least decrease
        trials[k::17] = (state.values + share * ARMIJO * steps * slopes)[k::17]
    running = np.arange(batch) % 5 > 0
    state = state._replace(steps=steps, lows=lows, highs=highs)
    after, decisions = decide(state, running, slopes, trials, dots)

    for i in range(batch):
        enough = trials[i] <= state.values[i] + ARMIJO * steps[i] * slopes[i]
        numbers = steps[i], lows[i], highs[i]
        moves = enough and dots[i, -4] >= CURVATURE * slopes[i] and running[i]
        if moves:
            numbers = 1, 0, np.inf
        elif running[i]:
            numbers = wolfe(state.values[i], slopes[i], trials[i], *numbers)
        np.testing.assert_allclose((after.steps[i], after.lows[i], after.highs[i]), numbers)
        assert after.values[i] == (trials[i] if moves else state.values[i])
        assert decisions.steps[i] == (steps[i] if moves else 0)
        assert decisions.stays[i] == (running[i] and not moves)
        assert decisions.stores[i] == (moves and steps[i] * dots[i, -3] > np.finfo(float).eps * dots[i, -2])
    assert 20 < decisions.stores.sum() < (decisions.steps > 0).sum() < batch - 100

    # the same on a device
    there = SearchState(*map(torch.from_numpy, state))
    arrays = (torch.from_numpy(each) for each in (running, slopes, trials, dots))
    for ours, theirs in zip((*after, *decisions), sum(decide(there, *arrays), ()), strict=True):
        torch.testing.assert_close(theirs, torch.from_numpy(ours), equal_nan=True)


def test_a_gradient_that_lies_ends_the_line_search() -> None:
    result = lbfgs(lambda x, index: (x.square().sum(1), -2 * x), starts(1, 3), max_evaluations=500)
    assert result.stop_reason == [StopReason.LINE_SEARCH]
