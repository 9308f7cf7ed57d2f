"""Limited-memory BFGS on a batch of independent problems (Nocedal & Wright, Numerical Optimization, ch. 7.2).

Each round evaluates every running problem once, at its own trial point.  A problem whose trial is accepted takes the
step and updates its direction at once; one whose trial is not shrinks or grows its step (:mod:`.lbfgs_decisions`).  No
problem waits for another.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from .lbfgs_decisions import decide
from .lbfgs_vectors import LbfgsVectors
from .result import WINDOW, History, Minimum, ObjectiveFunction, StopReason, Watch, enter_reasons


def _remaining(done: Tensor, *state: Tensor) -> list[Tensor]:
    """The rows of each tensor that are not ``done`` (B,), in place: the last of them fill the gaps, no others move."""
    count = len(done) - int(done.sum())
    gaps, last = done[:count].nonzero().squeeze(1), count + (~done[count:]).nonzero().squeeze(1)
    for tensor in state:
        tensor[gaps.to(tensor.device)] = tensor[last.to(tensor.device)]
    return [tensor[:count] for tensor in state]


class _Scalars(NamedTuple):
    """A few numbers of each running problem, on the CPU: its largest derivative, and the state of :func:`decide`."""

    values: Tensor
    peaks: Tensor
    slopes: Tensor
    steps: Tensor
    lows: Tensor
    highs: Tensor
    pairs: Tensor
    products: Tensor
    with_gradient: Tensor

    @classmethod
    def at_start(cls, values: Tensor, peaks: Tensor, slopes: Tensor, memory: int) -> _Scalars:
        batch = len(values)
        bracket = torch.ones_like(values), torch.zeros_like(values), torch.full_like(values, torch.inf)
        pairs = torch.zeros(batch, dtype=torch.long)
        products = values.new_zeros(batch, memory, 2 * memory)
        return cls(values, peaks, slopes, *bracket, pairs, products, values.new_zeros(batch, 2 * memory))

    def decide(self, trial_values: Tensor, dots: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Steps taken (B,), places of new pairs (B,), and coefficients of new directions (B, 2m + 1)."""
        taken, places = torch.empty_like(self.values), torch.empty_like(self.pairs)
        coefficients = dots.new_empty(len(dots), self.with_gradient.shape[1] + 1)
        rounding = dots.numpy().dtype.type(torch.finfo(dots.dtype).eps)
        state = (tensor.numpy() for tensor in (self.values, *self[2:], taken, places, coefficients))
        decide(trial_values.numpy(), dots.numpy(), rounding, *state)
        return taken, places, coefficients


def _dot(left: Tensor, right: Tensor) -> Tensor:
    """Dot products of the rows of two (B, N): (B,), on the CPU."""
    dots: Tensor = torch.linalg.vecdot(left, right).cpu()
    return dots


def _steepest(gradient: Tensor, length: float) -> Tensor:
    norm = gradient.norm(dim=1, keepdim=True)
    return -gradient * torch.where(norm > 0, length / norm, 0)


class _Search:
    """The running problems of a batch, and the results of those that have stopped.

    Attributes:
        index: (A,), the running problems.
        x, value: (B, N), (B,), the points and values of the others.
        stays: (A,), whether the last trial was not accepted; on the CPU.
    """

    def __init__(
        self, objective: ObjectiveFunction, start: Tensor, memory: int, first_step: float, watch: Watch | None
    ) -> None:
        self.objective, self.first_step, self.watch = objective, first_step, watch
        self.x, self.value = start.clone(), start.new_empty(len(start))
        self.reasons = [StopReason.BUDGET] * len(start)
        self.evaluations = torch.zeros(len(start), dtype=torch.long, device=start.device)
        self.history = History(start.new_empty(0, device="cpu"), len(start))
        self.index = torch.arange(len(start), device=start.device)
        values, gradient = (tensor.clone() for tensor in objective(start, self.index))
        direction = _steepest(gradient, first_step)
        self.vectors = LbfgsVectors(start.clone(), gradient, direction, memory)
        peaks = torch.linalg.vector_norm(gradient, torch.inf, dim=1)
        self.scalars = _Scalars.at_start(values.cpu(), peaks.cpu(), _dot(gradient, direction), memory)
        self._count()

    def _count(self) -> None:
        self.evaluations[self.index] += 1
        evaluations = self.evaluations[self.index]
        self.history.add(evaluations.cpu(), self.index.cpu(), self.scalars.values)
        if self.watch is not None:
            self.watch(self.index, evaluations)

    def advance(self) -> None:
        """Evaluates each trial point; where it is accepted, takes the step and updates the direction."""
        vectors, scalars = self.vectors, self.scalars
        steps = scalars.steps.to(self.index.device).unsqueeze(1)
        values, gradient = self.objective(torch.addcmul(vectors.x, steps, vectors.direction), self.index)
        gradient = gradient.contiguous()
        taken, places, coefficients = scalars.decide(values.cpu(), vectors.dots(gradient))
        self.stays = taken == 0
        vectors.take_step(taken, places, coefficients, gradient, scalars.slopes, scalars.peaks)
        uphill = (scalars.slopes >= 0) | scalars.slopes.isnan()
        if uphill.any():  # rounding has spoilt the memory
            rows = uphill.nonzero().squeeze(1)
            scalars.pairs[rows] = 0
            on_device = rows.to(self.index.device)
            direction = vectors.direction[on_device] = _steepest(vectors.gradient[on_device], self.first_step)
            scalars.slopes[rows] = _dot(vectors.gradient[on_device], direction)
        self._count()

    def ended(self, evaluation: int, gradient_tolerance: float, progress_tolerance: float) -> dict[StopReason, Tensor]:
        """Which of the running problems (A,) stop after so many evaluations, for each reason."""
        vectors, values = self.vectors, self.scalars.values
        flat = self.scalars.peaks <= gradient_tolerance
        slow, stuck, rows = torch.zeros_like(flat), torch.zeros_like(flat), self.stays.nonzero().squeeze(1)
        if len(rows):
            on_device = rows.to(self.index.device)
            length, size = (each[on_device].abs().amax(1).cpu() for each in (vectors.direction, vectors.x))
            stuck[rows] = self.scalars.steps[rows] * length <= torch.finfo(size.dtype).eps * size
        if evaluation > WINDOW:
            before = self.history.table[evaluation - 1 - WINDOW, self.index.cpu()]
            slow = before - values < progress_tolerance * values
        return {StopReason.GRADIENT: flat, StopReason.PROGRESS: slow, StopReason.LINE_SEARCH: stuck}

    def stop(self, done: Tensor) -> None:
        """Those that are ``done`` (A,) are no longer run; their points and values are results."""
        on_device, vectors = done.to(self.index.device), self.vectors
        self.x[self.index[on_device]] = vectors.x[on_device]
        self.value[self.index[on_device]] = self.scalars.values[done].to(self.value.device)
        self.index, vectors.x, vectors.gradient, vectors.direction, vectors.stored = _remaining(
            on_device, self.index, vectors.x, vectors.gradient, vectors.direction, vectors.stored
        )
        self.scalars = _Scalars(*_remaining(done, *self.scalars))

    def minimum(self) -> Minimum:
        self.stop(torch.ones_like(self.scalars.values, dtype=torch.bool))
        history = self.history.filled(int(self.evaluations.max())).to(self.x.device)
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
    search = _Search(objective, start, memory, first_step, watch)
    for evaluation in range(2, max_evaluations + 1):
        search.advance()
        ended = search.ended(evaluation, gradient_tolerance, progress_tolerance)
        done = enter_reasons(search.reasons, search.index, ended)
        if done.any():
            search.stop(done)
        if not len(search.index):
            break
    return search.minimum()
