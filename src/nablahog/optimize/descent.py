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

from . import endings
from .result import WINDOW, History, Minimum, ObjectiveFunction, StopReason, Watch

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

    def select(self, rows: Tensor) -> _Points:
        return _Points(*(tensor[rows] for tensor in self))

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

    On a device problems that have ended stay among them until the next look (:mod:`.endings`), and do not change.

    Attributes:
        index, problems: (A,), the running problems; the same on the CPU.
        at_once: whether problems that end are dropped at once.
        codes: (A,), of :func:`.endings.enter`.
        current, lowest: of the running problems.
        trial: (A, N), the points evaluated last.
        step, waited: (A,), step sizes, and evaluations since the last new lowest point.
        memory: of the rule, for the running problems.
        bad, small: (A,), whether the last value was not finite, and whether the last step was below rounding.
        evaluations: (B,), of each problem.
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
        self.objective, self.rule, self.memory, self.watch = objective, rule, tuple(memory), watch
        self.trial = start.detach().clone()
        self.problems, self.index = torch.arange(len(start)), torch.arange(len(start), device=start.device)
        self.codes = torch.zeros_like(self.index, dtype=torch.int8)
        self.current = self.lowest = _Points(self.trial, *objective(self.trial, self.index))
        self.x, self.value = self.trial.clone(), self.current.value.clone()
        self.step, self.waited = first_step(self.current.gradient), torch.zeros_like(self.index)
        self.bad = ~self.current.finite()
        self.small = torch.zeros_like(self.bad)
        self.reasons = [StopReason.BUDGET] * len(start)
        self.at_once = endings.dropped_at_once(start)
        self.evaluations, self.rounds = torch.zeros_like(self.index), 0
        self.history, self.lowest_values = (History(self.value, len(start)) for _ in range(2))
        self._count()

    def _count(self) -> None:
        self.rounds += 1  # each evaluates all that are running
        evaluations = self.evaluations[self.index] + (self.codes == 0)
        self.evaluations[self.index] = evaluations
        self.history.add(evaluations, self.index, self.current.value, self.rounds)
        self.lowest_values.add(evaluations, self.index, self.lowest.value, self.rounds)
        if self.watch is not None:
            self.watch(self.index, evaluations)

    def end(self, evaluation: int, gradient_tolerance: float, progress_tolerance: float) -> None:
        """Ends the problems that stop after so many evaluations; drops them, on a device now and then."""
        value = self.lowest.value
        flat = self.lowest.gradient.abs().amax(1) <= gradient_tolerance
        slow = torch.zeros_like(flat)
        if evaluation > WINDOW:
            before = self.lowest_values.table[evaluation - WINDOW].index_select(0, self.index)
            slow = before - value < progress_tolerance * value
        self.codes = endings.enter(
            self.codes,
            {
                StopReason.NOT_FINITE: self.bad,
                StopReason.GRADIENT: flat,
                StopReason.PROGRESS: slow,
                StopReason.STEP: self.small,
            },
        )
        if self.at_once or evaluation % endings.ROUNDS_BETWEEN_LOOKS == 0:
            self.look()

    def look(self) -> None:
        """Those that have ended are no longer run."""
        done = endings.read(self.codes, self.problems, self.reasons)
        if not done.any():
            return
        rows = (~done).nonzero().squeeze(1)
        self.problems, rows = self.problems[rows], rows.to(self.index.device)
        self.memory = tuple(tensor[rows] for tensor in self.memory)
        self.index, self.codes, self.trial = self.index[rows], self.codes[rows], self.trial[rows]
        self.step, self.waited = self.step[rows], self.waited[rows]
        self.current, self.lowest = self.current.select(rows), self.lowest.select(rows)

    def advance(self) -> None:
        """Takes a step of each running problem, and restarts those that have come no lower for long."""
        displacement, memory = self.rule(self.current.gradient, *self.memory)
        shift = self.step.unsqueeze(1) * displacement
        self.small = shift.abs().amax(1) <= torch.finfo(shift.dtype).eps * self.current.x.abs().amax(1)
        self.trial = self._unless_ended(self.current.x + shift, self.trial)
        current = _Points(self.trial, *self.objective(self.trial, self.index))
        finite = current.finite()
        better = finite & (current.value < self.lowest.value)
        if not self.at_once:
            better = better & (self.codes == 0)
        self.lowest = current.where(better, self.lowest)
        self.x[self.index], self.value[self.index] = self.lowest.x, self.lowest.value
        waited = torch.where(better, 0, self.waited + 1)
        restart = ~finite | (waited >= PATIENCE)
        self.step = torch.where(restart, SHRINKAGE * self.step, torch.where(better, GROWTH * self.step, self.step))
        self.waited = torch.where(restart, 0, waited)
        current = self.lowest.where(restart, current)
        self.current = _Points(*(self._unless_ended(*pair) for pair in zip(current, self.current, strict=True)))
        self.memory = tuple(torch.where(restart.unsqueeze(1), 0, tensor) for tensor in memory)
        self.bad = torch.zeros_like(restart)
        self._count()

    def _unless_ended(self, new: Tensor, old: Tensor) -> Tensor:
        """Of problems that have ended the ``old`` rows."""
        if self.at_once:  # there are none
            return new
        return torch.where((self.codes == 0).view(-1, *[1] * (new.dim() - 1)), new, old)


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
        descent.end(evaluation, gradient_tolerance, progress_tolerance)
        if not len(descent.index) or evaluation == max_evaluations:
            break
        descent.advance()
    descent.look()
    history = descent.history.filled(int(descent.evaluations.max()))
    return Minimum(descent.x, descent.value, descent.evaluations, descent.reasons, history)
