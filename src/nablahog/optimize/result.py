"""What every minimiser takes and returns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Any, Protocol, TypeAlias, runtime_checkable

import torch
from torch import Tensor

ObjectiveFunction: TypeAlias = Callable[[Tensor, Tensor], tuple[Tensor, Tensor]]
"""(points (A, N), indices (A,) of their problems in the batch, all different) to (values (A,), gradients (A, N))."""

Numbers: TypeAlias = Any
"""A few numbers of each problem: a tensor, or an array of NumPy, whose operations take a quarter of the time."""

Watch: TypeAlias = Callable[[Tensor, Tensor], None]
"""Called after each call of the objective: the indices (A,) of its problems, and their evaluations (A,) so far.

On a GPU problems that have ended may be among them for some rounds, with the evaluations that they ended with.
"""

Accepted: TypeAlias = Callable[[Tensor, Tensor, Tensor], None]
"""Called after accepted steps: the indices (A,) of the problems, their iterations (A,) so far, their points (A, N)."""


@runtime_checkable
class LeastSquares(Protocol):
    """An :data:`ObjectiveFunction` whose value is a sum of squares, and which tells them apart."""

    def __call__(self, points: Tensor, index: Tensor, /) -> tuple[Tensor, Tensor]: ...

    def residuals(self, points: Tensor, index: Tensor, /) -> Tensor:
        """Points (A, N) of the problems ``index`` (A,) to residuals (A, M) whose squares sum to the values.

        Row a depends on point a only.  Differentiable by PyTorch, and the derivative again (for J·v).
        """
        ...


class Jacobian(Protocol):
    """The Jacobians J of some problems of a batch, each at its point.

    Attributes:
        size: M, the number of residuals.
    """

    size: int

    def jvp(self, vectors: Tensor, /) -> Tensor:
        """J·v: (A, N) to (A, M)."""
        ...

    def vjp(self, vectors: Tensor, /) -> Tensor:
        """Jᵀ·v: (A, M) to (A, N)."""
        ...

    def precondition(self, vectors: Tensor, /) -> Tensor:
        """W⁻¹·v, (A, N), of a symmetric positive W near JᵀJ: the closer, the fewer products a step takes."""
        ...


@runtime_checkable
class Linearizable(LeastSquares, Protocol):
    """A problem that knows its Jacobian better than the graph of its residuals does."""

    def linearize(self, points: Tensor, index: Tensor, /) -> Jacobian:
        """J at the points (A, N) of the problems ``index`` (A,)."""
        ...


class StopReason(str, Enum):
    """Why a search ended.  A member prints as its sentence, and compares equal to it."""

    BUDGET = "evaluation budget spent"
    GRADIENT = "gradient below tolerance"
    PROGRESS = "progress below tolerance"
    LINE_SEARCH = "no lower point along the descent direction"
    STEP = "step below tolerance"
    RADIUS = "trust region collapsed"
    ITERATIONS = "iteration limit reached"
    NOT_FINITE = "no finite step from the derivatives"

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True)
class Minimum:
    """Outcome of a batched minimisation.

    One evaluation is a value with its gradient.  Residuals alone, and a product of the Jacobian or its transpose with a
    vector, are half of one each, about their cost.

    Attributes:
        x: (B, N), the lowest point found for each problem.
        value: (B,), the objective there.
        evaluations: (B,) int64, how often each problem's objective was evaluated, halves rounded up.
        stop_reason: for each problem, why it stopped.
        history: (evaluations of the longest problem, B): the value of each problem's current point after each
            evaluation; a problem that has stopped repeats its last value.
    """

    x: Tensor
    value: Tensor
    evaluations: Tensor
    stop_reason: list[StopReason]
    history: Tensor


class History:
    """Collects one number a problem and evaluation, where problems spend their evaluations at different times.

    Args:
        batch: number of problems.
    """

    def __init__(self, batch: int) -> None:
        self._batch = batch
        self._added: list[tuple[Numbers, Tensor, Numbers]] = []

    def add(self, evaluations: Numbers, index: Tensor, numbers: Numbers) -> None:
        """The problems ``index`` (A,) have ``numbers`` (A,) after ``evaluations`` (A,), counted from 1; 0 adds none.

        None of them may be changed later.
        """
        self._added.append((evaluations, index, numbers))

    def filled(self, length: int) -> Tensor:
        """(length, B): where a problem has no number it repeats its last.  Each has one after its first evaluation."""
        evaluations, index, numbers = (
            torch.cat([torch.as_tensor(part) for part in parts]) for parts in zip(*self._added, strict=True)
        )
        most = max(length, int(evaluations.max()))
        table = numbers.new_zeros(most + 1, self._batch)
        last = torch.zeros_like(table, dtype=torch.long)
        table[evaluations, index], last[evaluations, index] = numbers, evaluations
        return table.gather(0, last[1 : length + 1].cummax(dim=0).values)
