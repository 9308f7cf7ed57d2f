"""Limited-memory BFGS on a batch of independent problems (Nocedal & Wright, Numerical Optimization, ch. 7.2).

Each round evaluates every running problem once, at its own trial point.  A problem whose trial is accepted takes the
step and updates its direction at once; one whose trial is not shrinks or grows its step (:mod:`.lbfgs_decisions`).  No
problem waits for another.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ..runtime.threads import share_out
from . import lbfgs_kernels
from .lbfgs_decisions import ALONG, BESIDE, CHANGE_ALONG, CHANGE_SQUARED, CHANGE_WITH_NEW, decide
from .result import WINDOW, History, Minimum, ObjectiveFunction, StopReason, Watch, enter_reasons


class LbfgsVectors:
    """The long vectors of a batch of searches: points, gradients, directions, and stored pairs.

    On a CPU compiled loops (:mod:`.lbfgs_kernels`) in as many threads as PyTorch takes, elsewhere PyTorch.  A round
    reads the stored vectors twice: for their dot products with the new gradient, and to combine them.

    Attributes:
        x, gradient, direction: (B, N), contiguous.
        stored: (B, 2m, N), the last m steps s, then the last m gradient changes y.
        compiled: whether the loops are used; both compute the same, up to rounding.
    """

    def __init__(self, x: Tensor, gradient: Tensor, direction: Tensor, memory: int) -> None:
        self.x, self.gradient, self.direction = x, gradient, direction
        self.stored = x.new_zeros(len(x), 2 * memory, x.shape[1])
        self.compiled = x.device.type == "cpu"

    def values_and_dots(self, values: Tensor, trial_gradient: Tensor) -> tuple[Tensor, Tensor]:
        """(B,) and (B, 2m + 4), as :func:`.lbfgs_decisions.decide` takes them, on the CPU."""
        dots = self._dots(trial_gradient)
        if self.compiled:
            return values, dots
        both = torch.cat([values.unsqueeze(1), dots], dim=1).cpu()  # one wait for the device
        return both[:, 0].contiguous(), both[:, 1:].contiguous()

    def _dots(self, trial_gradient: Tensor) -> Tensor:
        if self.compiled:
            out = trial_gradient.new_empty(len(self.stored), self.stored.shape[1] + BESIDE)
            vectors = (trial_gradient, self.gradient, self.direction, self.stored)
            arrays = self.x.shape[1], *(each.view(-1).numpy() for each in vectors), out.numpy()
            share_out(lambda start, stop: lbfgs_kernels.dots(start, stop, *arrays), len(out))
            return out
        change = trial_gradient - self.gradient
        beside = [trial_gradient.new_empty(0)] * BESIDE
        for which, left, right in (
            (ALONG, trial_gradient, self.direction),
            (CHANGE_ALONG, change, self.direction),
            (CHANGE_SQUARED, change, change),
            (CHANGE_WITH_NEW, change, trial_gradient),
        ):
            beside[which] = torch.linalg.vecdot(left, right)
        with_stored = torch.bmm(trial_gradient.unsqueeze(1), self.stored.mT).squeeze(1)
        return torch.cat([with_stored, torch.stack(beside, dim=1)], dim=1)

    def take_step(
        self, taken: Tensor, places: Tensor, coefficients: Tensor, trial_gradient: Tensor, slopes: Tensor, peaks: Tensor
    ) -> None:
        """Takes the steps and updates the directions.

        Args:
            taken: (B,), the step as a multiple of the direction; 0 leaves a problem as it is.
            places: (B,), of s and y in the memory; -1 where they are not stored.
            coefficients: (B, 2m + 1) of the stored vectors and the gradient in the new direction.
            trial_gradient: (B, N).
            slopes, peaks: (B,), of those that move set to the slope along the new direction, and to the largest
                absolute number of the gradient.  These and the first three are on the CPU.
        """
        if self.compiled:
            numbers = (each.numpy() for each in (taken, places, coefficients))
            vectors = (trial_gradient, self.x, self.gradient, self.direction, self.stored)
            arrays = *numbers, *(each.view(-1).numpy() for each in vectors), slopes.numpy(), peaks.numpy()
            share_out(lambda start, stop: lbfgs_kernels.take_step(start, stop, *arrays), len(taken))
            return
        moved, new = taken > 0, (places >= 0).nonzero().squeeze(1)
        some = taken, places[new], coefficients, moved, new
        taken, places, coefficients, on_device, new = (t.to(self.x.device) for t in some)
        step = taken.unsqueeze(1) * self.direction
        self.stored[new, places] = step[new]
        self.stored[new, places + self.stored.shape[1] // 2] = (trial_gradient - self.gradient)[new]
        self.x += step
        torch.where(on_device.unsqueeze(1), trial_gradient, self.gradient, out=self.gradient)
        direction = torch.bmm(coefficients[:, None, :-1], self.stored).squeeze(1)
        direction.addcmul_(coefficients[:, -1:], self.gradient)
        torch.where(on_device.unsqueeze(1), direction, self.direction, out=self.direction)
        along = torch.linalg.vecdot(self.gradient, self.direction)
        largest = torch.linalg.vector_norm(self.gradient, torch.inf, dim=1)
        both = torch.stack([along, largest]).cpu()  # one wait for the device
        slopes[moved], peaks[moved] = both[0, moved], both[1, moved]


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
        index, running: (A,), the running problems; the same on the CPU.
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
        self.index, self.running = (torch.arange(len(start), device=d) for d in (start.device, "cpu"))
        self.rounds = 0
        values, gradient = (tensor.clone() for tensor in objective(start, self.index))
        direction = _steepest(gradient, first_step)
        self.vectors = LbfgsVectors(start.clone(), gradient, direction, memory)
        peaks = torch.linalg.vector_norm(gradient, torch.inf, dim=1)
        self.scalars = _Scalars.at_start(values.cpu(), peaks.cpu(), _dot(gradient, direction), memory)
        self._count()

    def _count(self) -> None:
        self.rounds += 1  # each evaluates all that are running
        evaluations = torch.full_like(self.index, self.rounds)
        self.evaluations[self.index] = evaluations
        self.history.add(torch.full_like(self.running, self.rounds), self.running, self.scalars.values)
        if self.watch is not None:
            self.watch(self.index, evaluations)

    def advance(self) -> None:
        """Evaluates each trial point; where it is accepted, takes the step and updates the direction."""
        vectors, scalars = self.vectors, self.scalars
        steps = scalars.steps.to(self.index.device).unsqueeze(1)
        values, gradient = self.objective(torch.addcmul(vectors.x, steps, vectors.direction), self.index)
        gradient = gradient.contiguous()
        taken, places, coefficients = scalars.decide(*vectors.values_and_dots(values, gradient))
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
            length, size = torch.stack([v[on_device].abs().amax(1) for v in (vectors.direction, vectors.x)]).cpu()
            stuck[rows] = self.scalars.steps[rows] * length <= torch.finfo(size.dtype).eps * size
        if evaluation > WINDOW:
            before = self.history.table[evaluation - 1 - WINDOW, self.running]
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
        self.running, *scalars = _remaining(done, self.running, *self.scalars)
        self.scalars = _Scalars(*scalars)

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
        done = enter_reasons(search.reasons, search.running, ended)
        if done.any():
            search.stop(done)
        if not len(search.index):
            break
    return search.minimum()
