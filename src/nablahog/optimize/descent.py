"""Descent without a line search, the part that momentum and Adam share: how far to go, when to restart, when to stop.

Each step goes where the rule says, downhill or not.  The step size of a problem grows a little with each new lowest
point; when there has been none for some evaluations, or a value is not finite, the problem restarts from its lowest
point with half the step size (the "bold driver", Vogl et al., Biol. Cybern. 59, 1988).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from .result import WINDOW, Minimum, ObjectiveFunction, StopReason, Watch
from .stopping import enter_reasons

GROWTH, SHRINKAGE = 1.05, 0.5
PATIENCE = 5  # evaluations without a new lowest point


class Rule(Protocol):
    """Where to go from the gradients so far, for a batch."""

    def displacement(self, gradient: Tensor) -> Tensor:
        """Gradients (A, N) at the current points to displacements (A, N) for a step size of 1."""
        ...

    def restart(self, mask: Tensor) -> None:
        """Forgets the gradients of the problems for which ``mask`` (A,) holds."""
        ...

    def select(self, mask: Tensor) -> None:
        """Drops the problems for which ``mask`` (A,) does not hold."""
        ...


@dataclass
class _Point:
    """Points (A, N) with their values (A,) and gradients (A, N)."""

    x: Tensor
    value: Tensor
    gradient: Tensor

    def finite(self) -> Tensor:
        return self.value.isfinite() & self.gradient.isfinite().all(1)

    def select(self, mask: Tensor) -> _Point:
        return _Point(self.x[mask], self.value[mask], self.gradient[mask])

    def where(self, mask: Tensor, other: _Point) -> _Point:
        """These where ``mask`` (A,) holds, elsewhere ``other``."""
        column = mask.unsqueeze(1)
        return _Point(
            torch.where(column, self.x, other.x),
            torch.where(mask, self.value, other.value),
            torch.where(column, self.gradient, other.gradient),
        )


class _Descent:
    """The running problems of a batch, and the lowest points of all.

    Attributes:
        index: (A,), the running problems.
        current, lowest: of the running problems.
        step, waited: (A,), step sizes, and evaluations since the last new lowest point.
        bad, small: (A,), whether the last value was not finite, and whether the last step was below rounding.
    """

    def __init__(
        self, objective: ObjectiveFunction, start: _Point, rule: Rule, step: Tensor, watch: Watch | None
    ) -> None:
        self.objective, self.rule, self.watch = objective, rule, watch
        self.index = torch.arange(len(start.x), device=start.x.device)
        self.current = self.lowest = start
        self.step, self.waited = step, torch.zeros_like(self.index)
        self.bad = ~start.finite()
        self.small = torch.zeros_like(self.bad)
        self.x, self.value = start.x.clone(), start.value.clone()
        self.reasons = [StopReason.BUDGET] * len(start.x)
        self.evaluations = torch.ones_like(self.index)
        self.history, self.lowest_values = [start.value.clone()], [start.value.clone()]
        if watch is not None:
            watch(self.index, self.evaluations)

    def ended(self, gradient_tolerance: float, progress_tolerance: float) -> dict[StopReason, Tensor]:
        """Which of the running problems (A,) stop, for each reason."""
        value = self.lowest.value
        flat = self.lowest.gradient.abs().amax(1) <= gradient_tolerance
        slow = torch.zeros_like(flat)
        if len(self.lowest_values) > WINDOW:
            slow = self.lowest_values[-1 - WINDOW][self.index] - value < progress_tolerance * value
        return {
            StopReason.NOT_FINITE: self.bad,
            StopReason.GRADIENT: flat,
            StopReason.PROGRESS: slow,
            StopReason.STEP: self.small,
        }

    def stop(self, done: Tensor) -> None:
        """Those that are ``done`` (A,) are no longer run."""
        running = ~done
        self.rule.select(running)
        self.index, self.step, self.waited = self.index[running], self.step[running], self.waited[running]
        self.current, self.lowest = self.current.select(running), self.lowest.select(running)

    def advance(self) -> None:
        """Takes a step of each running problem, and restarts those that have come no lower for long."""
        shift = self.step.unsqueeze(1) * self.rule.displacement(self.current.gradient)
        self.small = shift.abs().amax(1) <= torch.finfo(shift.dtype).eps * self.current.x.abs().amax(1)
        x = self.current.x + shift
        current = _Point(x, *self.objective(x, self.index))
        self.evaluations[self.index] += 1
        if self.watch is not None:
            self.watch(self.index, self.evaluations[self.index])
        finite = current.finite()
        better = finite & (current.value < self.lowest.value)
        self.lowest = current.where(better, self.lowest)
        self.x[self.index], self.value[self.index] = self.lowest.x, self.lowest.value
        waited = torch.where(better, 0, self.waited + 1)
        restart = ~finite | (waited >= PATIENCE)
        self.step = torch.where(restart, SHRINKAGE * self.step, torch.where(better, GROWTH * self.step, self.step))
        self.waited = torch.where(restart, 0, waited)
        self.current = self.lowest.where(restart, current)
        self.rule.restart(restart)
        self.bad = torch.zeros_like(restart)
        for values, new in ((self.history, self.current.value), (self.lowest_values, self.lowest.value)):
            row = values[-1].clone()
            row[self.index] = new
            values.append(row)


def descend(
    objective: ObjectiveFunction,
    x: Tensor,
    value: Tensor,
    gradient: Tensor,
    rule: Rule,
    step: Tensor,
    *,
    max_evaluations: int,
    gradient_tolerance: float,
    progress_tolerance: float,
    watch: Watch | None,
) -> Minimum:
    """Minimise a batch from points x (B, N), with their values (B,), gradients (B, N) and step sizes (B,)."""
    descent = _Descent(objective, _Point(x, value, gradient), rule, step, watch)
    for evaluation in range(2, max_evaluations + 2):
        ended = descent.ended(gradient_tolerance, progress_tolerance)
        done = torch.stack([*ended.values()]).any(dim=0)
        if done.any():
            enter_reasons(descent.reasons, descent.index, ended)
            descent.stop(done)
        if not len(descent.index) or evaluation > max_evaluations:
            break
        descent.advance()
    return Minimum(descent.x, descent.value, descent.evaluations, descent.reasons, torch.stack(descent.history))
