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

from .result import Minimum, ObjectiveFunction, StopReason, Watch
from .running import Running

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


class Descent:
    """The running problems of a batch: on a device, rounds wait for nothing until the next look (:mod:`.running`).

    Attributes:
        current, lowest: of the running problems.
        trial: (A, N), the points evaluated last.
        step, waited: (A,), step sizes, and evaluations since the last new lowest point.
        memory: of the rule, for the running problems.
        bad, small: (A,), whether the first value was not finite, and whether the last step was below rounding.
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
        self.objective, self.rule, self.memory = objective, rule, tuple(memory)
        self.trial = start.detach().clone()
        value, gradient = objective(self.trial, torch.arange(len(start), device=start.device))
        self.current = self.lowest = _Points(self.trial, value.clone(), gradient)
        self.running = Running(start, self.current.value, watch)
        self.step, self.waited = first_step(gradient), torch.zeros_like(self.running.index)
        self.bad = ~self.current.finite()
        self.small = torch.zeros_like(self.bad)

    def end(self, gradient_tolerance: float, progress_tolerance: float) -> None:
        """Ends the problems that stop here; drops them, on a device now and then."""
        running = self.running
        running.end(
            {
                StopReason.NOT_FINITE: self.bad,
                StopReason.GRADIENT: self.lowest.gradient.abs().amax(1) <= gradient_tolerance,
                StopReason.PROGRESS: running.slow(progress_tolerance),
                StopReason.STEP: self.small,
            }
        )
        rows = running.look(self.lowest.x, self.lowest.value)
        if rows is not None:
            self._keep(rows)

    def _keep(self, rows: Tensor) -> None:
        rows = rows.to(self.trial.device)
        self.memory = tuple(tensor[rows] for tensor in self.memory)
        self.trial, self.step, self.waited = self.trial[rows], self.step[rows], self.waited[rows]
        self.current, self.lowest = self.current.select(rows), self.lowest.select(rows)

    def advance(self) -> None:
        """Takes a step of each running problem, and restarts those that have come no lower for long."""
        displacement, memory = self.rule(self.current.gradient, *self.memory)
        shift = self.step.unsqueeze(1) * displacement
        self.small = shift.abs().amax(1) <= torch.finfo(shift.dtype).eps * self.current.x.abs().amax(1)
        self.trial = self._unless_ended(self.current.x + shift, self.trial)
        current = _Points(self.trial, *self.objective(self.trial, self.running.index))
        finite = current.finite()
        better = finite & (current.value < self.lowest.value) & (self.running.codes == 0)
        self.lowest = current.where(better, self.lowest)
        waited = torch.where(better, 0, self.waited + 1)
        restart = ~finite | (waited >= PATIENCE)
        self.step = torch.where(restart, SHRINKAGE * self.step, torch.where(better, GROWTH * self.step, self.step))
        self.waited = torch.where(restart, 0, waited)
        current = self.lowest.where(restart, current)
        self.current = _Points(*(self._unless_ended(*pair) for pair in zip(current, self.current, strict=True)))
        self.memory = tuple(torch.where(restart.unsqueeze(1), 0, tensor) for tensor in memory)
        self.bad = torch.zeros_like(restart)
        self.running.count(self.current.value)

    def _unless_ended(self, new: Tensor, old: Tensor) -> Tensor:
        """Of problems that have ended the ``old`` rows."""
        if self.running.at_once:  # there are none
            return new
        return torch.where((self.running.codes == 0).view(-1, *[1] * (new.dim() - 1)), new, old)


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
    descent = Descent(objective, start, rule, memory, first_step, watch)
    for evaluation in range(1, max_evaluations + 1):
        descent.end(gradient_tolerance, progress_tolerance)
        if not len(descent.running.index) or evaluation == max_evaluations:
            break
        descent.advance()
    return descent.running.minimum(descent.lowest.x, descent.lowest.value)
