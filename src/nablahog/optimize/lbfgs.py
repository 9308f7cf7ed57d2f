"""Limited-memory BFGS on a batch of independent problems (Nocedal & Wright, Numerical Optimization, ch. 7.2).

Each round evaluates every running problem once, at its own trial point.  A problem whose trial is accepted takes the
step and updates its direction at once; one whose trial is not shrinks or grows its step (:mod:`.lbfgs_decisions`).  No
problem waits for another.

On a CPU by compiled loops, here; elsewhere by operations of PyTorch, :mod:`.lbfgs_device`.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ..runtime.threads import share_out
from . import endings, lbfgs_kernels
from .lbfgs_decisions import BESIDE, decide
from .lbfgs_device import DeviceSearch
from .lbfgs_state import SearchState, remaining, steepest
from .result import WINDOW, History, Minimum, ObjectiveFunction, StopReason, Watch


class LbfgsVectors:
    """The long vectors of a batch of searches on a CPU: points, gradients, directions, and stored pairs.

    Compiled loops (:mod:`.lbfgs_kernels`) in as many threads as PyTorch takes.  A round reads the stored vectors twice:
    for their dot products with the new gradient, and to combine them.

    Attributes:
        x, gradient, direction: (A, N), contiguous.
        stored: (A, 2m, N), the last m steps s, then the last m gradient changes y.
    """

    def __init__(self, x: Tensor, gradient: Tensor, direction: Tensor, memory: int) -> None:
        self.x, self.gradient, self.direction = x, gradient, direction
        self.stored = x.new_zeros(len(x), 2 * memory, x.shape[1])

    def dots(self, trial_gradient: Tensor) -> Tensor:
        """(A, 2m + 4), as :func:`.lbfgs_decisions.decide` takes them."""
        out = trial_gradient.new_empty(len(self.stored), self.stored.shape[1] + BESIDE)
        vectors = (trial_gradient, self.gradient, self.direction, self.stored)
        arrays = self.x.shape[1], *(each.view(-1).numpy() for each in vectors), out.numpy()
        share_out(lambda start, stop: lbfgs_kernels.dots(start, stop, *arrays), len(out))
        return out

    def take_step(
        self, taken: Tensor, places: Tensor, coefficients: Tensor, trial_gradient: Tensor, slopes: Tensor, peaks: Tensor
    ) -> None:
        """Takes the steps and updates the directions.

        Args:
            taken: (A,), the step as a multiple of the direction; 0 leaves a problem as it is.
            places: (A,), of s and y in the memory; -1 where they are not stored.
            coefficients: (A, 2m + 1) of the stored vectors and the gradient in the new direction.
            trial_gradient: (A, N).
            slopes, peaks: (A,), of those that move set to the slope along the new direction, and to the largest
                absolute number of the gradient.
        """
        numbers = (each.numpy() for each in (taken, places, coefficients))
        vectors = (trial_gradient, self.x, self.gradient, self.direction, self.stored)
        arrays = *numbers, *(each.view(-1).numpy() for each in vectors), slopes.numpy(), peaks.numpy()
        share_out(lambda start, stop: lbfgs_kernels.take_step(start, stop, *arrays), len(taken))


def decided(state: SearchState, trial_values: Tensor, dots: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Steps taken (A,), places of new pairs (A,), and coefficients of new directions (A, 2m + 1).

    The state is on the CPU and is changed.
    """
    taken, places = torch.empty_like(state.values), torch.empty_like(state.pairs)
    coefficients = dots.new_empty(len(dots), state.with_gradient.shape[1] + 1)
    rounding = dots.numpy().dtype.type(torch.finfo(dots.dtype).eps)
    numbers = (tensor.numpy() for tensor in (*state[:-1], taken, places, coefficients))  # all but the peaks
    decide(trial_values.numpy(), dots.numpy(), rounding, *numbers)
    return taken, places, coefficients


class _Search:
    """The running problems of a batch on a CPU, and the results of those that have stopped.

    Attributes:
        index: (A,), the running problems.
        x, value: (B, N), (B,), the points and values of the others.
        stays: (A,), whether the last trial was not accepted.
    """

    def __init__(
        self, objective: ObjectiveFunction, start: Tensor, memory: int, first_step: float, watch: Watch | None
    ) -> None:
        self.objective, self.first_step, self.watch = objective, first_step, watch
        self.x, self.value = start.clone(), start.new_empty(len(start))
        self.reasons = [StopReason.BUDGET] * len(start)
        self.index = torch.arange(len(start))
        self.evaluations = torch.zeros_like(self.index)
        self.history = History(self.value, len(start))
        self.rounds = 0
        values, gradient = (tensor.clone() for tensor in objective(start, self.index))
        direction = steepest(gradient, first_step)
        self.vectors = LbfgsVectors(start.clone(), gradient, direction, memory)
        slopes, peaks = torch.linalg.vecdot(gradient, direction), torch.linalg.vector_norm(gradient, torch.inf, dim=1)
        self.state = SearchState.at_start(values, peaks, slopes, memory)
        self._count()

    def _count(self) -> None:
        self.rounds += 1  # each evaluates all that are running
        evaluations = torch.full_like(self.index, self.rounds)
        self.evaluations[self.index] = evaluations
        self.history.add(evaluations, self.index, self.state.values, self.rounds)
        if self.watch is not None:
            self.watch(self.index, evaluations)

    def advance(self) -> None:
        """Evaluates each trial point; where it is accepted, takes the step and updates the direction."""
        vectors, state = self.vectors, self.state
        points = torch.addcmul(vectors.x, state.steps.unsqueeze(1), vectors.direction)
        values, gradient = self.objective(points, self.index)
        gradient = gradient.contiguous()
        taken, places, coefficients = decided(state, values, vectors.dots(gradient))
        self.stays = taken == 0
        vectors.take_step(taken, places, coefficients, gradient, state.slopes, state.peaks)
        uphill = (state.slopes >= 0) | state.slopes.isnan()
        if uphill.any():  # rounding has spoilt the memory
            rows = uphill.nonzero().squeeze(1)
            state.pairs[rows] = 0
            direction = vectors.direction[rows] = steepest(vectors.gradient[rows], self.first_step)
            state.slopes[rows] = torch.linalg.vecdot(vectors.gradient[rows], direction)
        self._count()

    def end(self, evaluation: int, gradient_tolerance: float, progress_tolerance: float) -> None:
        """Ends and drops the problems that stop after so many evaluations."""
        vectors, state = self.vectors, self.state
        flat = state.peaks <= gradient_tolerance
        slow, stuck, rows = torch.zeros_like(flat), torch.zeros_like(flat), self.stays.nonzero().squeeze(1)
        if len(rows):
            length, size = (v[rows].abs().amax(1) for v in (vectors.direction, vectors.x))
            stuck[rows] = state.steps[rows] * length <= torch.finfo(size.dtype).eps * size
        if evaluation > WINDOW:
            before = self.history.table[evaluation - WINDOW, self.index]
            slow = before - state.values < progress_tolerance * state.values
        holds = {StopReason.GRADIENT: flat, StopReason.PROGRESS: slow, StopReason.LINE_SEARCH: stuck}
        codes = endings.enter(torch.zeros(len(flat), dtype=torch.int8), holds)
        self._drop(endings.read(codes, self.index, self.reasons))

    def _drop(self, done: Tensor) -> None:
        """Those that are ``done`` (A,) are no longer run; their points and values are results."""
        if not done.any():
            return
        vectors = self.vectors
        self.x[self.index[done]], self.value[self.index[done]] = vectors.x[done], self.state.values[done]
        self.index, vectors.x, vectors.gradient, vectors.direction, vectors.stored, *state = remaining(
            done, self.index, vectors.x, vectors.gradient, vectors.direction, vectors.stored, *self.state
        )
        self.state = SearchState(*state)

    def minimum(self) -> Minimum:
        self._drop(torch.ones_like(self.index, dtype=torch.bool))
        history = self.history.filled(int(self.evaluations.max()))
        return Minimum(self.x, self.value, self.evaluations, self.reasons, history)


def lbfgs(
    objective: ObjectiveFunction,
    start: Tensor,
    *,
    max_evaluations: int = 300,
    memory: int = 6,
    first_step: float = 1.0,
    gradient_tolerance: float = 0.0,
    progress_tolerance: float = 0.0,
    watch: Watch | None = None,
) -> Minimum:
    """Minimise a batch of problems.

    Args:
        objective: called with the running problems' points and indices only.  Problems must not influence each other.
        start: (B, N), float32 or float64.
        max_evaluations: budget of each problem.
        memory: stored pairs.
        first_step: length of the very first trial step, in the norm of the unknowns.
        gradient_tolerance: stop a problem whose largest absolute gradient entry is at most this.
        progress_tolerance: stop a problem whose value fell by less than this share of itself in 20 evaluations.
        watch: see :data:`Watch`.

    Returns:
        For each problem the lowest point found, never worse than its start.
    """
    kind = _Search if endings.dropped_at_once(start) else DeviceSearch
    search = kind(objective, start, memory, first_step, watch)
    for evaluation in range(2, max_evaluations + 1):
        search.advance()
        search.end(evaluation, gradient_tolerance, progress_tolerance)
        if not len(search.index):
            break
    return search.minimum()
