"""L-BFGS on a device, whose rounds wait for nothing: all decisions are made there, :mod:`.lbfgs_masks`.

A problem that has ended stays as it is, and is dropped at the next look (:mod:`.endings`).
"""

from __future__ import annotations

import torch
from torch import Tensor

from . import endings
from .lbfgs_decisions import ALONG, BESIDE, CHANGE_ALONG, CHANGE_SQUARED, CHANGE_WITH_NEW
from .lbfgs_masks import Decisions, decide
from .lbfgs_state import SearchState, remaining, steepest
from .result import WINDOW, History, Minimum, ObjectiveFunction, StopReason, Watch


class DeviceVectors:
    """The long vectors of a batch of searches, as :class:`.lbfgs.LbfgsVectors` has them, by operations of PyTorch.

    Attributes:
        x, gradient, direction: (A, N).
        stored: (A, 2m + 1, N): the last takes what is not to be stored, so that no number decides where to write.
    """

    def __init__(self, x: Tensor, gradient: Tensor, direction: Tensor, memory: int) -> None:
        self.x, self.gradient, self.direction = x, gradient, direction
        self.stored = x.new_zeros(len(x), 2 * memory + 1, x.shape[1])

    def dots(self, trial_gradient: Tensor) -> Tensor:
        """(A, 2m + 4), as :func:`.lbfgs_decisions.decide` takes them."""
        change = trial_gradient - self.gradient
        beside = [trial_gradient.new_empty(0)] * BESIDE
        for which, left, right in (
            (ALONG, trial_gradient, self.direction),
            (CHANGE_ALONG, change, self.direction),
            (CHANGE_SQUARED, change, change),
            (CHANGE_WITH_NEW, change, trial_gradient),
        ):
            beside[which] = torch.linalg.vecdot(left, right)
        with_stored = torch.bmm(trial_gradient.unsqueeze(1), self.stored[:, :-1].mT).squeeze(1)
        return torch.cat([with_stored, torch.stack(beside, dim=1)], dim=1)

    def take_step(self, steps: Tensor, decisions: Decisions, trial_gradient: Tensor) -> None:
        """Takes the steps (A,) of those that move, and updates their directions; ``trial_gradient`` is (A, N)."""
        moves, rows = decisions.moves.unsqueeze(1), torch.arange(len(steps), device=steps.device)
        both = self.stored.shape[1] - 1
        s, y = steps.unsqueeze(1) * self.direction, trial_gradient - self.gradient
        for vector, place in ((s, decisions.places), (y, decisions.places + both // 2)):
            self.stored[rows, torch.where(decisions.stores, place, both)] = vector
        torch.where(moves, self.x + s, self.x, out=self.x)
        torch.where(moves, trial_gradient, self.gradient, out=self.gradient)
        direction = torch.bmm(decisions.coefficients[:, None, :-1], self.stored[:, :-1]).squeeze(1)
        direction.addcmul_(decisions.coefficients[:, -1:], self.gradient)
        torch.where(moves, direction, self.direction, out=self.direction)

    def drop(self, done: Tensor) -> None:
        """Those that are ``done`` (A,), on the CPU."""
        self.x, self.gradient, self.direction, self.stored = remaining(
            done, self.x, self.gradient, self.direction, self.stored
        )


class DeviceSearch:
    """The running problems of a batch on a device, and the results of those that have stopped.

    Attributes:
        index, problems: (A,), the problems that are evaluated; the same on the CPU.
        codes: (A,), of :func:`.endings.enter`.
        evaluations: (A,), of each problem until it ended.
        x, value, spent: (B, N), (B,), (B,), points, values and evaluations of the others.
    """

    def __init__(
        self, objective: ObjectiveFunction, start: Tensor, memory: int, first_step: float, watch: Watch | None
    ) -> None:
        self.objective, self.first_step, self.watch = objective, first_step, watch
        self.x, self.value = start.clone(), start.new_empty(len(start))
        self.reasons = [StopReason.BUDGET] * len(start)
        self.problems, self.index = torch.arange(len(start)), torch.arange(len(start), device=start.device)
        self.spent = torch.zeros_like(self.index)
        self.history = History(self.value, len(start))
        values, gradient = (tensor.clone() for tensor in objective(start, self.index))
        direction = steepest(gradient, first_step)
        self.vectors = DeviceVectors(start.clone(), gradient, direction, memory)
        slopes, peaks = torch.linalg.vecdot(gradient, direction), torch.linalg.vector_norm(gradient, torch.inf, dim=1)
        self.state = SearchState.at_start(values, peaks, slopes, memory)
        self.codes, self.evaluations = torch.zeros_like(self.index, dtype=torch.int8), torch.zeros_like(self.index)
        self.stays = torch.zeros_like(self.codes, dtype=torch.bool)
        self.again = torch.zeros_like(values)
        self.rounds = 0
        self._count()

    def _count(self) -> None:
        self.rounds += 1  # each evaluates all that are running
        self.evaluations = self.evaluations + (self.codes == 0)
        self.history.add(self.evaluations, self.index, self.state.values, self.rounds)
        if self.watch is not None:
            self.watch(self.index, self.evaluations)

    def advance(self) -> None:
        """Evaluates each trial point; where it is accepted, takes the step and updates the direction."""
        vectors, steps = self.vectors, self.state.steps
        values, gradient = self.objective(torch.addcmul(vectors.x, steps.unsqueeze(1), vectors.direction), self.index)
        self.state, decisions = decide(self.state, self.codes == 0, values, vectors.dots(gradient))
        self.stays, self.again = decisions.stays, torch.where(decisions.moves, 0, steps)
        vectors.take_step(steps, decisions, gradient)
        slopes = torch.where(
            decisions.moves, torch.linalg.vecdot(vectors.gradient, vectors.direction), self.state.slopes
        )
        peaks = torch.linalg.vector_norm(vectors.gradient, torch.inf, dim=1)
        uphill = ((slopes >= 0) | slopes.isnan()) & (self.codes == 0)  # rounding has spoilt the memory
        down = steepest(vectors.gradient, self.first_step)
        torch.where(uphill.unsqueeze(1), down, vectors.direction, out=vectors.direction)
        slopes = torch.where(uphill, torch.linalg.vecdot(vectors.gradient, down), slopes)
        self.state = self.state._replace(slopes=slopes, peaks=peaks, pairs=torch.where(uphill, 0, self.state.pairs))
        self._count()

    def end(self, evaluation: int, gradient_tolerance: float, progress_tolerance: float) -> None:
        """Ends the problems that stop after so many evaluations, and drops them now and then."""
        vectors, state = self.vectors, self.state
        length, size = (torch.linalg.vector_norm(v, torch.inf, dim=1) for v in (vectors.direction, vectors.x))
        slow = torch.zeros_like(self.stays)
        if evaluation > WINDOW:
            before = self.history.table[evaluation - WINDOW].index_select(0, self.index)
            slow = before - state.values < progress_tolerance * state.values
        self.codes = endings.enter(
            self.codes,
            {
                StopReason.GRADIENT: state.peaks <= gradient_tolerance,
                StopReason.PROGRESS: slow,
                StopReason.LINE_SEARCH: self.stays & (state.steps * length <= torch.finfo(size.dtype).eps * size),
            },
        )
        # what has ended is evaluated again at its last point: its step from there, or the one to the last trial
        self.state = state._replace(steps=torch.where(self.codes == 0, state.steps, self.again))
        if evaluation % endings.ROUNDS_BETWEEN_LOOKS == 0:
            self._drop(endings.read(self.codes, self.problems, self.reasons))

    def _drop(self, done: Tensor) -> None:
        """Those that are ``done`` (A,), on the CPU, are no longer evaluated; their points and values are results."""
        if not done.any():
            return
        rows = done.nonzero().squeeze(1).to(self.index.device)
        index = self.index[rows]
        self.x[index], self.value[index] = self.vectors.x[rows], self.state.values[rows]
        self.spent[index] = self.evaluations[rows]
        self.vectors.drop(done)
        self.index, self.codes, self.evaluations, *state = remaining(
            done, self.index, self.codes, self.evaluations, *self.state
        )
        self.state = SearchState(*state)
        (self.problems,) = remaining(done, self.problems)

    def minimum(self) -> Minimum:
        endings.read(self.codes, self.problems, self.reasons)
        self._drop(torch.ones_like(self.problems, dtype=torch.bool))
        return Minimum(self.x, self.value, self.spent, self.reasons, self.history.filled(int(self.spent.max())))
