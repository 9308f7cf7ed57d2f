"""Minimisers as they run on a device, on a CPU: nothing waits between two looks, and results are those of a CPU."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
import torch
from torch import Tensor
from torch.utils._python_dispatch import _disable_current_modes

from nablahog.optimize import MINIMISERS, Minimiser, Minimum, StopReason
from nablahog.optimize.dogleg import DoglegSearch
from nablahog.optimize.lbfgs import LbfgsSearch
from nablahog.optimize.problems import ROUNDS_BETWEEN_LOOKS

from ..waiting import WithoutWaiting
from .problems import SumOfSquares, exponentials, mixed, rosenbrock


@pytest.fixture
def on_device(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Minimum]:
    """The minimiser of a name as it runs on a device."""

    def run(name: Minimiser, *args: Any, **options: Any) -> Minimum:
        with monkeypatch.context() as patch:
            patch.setattr("nablahog.optimize.problems.dropped_at_once", lambda like: False)
            return on_cpu(name, *args, **options)

    return run


def on_cpu(name: Minimiser, *args: Any, **options: Any) -> Minimum:
    return MINIMISERS[name](*args, **options)


def many_rosenbrocks(x: Tensor, index: Tensor) -> tuple[Tensor, Tensor]:
    """Each of its own steepness, with its gradient."""
    steep = 10.0 ** (index.to(x) % 4 - 1)
    a, b = x[:, 1] - x[:, 0].square(), 1 - x[:, 0]
    value = steep * a.square() + b.square()
    return value, torch.stack([-4 * steep * a * x[:, 0] - 2 * b, 2 * steep * a], dim=1)


def walls(x: Tensor, index: Tensor) -> tuple[Tensor, Tensor]:
    """√(x - 1) + 1/(x - 1), undefined for x <= 1; the third is constant, the gradient of the fourth lies."""
    value = ((x - 1).sqrt() + 1 / (x - 1)).sum(1)
    gradient = 0.5 * (x - 1).rsqrt() - 1 / (x - 1).square()
    constant, lies = (index == 2).unsqueeze(1), (index == 3).unsqueeze(1)
    value = torch.where(index == 2, 1.0, torch.where(index == 3, x.square().sum(1), value))
    return value, torch.where(constant, 0.0, torch.where(lies, -2 * x, gradient))


def starts(batch: int, n: int) -> Tensor:
    return torch.randn(batch, n, generator=torch.Generator().manual_seed(batch), dtype=torch.float64)


def problems() -> dict[str, tuple[Any, Tensor]]:
    not_finite = 1.3 + starts(5, 3).abs()
    not_finite[4] = 0.5
    return {"mixed": mixed(), "rosenbrocks": (many_rosenbrocks, starts(12, 2)), "walls": (walls, not_finite)}


PROBLEMS = tuple(problems())


def same(one: Minimum, other: Minimum, rounding: float) -> None:
    assert one.stop_reason == other.stop_reason
    assert torch.equal(one.evaluations, other.evaluations)
    assert one.history.shape == other.history.shape
    for name in ("x", "value", "history"):
        torch.testing.assert_close(
            getattr(one, name), getattr(other, name), rtol=rounding, atol=rounding, equal_nan=True, msg=name
        )


@pytest.mark.parametrize("problem", PROBLEMS)
@pytest.mark.parametrize("budget", [1, 9, 10, 11, 45])
def test_results_are_those_on_a_cpu(problem: str, budget: int, on_device: Callable[..., Minimum]) -> None:
    options: dict[str, Any] = {"max_evaluations": budget, "gradient_tolerance": 1e-4, "progress_tolerance": 1e-2}
    results = []
    for run in (on_cpu, on_device):
        objective, start = problems()[problem]
        results.append(run("lbfgs", objective, start, **options))
    same(*results, rounding=1e-5)  # which grows from step to step
    if budget == 45 and problem == "rosenbrocks":
        assert len(set(results[1].evaluations.tolist())) > 4  # so that many end between two looks


def test_problems_that_end_between_two_looks_report_their_end(on_device: Callable[..., Minimum]) -> None:
    told: dict[int, list[int]] = {}

    def watch(index: Tensor, evaluations: Tensor) -> None:
        for problem, spent in zip(index.tolist(), evaluations.tolist(), strict=True):
            told.setdefault(problem, []).append(spent)

    result = on_device("lbfgs", many_rosenbrocks, starts(12, 2), gradient_tolerance=0.2, watch=watch)
    ended = torch.tensor([reason == StopReason.GRADIENT for reason in result.stop_reason])
    assert ended.sum() > 8
    value, gradient = many_rosenbrocks(result.x, torch.arange(12))
    assert gradient[ended].abs().max() <= 0.2
    torch.testing.assert_close(value, result.value)
    for problem, spent in told.items():
        end = int(result.evaluations[problem])
        assert spent[:end] == list(range(1, end + 1))
        assert set(spent[end:]) <= {end}  # told again as it was
        assert len(spent) < end + ROUNDS_BETWEEN_LOOKS
    assert max(len(spent) - spent[-1] for spent in told.values()) > 0


needs_gpu = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")


@contextmanager
def no_synchronisation(device: str) -> Iterator[None]:
    """On a GPU, fails where PyTorch itself says that it waits."""
    if device != "cuda":
        yield
        return
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # PyTorch says that it does not see all of it
        torch.cuda.set_sync_debug_mode("error")
    try:
        yield
    finally:
        torch.cuda.set_sync_debug_mode("default")


@pytest.mark.parametrize("function", [rosenbrock, exponentials, None])
@pytest.mark.parametrize("options", [{}, {"radius": 0.3, "progress_tolerance": 1e-3}])
def test_the_dogleg_does_what_it_does_on_a_cpu(
    function: Callable[[Tensor], Tensor] | None, options: dict[str, Any], on_device: Callable[..., Minimum]
) -> None:
    """Although conjugate gradients go on when all have their steps: a device is not asked."""
    if function is None:
        (problem, start), options = mixed(), {"cg_tolerance": 1e-6, **options}
    else:
        problem, start = SumOfSquares(lambda x, index: function(x)), starts(6, 3 if function is exponentials else 2)
    results = [run("dogleg", problem, start, max_evaluations=60, **options) for run in (on_cpu, on_device)]
    same(*results, rounding=0)


@pytest.mark.slow
def test_the_dogleg_waits_once_a_trial(on_device: Callable[..., Minimum], monkeypatch: pytest.MonkeyPatch) -> None:
    """But for reading what has become of a trial, steps and trials ask for no number."""
    trials, look = 0, DoglegSearch.look

    def counted(self: DoglegSearch, accepted: Tensor) -> None:
        nonlocal trials
        trials += 1
        with _disable_current_modes():
            look(self, accepted)

    def checked(own: Callable[[DoglegSearch], None]) -> Callable[[DoglegSearch], None]:
        def run(self: DoglegSearch) -> None:
            with WithoutWaiting():
                own(self)

        return run

    monkeypatch.setattr(DoglegSearch, "look", counted)
    for name in ("linearize", "try_step"):
        monkeypatch.setattr(DoglegSearch, name, checked(getattr(DoglegSearch, name)))
    result = on_device("dogleg", SumOfSquares(lambda x, index: rosenbrock(x)), starts(6, 2), max_evaluations=40)
    assert trials > 5
    assert result.value.max() < 1


@pytest.mark.parametrize("device", ["cpu", "meta", pytest.param("cuda", marks=needs_gpu)])
def test_rounds_ask_for_no_number(device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("nablahog.optimize.problems.dropped_at_once", lambda like: False)
    told: list[tuple[Tensor, Tensor]] = []
    search = LbfgsSearch(many_rosenbrocks, starts(12, 2).to(device), 6, 1.0, lambda *now: told.append(now))
    with WithoutWaiting(), no_synchronisation(device):
        for _ in range(2, ROUNDS_BETWEEN_LOOKS):  # none of which looks
            search.advance()
            search.end(1e-3, 1e-3)
    assert len(told) == ROUNDS_BETWEEN_LOOKS - 1
