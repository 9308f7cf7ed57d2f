"""What all minimisers have in common, on the same problems: those of the package, and the one in the gallery."""

from __future__ import annotations

import ast
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from nablahog.optimize import MINIMISERS, Minimum, StopReason

from .problems import CASES, SumOfSquares, mixed, only

GALLERY = Path(__file__).parents[2] / "docs" / "gallery" / "plot_extend_minimiser.py"


def load_from_gallery(name: str) -> Callable[..., Minimum]:
    """A function of the script by its text, with the imports from PyTorch and the package, without the pictures."""
    namespace: dict[str, Any] = {}
    tree = ast.parse(GALLERY.read_text(encoding="utf-8"))
    tree.body = [
        node
        for node in tree.body
        if (isinstance(node, ast.FunctionDef) and node.name == name)
        or (isinstance(node, ast.Import) and node.names[0].name == "torch")
        or (isinstance(node, ast.ImportFrom) and str(node.module).startswith(("torch", "nablahog")))
    ]
    exec(compile(tree, GALLERY, "exec"), namespace)
    return namespace[name]  # type: ignore[no-any-return]


ALL: dict[str, Callable[..., Minimum]] = {**MINIMISERS, "gallery": load_from_gallery("nesterov")}
SECOND_ORDER = ("dogleg", "lbfgs")  # the others are slow in narrow valleys
WIDE = ("round", "beale")
all_minimisers = pytest.mark.parametrize("name", ALL)


@all_minimisers
@pytest.mark.parametrize("case", CASES)
def test_reaches_the_known_minimum(name: str, case: str) -> None:
    """Those of first order at least descend in narrow valleys."""
    result = ALL[name](CASES[case].problem(), CASES[case].points(), max_evaluations=400)
    assert result.value < 1e-3 * result.history[0]
    if name in SECOND_ORDER or case in WIDE:
        assert result.value < 1e-8
        far = (result.x[0] - torch.tensor(CASES[case].minimum, dtype=torch.float64)).abs().max()
        assert far < (1e-3 if case == "powell" else 1e-4)  # whose valley is quartic


@all_minimisers
def test_mixed_problems_do_not_influence_each_other(name: str) -> None:
    """Also where rows are moved into the gaps of those that ended."""
    problem, start = mixed()
    together = ALL[name](problem, start, max_evaluations=80, gradient_tolerance=0.1)
    for row in range(3):
        alone = ALL[name](only(problem, row), start[row : row + 1], max_evaluations=80, gradient_tolerance=0.1)
        torch.testing.assert_close(together.x[row], alone.x[0], rtol=1e-6, atol=1e-9)
        assert together.evaluations[row] == alone.evaluations[0]
        assert together.stop_reason[row] == alone.stop_reason[0]
        length = len(alone.history)
        torch.testing.assert_close(together.history[:length, row], alone.history[:, 0], rtol=1e-6, atol=1e-12)
        assert (together.history[length:, row] == together.history[length - 1, row]).all()


@all_minimisers
@pytest.mark.parametrize("budget", [1, 3, 7, 30])
def test_budget_and_watch(name: str, budget: int) -> None:
    problem, start = mixed()
    seen: list[tuple[list[int], list[int]]] = []
    result = ALL[name](
        problem, start, max_evaluations=budget, watch=lambda i, spent: seen.append((i.tolist(), spent.tolist()))
    )
    assert result.evaluations.max() <= budget
    assert result.history.shape == (int(result.evaluations.max()), 3)
    if budget <= 7:
        assert result.stop_reason == [StopReason.BUDGET] * 3
    # once for each call of the objective
    assert len(seen) == len(problem.points)
    assert seen[0] == ([0, 1, 2], [1, 1, 1])
    last = {row: spent for rows, spends in seen for row, spent in zip(rows, spends, strict=True)}
    assert all(last[row] <= result.evaluations[row] for row in range(3))


@all_minimisers
def test_returns_the_lowest_point_evaluated(name: str) -> None:
    problem, start = mixed()
    rows = torch.arange(3)
    result = ALL[name](problem, start, max_evaluations=25)
    values = torch.stack(
        [problem.function(points, rows).square().sum(1) for points in problem.points if len(points) == 3]
    )
    torch.testing.assert_close(result.value, problem.function(result.x, rows).square().sum(1))
    assert (result.value <= values.amin(0) * (1 + 1e-12)).all()
    assert (result.value <= result.history.amin(0)).all()


@all_minimisers
def test_a_constant_problem_stops_at_once_and_no_other_does(name: str) -> None:
    scale = torch.tensor([[0.0], [1.0]], dtype=torch.float64)
    problem = SumOfSquares(lambda x, index: scale[index] * x**2 + 1)
    start = torch.full((2, 3), 2.0, dtype=torch.float64)
    result = ALL[name](problem, start, max_evaluations=40)
    assert result.stop_reason[0] == StopReason.GRADIENT
    assert result.evaluations[0] <= 2
    assert torch.equal(result.x[0], start[0])
    assert result.evaluations[1] > 5
    assert result.value[1] < result.history[0, 1]


@all_minimisers
def test_stops_when_there_is_no_progress(name: str) -> None:
    """As a share of the value: after as many evaluations whatever its unit."""
    spent = []
    for unit in (1, 64):
        problem = SumOfSquares(
            lambda x, index, unit=unit: (
                unit * torch.cat([CASES["long"].residuals(x), torch.ones(len(x), 1)], dim=1).double()
            )
        )
        result = ALL[name](problem, CASES["long"].points(), max_evaluations=2000, progress_tolerance=1e-3)
        assert result.stop_reason == [StopReason.PROGRESS]
        assert result.value < 1.1 * unit**2
        spent.append(int(result.evaluations))
    assert spent[0] == spent[1]


@all_minimisers
def test_stops_when_the_gradient_is_small(name: str) -> None:
    result = ALL[name](CASES["beale"].problem(), CASES["beale"].points(), max_evaluations=2000, gradient_tolerance=1e-3)
    assert result.stop_reason == [StopReason.GRADIENT]
    _, gradient = CASES["beale"].problem()(result.x, torch.tensor([0]))
    assert gradient.abs().max() <= 2e-3  # of the dogleg it is half the gradient


@all_minimisers
def test_steps_into_nan_are_taken_back(name: str) -> None:
    # log x - log 3, undefined for x <= 0, with a problem beside it that is defined everywhere
    def residuals(x: Tensor, index: Tensor) -> Tensor:
        return torch.where(index.unsqueeze(1) == 0, torch.where(x > 0, x, torch.nan).log() - 3**0.5, x - 1)

    options: dict[str, Any] = {"radius": 100.0} if name == "dogleg" else {"first_step": 100.0}
    start = torch.tensor([[20.0, 0.05], [3.0, 4.0]], dtype=torch.float64)
    result = ALL[name](SumOfSquares(residuals), start, max_evaluations=800, **options)
    assert torch.isfinite(result.x).all()
    torch.testing.assert_close(result.x[0], torch.full((2,), 3**0.5).double().exp(), rtol=0.02, atol=0)
    torch.testing.assert_close(result.x[1], torch.ones(2).double(), rtol=0, atol=1e-3)


@all_minimisers
def test_a_start_that_is_not_finite_stops_and_spoils_nothing(name: str) -> None:
    problem = SumOfSquares(lambda x, index: torch.where(x > 0, x, torch.nan).log())
    result = ALL[name](problem, torch.tensor([[-1.0], [2.0]]).double(), max_evaluations=200)
    assert result.x[0] == -1
    assert result.evaluations[0] < 200
    torch.testing.assert_close(result.x[1].item(), 1.0, rtol=1e-3, atol=0)


@all_minimisers
def test_the_start_is_not_changed(name: str) -> None:
    start = CASES["rosenbrock"].points()
    before = start.clone()
    ALL[name](CASES["rosenbrock"].problem(), start, max_evaluations=10)
    assert torch.equal(start, before)
