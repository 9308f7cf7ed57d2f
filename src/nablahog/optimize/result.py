"""What every minimiser takes and returns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from torch import Tensor

Objective: TypeAlias = Callable[[Tensor, Tensor], tuple[Tensor, Tensor]]
"""(points (A, N), indices (A,) of their problems in the batch) to (values (A,), gradients (A, N))."""

BUDGET = "evaluation budget spent"
GRADIENT = "gradient below tolerance"
PROGRESS = "progress below tolerance"
LINE_SEARCH = "no lower point along the descent direction"


@dataclass(frozen=True)
class Minimum:
    """Outcome of a batched minimisation.

    Attributes:
        x: (B, N), the lowest point found for each problem.
        value: (B,), the objective there.
        evaluations: (B,) int64, how often each problem's objective was evaluated.
        stop_reason: for each problem, why it stopped.
        history: (evaluations of the longest problem, B): the value of each problem's current point after each
            evaluation; a problem that has stopped repeats its last value.
    """

    x: Tensor
    value: Tensor
    evaluations: Tensor
    stop_reason: list[str]
    history: Tensor
