"""Descent without a line search, the part that momentum and Adam share: how far to go, when to restart, when to stop.

Each step goes where the rule says, downhill or not.  The step size of a problem grows a little with each new lowest
point; when there has been none for some evaluations, or a value is not finite, the problem restarts from its lowest
point with half the step size (the "bold driver", Vogl et al., Biol. Cybern. 59, 1988).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias

import torch
from torch import Tensor

from .result import WINDOW, History, Minimum, ObjectiveFunction, StopReason, Watch, enter_reasons

GROWTH, SHRINKAGE = 1.05, 0.5
PATIENCE = 5  # evaluations without a new lowest point

Rule: TypeAlias = Callable[..., tuple[Tensor, tuple[Tensor, ...]]]
"""Where to go from the gradients so far: from those at the current points (A, N), and a memory of tensors (A, …), to
displacements (A, N) for a step size of 1, and the new memory."""


class _Points(NamedTuple):
    """Points (A, N) with their values (A,) and gradients (A, N)."""

    x: Tensor
    value: Tensor
    gradient: Tensor

    def finite(self) -> Tensor:
        return self.value.isfinite() & self.gradient.isfinite().all(1)

    def select(self, mask: Tensor) -> _Points:
        return _Points(*(tensor[mask] for tensor in self))

    def where(self, mask: Tensor, other: _Points) -> _Points:
        """These where ``mask`` (A,) holds, elsewhere ``other``."""
        column = mask.unsqueeze(1)
        return _Points(
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
        memory: of the rule, for the running problems.
        bad, small: (A,), whether the last value was not finite, and whether the last step was below rounding.
        history, lowest_values: the values of the current and of the lowest points.
    """

    def __init__(
        self,
        objective: ObjectiveFunction,
        start: Tensor,
        rule: Rule,
        memory: Sequence[Tensor],
        first_step: Callable[[Tensor], Tensor],
        watch: Watch | None,
    ) -> None:
        self.objective, self.rule, self.memory, self.watch = objective, rule, memory, watch
        x = start.detach().clone()
        self.index = torch.arange(len(x), device=x.device)
        self.current = self.lowest = _Points(x, *objective(x, self.index))
        self.x, self.value = x.clone(), self.current.value.clone()
        self.step, self.waited = first_step(self.current.gradient), torch.zeros_like(self.index)
        self.bad = ~self.current.finite()
        self.small = torch.zeros_like(self.bad)
        self.reasons = [StopReason.BUDGET] * len(start)
        self.evaluations, self.rounds = torch.zeros_like(self.index), 0
        self.history, self.lowest_values = (History(self.value, len(start)) for _ in range(2))
        self._count()

    def _count(self) -> None:
        self.rounds += 1  # each evaluates all that are running
        evaluations = torch.full_like(self.index, self.rounds)
        self.evaluations[self.index] = evaluations
        self.history.add(evaluations, self.index, self.current.value, self.rounds)
        self.lowest_values.add(evaluations, self.index, self.lowest.value, self.rounds)
        if self.watch is not None:
            self.watch(self.index, evaluations)

    def ended(self, evaluation: int, gradient_tolerance: float, progress_tolerance: float) -> dict[StopReason, Tensor]:
        """Which of the running problems (A,) stop after so many evaluations, for each reason."""
        value = self.lowest.value
        flat = self.lowest.gradient.abs().amax(1) <= gradient_tolerance
        slow = torch.zeros_like(flat)
        if evaluation > WINDOW:
            slow = self.lowest_values.table[evaluation - 1 - WINDOW, self.index] - value < progress_tolerance * value
        return {
            StopReason.NOT_FINITE: self.bad,
            StopReason.GRADIENT: flat,
            StopReason.PROGRESS: slow,
            StopReason.STEP: self.small,
        }

    def stop(self, done: Tensor) -> None:
        """Those that are ``done`` (A,) are no longer run."""
        running = ~done
        self.memory = [tensor[running] for tensor in self.memory]
        self.index, self.step, self.waited = self.index[running], self.step[running], self.waited[running]
        self.current, self.lowest = self.current.select(running), self.lowest.select(running)

    def advance(self) -> None:
        """Takes a step of each running problem, and restarts those that have come no lower for long."""
        displacement, memory = self.rule(self.current.gradient, *self.memory)
        shift = self.step.unsqueeze(1) * displacement
        self.small = shift.abs().amax(1) <= torch.finfo(shift.dtype).eps * self.current.x.abs().amax(1)
        x = self.current.x + shift
        current = _Points(x, *self.objective(x, self.index))
        finite = current.finite()
        better = finite & (current.value < self.lowest.value)
        self.lowest = current.where(better, self.lowest)
        self.x[self.index], self.value[self.index] = self.lowest.x, self.lowest.value
        waited = torch.where(better, 0, self.waited + 1)
        restart = ~finite | (waited >= PATIENCE)
        self.step = torch.where(restart, SHRINKAGE * self.step, torch.where(better, GROWTH * self.step, self.step))
        self.waited = torch.where(restart, 0, waited)
        self.current = self.lowest.where(restart, current)
        self.memory = [torch.where(restart.unsqueeze(1), 0, tensor) for tensor in memory]
        self.bad = torch.zeros_like(restart)
        self._count()


def descend(
    objective: ObjectiveFunction,
    start: Tensor,
    rule: Rule,
    memory: Sequence[Tensor],
    first_step: Callable[[Tensor], Tensor],
    *,
    max_evaluations: int = 300,
    gradient_tolerance: float = 0.0,
    progress_tolerance: float = 0.0,
    watch: Watch | None = None,
) -> Minimum:
    """Minimise a batch of problems from ``start`` (B, N), stopping as :class:`.result.Stopping` says.

    ``memory`` of the rule are tensors (B, …) of zeros; they are 0 again where a problem restarts.  ``first_step`` makes
    the first step sizes (B,) from the gradients (B, N) at the start.
    """
    descent = _Descent(objective, start, rule, memory, first_step, watch)
    for evaluation in range(1, max_evaluations + 1):
        ended = descent.ended(evaluation, gradient_tolerance, progress_tolerance)
        done = enter_reasons(descent.reasons, descent.index, ended)
        if done.any():
            descent.stop(done)
        if not len(descent.index) or evaluation == max_evaluations:
            break
        descent.advance()
    history = descent.history.filled(int(descent.evaluations.max()))
    return Minimum(descent.x, descent.value, descent.evaluations, descent.reasons, history)
