"""Batched L-BFGS on problems with known minima."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import torch
from torch import Tensor

from nablahog.optimize import Minimum, ObjectiveFunction, StopReason, lbfgs
from nablahog.optimize.lbfgs import LbfgsVectors, decided
from nablahog.optimize.lbfgs_device import DeviceVectors
from nablahog.optimize.lbfgs_masks import decide
from nablahog.optimize.lbfgs_state import SearchState


def problem(function: Callable[[Tensor], Tensor]) -> ObjectiveFunction:
    """An objective from a function of points (A, N) to values (A,)."""

    def objective(x: Tensor, index: Tensor) -> tuple[Tensor, Tensor]:
        x = x.detach().requires_grad_()
        value = function(x)
        (gradient,) = torch.autograd.grad(value.sum(), x)
        return value.detach(), gradient

    return objective


def starts(batch: int, n: int, seed: int = 0, dtype: torch.dtype = torch.float64) -> Tensor:
    return torch.randn((batch, n), generator=torch.Generator().manual_seed(seed), dtype=dtype)


def quadratic(x: Tensor) -> Tensor:
    return (torch.logspace(0, 3, x.shape[1], dtype=x.dtype) * x.square()).sum(1) / 2


def rosenbrock(x: Tensor) -> Tensor:
    return (100 * (x[:, 1:] - x[:, :-1] ** 2) ** 2 + (1 - x[:, :-1]) ** 2).sum(1)


def logistic(x: Tensor) -> Tensor:
    return torch.nn.functional.softplus(x).sum(1) + 0.05 * x.square().sum(1)


@pytest.mark.parametrize(("function", "n"), [(quadratic, 50), (rosenbrock, 2), (logistic, 20)])
def test_reaches_the_known_minimum(function: Callable[[Tensor], Tensor], n: int) -> None:
    result = lbfgs(problem(function), starts(5, n), max_evaluations=500, gradient_tolerance=1e-7)
    assert result.stop_reason == [StopReason.GRADIENT] * 5
    for row in result.x:  # the gradient vanishes there, by an independent evaluation
        assert torch.func.grad(lambda x: function(x[None])[0])(row).abs().max() <= 1e-7
    if function is rosenbrock:
        torch.testing.assert_close(result.x, torch.ones_like(result.x), atol=1e-6, rtol=0)


def test_a_kink_is_no_obstacle() -> None:
    # min |x0| + 10 |x1 - x0²|: kinks along a curve, minimum 0 at the origin
    result = lbfgs(problem(lambda x: x[:, 0].abs() + 10 * (x[:, 1] - x[:, 0] ** 2).abs()), starts(6, 2))
    assert result.value.max() < 1e-3


def test_problems_do_not_influence_each_other() -> None:
    start = starts(4, 6) * torch.tensor([[0.1], [1.0], [3.0], [10.0]])
    together = lbfgs(problem(rosenbrock), start, max_evaluations=60)
    for i in range(4):
        alone = lbfgs(problem(rosenbrock), start[i : i + 1], max_evaluations=60)
        torch.testing.assert_close(together.x[i], alone.x[0], rtol=1e-6, atol=1e-9)
        assert together.evaluations[i] == alone.evaluations[0]


@pytest.mark.parametrize("n", [5, 16, 77])
def test_each_problem_ends_where_it_would_alone(n: int) -> None:
    start = starts(9, n) * torch.logspace(-3, 1, 9).double().unsqueeze(1)[torch.arange(9) * 4 % 9]

    def result(rows: slice) -> Minimum:
        return lbfgs(problem(logistic), start[rows], max_evaluations=200, memory=5, gradient_tolerance=1e-6)

    together = result(slice(None))
    assert len(set(together.evaluations.tolist())) > 2  # so that rows are moved into the gaps of those that ended
    for i in range(9):
        alone = result(slice(i, i + 1))
        torch.testing.assert_close(together.x[i], alone.x[0])
        assert together.stop_reason[i] == alone.stop_reason[0] == StopReason.GRADIENT
        assert together.evaluations[i] == alone.evaluations[0]
        torch.testing.assert_close(together.history[: len(alone.history), i], alone.history[:, 0])
        assert (together.history[len(alone.history) :, i] == together.history[-1, i]).all()


def on_cpu(vectors: LbfgsVectors, state: SearchState, gradient: Tensor, values: Tensor) -> SearchState:
    """To trial points of these gradients (B, N) and values (B,), by the compiled loops."""
    vectors.take_step(*decided(state, values, vectors.dots(gradient)), gradient, state.slopes, state.peaks)
    return state


def on_device(vectors: DeviceVectors, state: SearchState, gradient: Tensor, values: Tensor) -> SearchState:
    """The same by operations of PyTorch."""
    running = torch.ones(len(values), dtype=torch.bool)
    after, decisions = decide(state, running, values, vectors.dots(gradient))
    vectors.take_step(state.steps, decisions, gradient)
    slopes, peaks = torch.linalg.vecdot(vectors.gradient, vectors.direction), vectors.gradient.abs().amax(1)
    return after._replace(
        slopes=torch.where(decisions.moves, slopes, state.slopes),
        peaks=torch.where(decisions.moves, peaks, state.peaks),
    )


BOTH: dict[str, Any] = {"loops": (LbfgsVectors, on_cpu), "masks": (DeviceVectors, on_device)}
both = pytest.mark.parametrize("kind", BOTH)


@both
@pytest.mark.parametrize("n", [9, 64, 1100])
def test_the_direction_is_that_of_the_two_loops(kind: str, n: int) -> None:
    # the recursion on the vectors themselves, Nocedal & Wright, algorithm 7.4
    make, advance = BOTH[kind]
    gradient, x, pairs = starts(1, n), starts(1, n), []
    vectors = make(x.clone(), gradient.clone(), torch.zeros(1, n).double(), 3)
    zeros = torch.zeros(1).double()
    state = SearchState.at_start(zeros.clone(), zeros.clone(), zeros.clone(), 3)
    for seed in range(1, 7):
        s = starts(1, n, seed)
        y = s * torch.linspace(0.5, 3, n) + 0.1 * starts(1, n, seed + 100)
        gradient, x, pairs = gradient + y, x + s, [*pairs, (s[0], y[0])][-3:]
        vectors.direction[:], state.slopes[:] = s, -1e9  # so steep that any trial is far down and flat enough
        state = advance(vectors, state, gradient, torch.tensor([-1e15 * seed], dtype=torch.float64))
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
        torch.testing.assert_close(state.slopes[0], -q @ gradient[0])
        torch.testing.assert_close(state.peaks[0], gradient.abs().max())


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("n", [1, 63, 64, 1025, 2500])
def test_loops_do_what_masks_do(n: int, dtype: torch.dtype) -> None:
    def searched(kind: str) -> Any:
        make, advance = BOTH[kind]
        gradient, zeros = starts(4, n, 1, dtype), torch.zeros(4, dtype=dtype)
        vectors = make(starts(4, n, 2, dtype), gradient.clone(), -gradient, 2)
        state = SearchState.at_start(zeros.clone(), gradient.abs().amax(1), -gradient.square().sum(1), 2)
        for turn in range(4):
            # one that rises and stays, one without curvature that goes on but is not remembered, and two ordinary ones
            values = torch.tensor([1.0, -1e9, -1e9, -1e9], dtype=dtype) * (turn + 1)
            change = vectors.direction * torch.tensor([[1.0], [-0.1], [0.5], [0.7]], dtype=dtype)
            state = advance(vectors, state, vectors.gradient + change, values)
        return vectors

    masked, loops = searched("masks"), searched("loops")
    rounding = 2e-5 if dtype == torch.float32 else 1e-12
    masked.stored = masked.stored[:, :-1]  # without what was not to be stored
    for name in ("x", "gradient", "direction", "stored"):
        mine, theirs = getattr(masked, name), getattr(loops, name)
        torch.testing.assert_close(theirs, mine, rtol=rounding, atol=rounding * float(mine.abs().max()))
    assert torch.equal(masked.x[0], starts(4, n, 2, dtype)[0])
    assert not masked.stored[1].any()


@pytest.mark.parametrize("memory", [1, 4])
def test_masks_decide_as_loops_do(memory: int) -> None:
    """Random states of line searches: bracketed or not, without pairs, with some, with more than are kept; NaN."""
    batch, generator = 400, torch.Generator().manual_seed(memory)

    def normal(*shape: int) -> Tensor:
        return torch.randn(batch, *shape, generator=generator, dtype=torch.float64)

    s, y = normal(memory, 3 * memory + 2), normal(memory, 3 * memory + 2)
    y = s + 0.3 * y  # of positive curvature
    vectors = torch.cat([s, y], dim=1)
    lows = normal().abs() * (normal() > 0)
    state = SearchState(
        values=normal(),
        slopes=-normal().abs(),
        steps=lows + normal().abs(),
        lows=lows,
        highs=torch.where(normal() > 0, torch.inf, lows + 9),
        pairs=torch.randint(0, 3 * memory, (batch,), generator=generator),
        products=y @ vectors.mT,
        with_gradient=(vectors @ normal(3 * memory + 2, 1)).squeeze(2),
        peaks=normal().abs(),
    )
    values, dots = state.values + 0.5 * normal(), normal(2 * memory + 4)
    values[::17] = torch.nan
    running = torch.ones(batch, dtype=torch.bool)
    masked, decisions = decide(state, running, values, dots)
    loops = SearchState(*(tensor.clone() for tensor in state))
    taken, places, coefficients = decided(loops, values, dots)
    assert torch.equal(decisions.moves, taken > 0)
    assert torch.equal(decisions.stays, taken == 0)
    assert 50 < int(decisions.moves.sum()) < batch - 50
    assert torch.equal(decisions.stores, places >= 0)
    assert 20 < int(decisions.stores.sum()) < int(decisions.moves.sum())
    assert torch.equal(decisions.places[decisions.stores], places[decisions.stores])
    torch.testing.assert_close(decisions.coefficients[decisions.moves], coefficients[decisions.moves])
    for name in SearchState._fields:
        torch.testing.assert_close(getattr(masked, name), getattr(loops, name), msg=name)
    ended, nothing = decide(state, ~running, values, dots)
    assert not (nothing.moves | nothing.stays | nothing.stores).any()
    for name in SearchState._fields:
        assert torch.equal(getattr(ended, name), getattr(state, name)), name


def test_budget_is_kept_and_the_result_never_worse_than_the_start() -> None:
    calls = 0

    def counted(x: Tensor, index: Tensor) -> tuple[Tensor, Tensor]:
        nonlocal calls
        calls += 1
        return problem(rosenbrock)(x, index)

    start = starts(3, 8)
    result = lbfgs(counted, start, max_evaluations=7)
    assert calls == 7
    assert result.evaluations.tolist() == [7] * 3
    assert result.stop_reason == [StopReason.BUDGET] * 3
    assert result.history.shape == (7, 3)
    assert (result.history.diff(dim=0) <= 0).all()
    assert (result.value < rosenbrock(start)).all()
    torch.testing.assert_close(result.value, rosenbrock(result.x))


def test_one_evaluation_returns_the_start() -> None:
    start = starts(2, 3)
    result = lbfgs(problem(quadratic), start, max_evaluations=1)
    assert torch.equal(result.x, start)


def test_each_problem_stops_for_its_own_reason() -> None:
    scale = torch.tensor([[0.0], [1.0]], dtype=torch.float64)

    def objective(x: Tensor, index: Tensor) -> tuple[Tensor, Tensor]:
        # the first problem is constant: its gradient is zero at once
        return (scale[index] * x.square()).sum(1), 2 * scale[index] * x

    result = lbfgs(objective, starts(2, 3), max_evaluations=50, progress_tolerance=1e-3)
    assert result.stop_reason[0] == StopReason.GRADIENT
    assert result.evaluations[0] < result.evaluations[1]
    slow = lbfgs(problem(lambda x: 1 + quadratic(x)), starts(1, 50), max_evaluations=500, progress_tolerance=1e-3)
    assert slow.stop_reason == [StopReason.PROGRESS]
    assert slow.evaluations[0] < 500


def test_a_gradient_that_lies_ends_the_line_search() -> None:
    result = lbfgs(lambda x, index: (x.square().sum(1), -2 * x), starts(1, 3), max_evaluations=500)
    assert result.stop_reason == [StopReason.LINE_SEARCH]


def test_steps_into_nan_are_taken_back() -> None:
    # √(x - 1) + 1/(x - 1), undefined for x <= 1
    result = lbfgs(
        problem(lambda x: ((x - 1).sqrt() + 1 / (x - 1)).sum(1)), torch.full((2, 2), 1.05).double(), first_step=5
    )
    assert torch.isfinite(result.x).all()
    torch.testing.assert_close(result.x, torch.full_like(result.x, 1 + 2 ** (2 / 3)), rtol=1e-4, atol=0)


def test_float32_agrees_with_float64() -> None:
    single = lbfgs(problem(logistic), starts(3, 20, dtype=torch.float32), max_evaluations=60)
    double = lbfgs(problem(logistic), starts(3, 20, dtype=torch.float32).double(), max_evaluations=60)
    torch.testing.assert_close(single.value.double(), double.value, rtol=1e-6, atol=0)
