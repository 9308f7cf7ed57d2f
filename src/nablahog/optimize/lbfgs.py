"""Limited-memory BFGS on a batch of independent problems (Nocedal & Wright, Numerical Optimization, ch. 7.2).

Each round evaluates every running problem once, at its own trial point; a problem whose trial is accepted moves on to
its next direction at once, one whose trial is not shrinks or grows its step (:mod:`.lbfgs_decisions`): no problem waits
for another.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from .lbfgs_decisions import decide
from .lbfgs_kernels import CompiledVectors
from .lbfgs_vectors import Vectors
from .result import WINDOW, History, Minimum, ObjectiveFunction, StopReason, Watch


def _remaining(done: Tensor, *state: Tensor) -> list[Tensor]:
    """The rows of each tensor that are not ``done`` (B,), in place: the last of them fill the gaps, no others move."""
    count = len(done) - int(done.sum())
    gaps, last = done[:count].nonzero().squeeze(1), count + (~done[count:]).nonzero().squeeze(1)
    for tensor in state:
        tensor[gaps.to(tensor.device)] = tensor[last.to(tensor.device)]
    return [tensor[:count] for tensor in state]


class _Numbers(NamedTuple):
    """The few numbers of each running problem, on the CPU: its largest derivative, and what :func:`decide` takes."""

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
    def at_start(cls, values: Tensor, peaks: Tensor, slopes: Tensor, memory: int) -> _Numbers:
        batch = len(values)
        bracket = torch.ones_like(values), torch.zeros_like(values), torch.full_like(values, torch.inf)
        pairs = torch.zeros(batch, dtype=torch.long)
        products = values.new_zeros(batch, memory, 2 * memory)
        return cls(values, peaks, slopes, *bracket, pairs, products, values.new_zeros(batch, 2 * memory))

    def decide(self, trial_values: Tensor, dots: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Steps taken (B,), places of new pairs (B,), and coefficients of new directions (B, 2m + 1)."""
        found = torch.empty_like(self.values), torch.empty_like(self.pairs)
        coefficients = dots.new_empty(len(dots), self.with_gradient.shape[1] + 1)
        rounding = dots.numpy().dtype.type(torch.finfo(dots.dtype).eps)
        state = (tensor.numpy() for tensor in (self.values, *self[2:], *found, coefficients))
        decide(trial_values.numpy(), dots.numpy(), rounding, *state)
        return *found, coefficients


def _dot(left: Tensor, right: Tensor) -> Tensor:
    """Of the rows of two (B, N): (B,), on the CPU."""
    found: Tensor = torch.linalg.vecdot(left, right).cpu()
    return found


def _steepest(gradient: Tensor, length: float) -> Tensor:
    norm = gradient.norm(dim=1, keepdim=True)
    return -gradient * torch.where(norm > 0, length / norm, 0)


class _Running:
    """The problems whose search goes on."""

    def __init__(self, objective: ObjectiveFunction, start: Tensor, memory: int, first_step: float) -> None:
        self.objective, self.first_step = objective, first_step
        self.index = torch.arange(len(start), device=start.device)
        values, gradient = (found.clone() for found in objective(start, self.index))
        direction = _steepest(gradient, first_step)
        kind = CompiledVectors if start.device.type == "cpu" else Vectors
        self.vectors = kind(start.clone(), gradient, direction, memory)
        peaks = torch.linalg.vector_norm(gradient, torch.inf, dim=1)
        self.numbers = _Numbers.at_start(values.cpu(), peaks.cpu(), _dot(gradient, direction), memory)

    def go_on(self) -> None:
        """One evaluation of each, and what follows from it."""
        vectors, numbers = self.vectors, self.numbers
        steps = numbers.steps.to(self.index.device).unsqueeze(1)
        values, gradient = self.objective(torch.addcmul(vectors.x, steps, vectors.direction), self.index)
        gradient = gradient.contiguous()
        taken, places, coefficients = numbers.decide(values.cpu(), vectors.dots(gradient))
        self.stays = taken == 0
        vectors.move(taken, places, coefficients, gradient, numbers.slopes, numbers.peaks)
        uphill = (numbers.slopes >= 0) | numbers.slopes.isnan()
        if uphill.any():  # rounding has spoilt the memory
            rows = uphill.nonzero().squeeze(1)
            numbers.pairs[rows] = 0
            there = rows.to(self.index.device)
            direction = vectors.direction[there] = _steepest(vectors.gradient[there], self.first_step)
            numbers.slopes[rows] = _dot(vectors.gradient[there], direction)

    def ended(self, tolerance: float) -> tuple[Tensor, Tensor]:
        """Which of them (B,) have no slope left, and which no step of those that have not moved."""
        vectors = self.vectors
        flat = self.numbers.peaks <= tolerance
        stuck, rows = torch.zeros_like(flat), self.stays.nonzero().squeeze(1)
        if len(rows):
            there = rows.to(self.index.device)
            length, size = (each[there].abs().amax(1).cpu() for each in (vectors.direction, vectors.x))
            stuck[rows] = self.numbers.steps[rows] * length <= torch.finfo(size.dtype).eps * size
        return flat, stuck

    def leave(self, done: Tensor, x: Tensor, value: Tensor) -> None:
        """Those that are ``done`` (B,) enter their points in x (problems, N) and their values in value (problems,)."""
        there, vectors = done.to(self.index.device), self.vectors
        x[self.index[there]] = vectors.x[there]
        value[self.index[there]] = self.numbers.values[done].to(value.device)
        self.index, vectors.x, vectors.gradient, vectors.direction, vectors.stored = _remaining(
            there, self.index, vectors.x, vectors.gradient, vectors.direction, vectors.stored
        )
        self.numbers = _Numbers(*_remaining(done, *self.numbers))


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
    x, value, reasons = start.clone(), start.new_empty(len(start)), [StopReason.BUDGET] * len(start)
    evaluations = torch.zeros(len(start), dtype=torch.long, device=start.device)
    history = History(start.new_empty(0, device="cpu"), len(start))

    def count(index: Tensor, values: Tensor) -> None:
        evaluations[index] += 1
        history.add(evaluations[index].cpu(), index.cpu(), values)
        if watch is not None:
            watch(index, evaluations[index])

    running = _Running(objective, start, memory, first_step)
    count(running.index, running.numbers.values)
    for evaluation in range(2, max_evaluations + 1):
        running.go_on()
        count(running.index, running.numbers.values)
        flat, stuck = running.ended(gradient_tolerance)
        slow = torch.zeros_like(stuck)
        if evaluation > WINDOW:
            before = history.table[evaluation - 1 - WINDOW, running.index.cpu()]
            slow = before - running.numbers.values < progress_tolerance * running.numbers.values
        done = flat | stuck | slow
        if done.any():
            for which, why in (
                (stuck, StopReason.LINE_SEARCH),
                (slow, StopReason.PROGRESS),
                (flat, StopReason.GRADIENT),
            ):  # the last one counts
                for problem in running.index[which.to(start.device)].tolist():
                    reasons[problem] = why
            running.leave(done, x, value)
            if not len(running.index):
                break
    running.leave(torch.ones_like(running.numbers.values, dtype=torch.bool), x, value)
    return Minimum(x, value, evaluations, reasons, history.filled(int(evaluations.max())).to(start.device))
