"""Limited-memory BFGS on a batch of independent problems (Nocedal & Wright, Numerical Optimization, ch. 7.2).

Each round evaluates every running problem once, at its own trial point.  A problem whose trial is accepted takes the
step and updates its direction at once; one whose trial is not shrinks or grows its step (:mod:`.lbfgs_decisions`).  No
problem waits for another.  A round reads the stored vectors twice: for their dot products with the new gradient, and to
combine them.
"""

from __future__ import annotations

from ctypes import c_bool, c_int64
from typing import Any

import numpy as np
import torch
from torch import Tensor

from .. import native
from ..runtime.pytorch import run_in_threads
from .lbfgs_decisions import Decisions, SearchState, decide
from .problems import (
    Minimum,
    Numbers,
    ObjectiveFunction,
    Running,
    StopReason,
    Watch,
    array_namespace,
    as_numbers,
    possibly_any,
    rows_where,
    select_rows,
)

_REALS = native.array(np.float32, np.float64)
_COMMON = c_bool, *[c_int64] * 6, _REALS, native.array(np.int64), _REALS
_dots = native.function("lbfgs_dots", *_COMMON, _REALS)
_take_step = native.function("lbfgs_take_step", *_COMMON, _REALS, native.array(np.bool_), *[_REALS] * 3)


class Vectors:
    """The vectors of A problems with N unknowns and m stored pairs, by operations of PyTorch that wait for no device.

    Attributes:
        x, gradient, direction: (A, N).
        slopes, peaks: (A,), the gradient along the direction, and its largest absolute number.
    """

    def __init__(self, x: Tensor, gradient: Tensor, memory: int, length: float) -> None:
        self.memory, self._length = memory, length
        # of each problem x, gradient and direction, m steps, m changes of the gradient, and what is not to be stored:
        # so no number decides where to write
        line = 64 // x.element_size()  # an odd number of these: places alike are in different sets of a cache
        self._all = x.new_zeros(len(x), 2 * memory + 4, (-(-x.shape[1] // line) | 1) * line)
        self._newest = torch.zeros(len(x), dtype=torch.long, device=x.device)  # pair: each m are a ring
        self._name_rows(x.shape[1])
        self.x[:], self.gradient[:] = x, gradient
        self.slopes, self.peaks = as_numbers(x.new_zeros(len(x))), as_numbers(self.gradient.abs().amax(1))
        self.turn_downhill(torch.ones_like(self._newest, dtype=torch.bool))

    def _name_rows(self, n: int) -> None:
        self._vectors = self._all[:, :, :n]
        self.x, self.gradient, self.direction = self._vectors[:, :3].unbind(1)
        self._stored = self._vectors[:, 3:-1]

    def trial_points(self, steps: Numbers) -> Tensor:
        """(A, N), so many times the directions away."""
        return torch.addcmul(self.x, torch.as_tensor(steps).unsqueeze(1), self.direction)

    def turn_downhill(self, which: Numbers) -> None:
        """The problems ``which`` (A,) turn to the directions of steepest descent."""
        rows, which, slopes = rows_where(which), torch.as_tensor(which), torch.as_tensor(self.slopes)
        gradient, turns = self.gradient[rows], which[rows]
        norm = gradient.norm(dim=1, keepdim=True)
        down = -gradient * torch.where(norm > 0, self._length / norm, 0)
        self.direction[rows] = torch.where(turns.unsqueeze(1), down, self.direction[rows])
        slopes[rows] = torch.where(turns, torch.linalg.vecdot(gradient, down), slopes[rows])

    def find_vanishing_steps(self, which: Numbers, steps: Numbers) -> Numbers:
        """For which of the problems ``which`` (A,) a step (A,) along the direction is lost in rounding, (A,)."""
        rows, vanishes = rows_where(which), torch.zeros_like(self._newest, dtype=torch.bool)
        length, size = (v[rows].abs().amax(1) for v in (self.direction, self.x))
        vanishes[rows] = torch.as_tensor(steps)[rows] * length <= torch.finfo(size.dtype).eps * size
        return which & as_numbers(vanishes)

    def dots(self, trial_gradient: Tensor) -> Numbers:
        """(A, 2m + 4), as :func:`.lbfgs_decisions.decide` takes them."""
        change = trial_gradient - self.gradient
        pairs = (trial_gradient, self.direction), (change, self.direction), (change, change), (change, trial_gradient)
        direction_dots = torch.stack([torch.linalg.vecdot(*pair) for pair in pairs], dim=1)
        with_stored = torch.bmm(self._stored, trial_gradient.unsqueeze(2)).squeeze(2)
        return as_numbers(torch.cat([with_stored.gather(1, self._places()), direction_dots], dim=1))

    def take_step(self, decisions: Decisions, trial_gradient: Tensor) -> None:
        """Takes the steps of those that move, and updates their directions; ``trial_gradient`` is (A, N)."""
        steps, stores, coefficients = (
            torch.as_tensor(numbers) for numbers in (decisions.steps, decisions.stores, decisions.coefficients)
        )
        moves, rows, m = (steps > 0).unsqueeze(1), torch.arange(len(steps), device=steps.device), self.memory
        step = steps.unsqueeze(1) * self.direction
        self._newest = torch.where(stores, (self._newest + 1) % m, self._newest)
        for k, vector in enumerate((step, trial_gradient - self.gradient)):
            self._vectors[rows, torch.where(stores, 3 + k * m + self._newest, 3 + 2 * m)] = vector
        torch.where(moves, self.x + step, self.x, out=self.x)
        torch.where(moves, trial_gradient, self.gradient, out=self.gradient)
        by_place = torch.zeros_like(coefficients[:, :-1]).scatter(1, self._places(), coefficients[:, :-1])
        direction = torch.bmm(by_place.unsqueeze(1), self._stored).squeeze(1)
        direction.addcmul_(coefficients[:, -1:], trial_gradient)
        torch.where(moves, direction, self.direction, out=self.direction)
        slopes = torch.linalg.vecdot(self.gradient, self.direction)
        self.slopes = as_numbers(torch.where(steps > 0, slopes, torch.as_tensor(self.slopes)))
        self.peaks = as_numbers(self.gradient.abs().amax(1))

    def _places(self) -> Tensor:
        """Where the stored vectors are, (A, 2m): steps from the newest to the oldest, then changes of the gradient."""
        ages = torch.arange(self.memory, device=self._newest.device)
        places = (self._newest.unsqueeze(1) - ages) % self.memory
        return torch.cat([places, places + self.memory], dim=1)

    def keep(self, rows: Tensor) -> None:
        """Keeps only the problems ``rows`` (A',), on the CPU, most of which are where they will be."""
        moved = (rows != torch.arange(len(rows))).nonzero().squeeze(1)
        self._all[moved.to(self._all.device, non_blocking=True)] = select_rows(self._all, rows[moved])
        self._all = self._all[: len(rows)]
        self._name_rows(self.x.shape[1])
        self._newest, self.slopes, self.peaks = (
            select_rows(numbers, rows) for numbers in (self._newest, self.slopes, self.peaks)
        )


class NativeVectors(Vectors):
    """The same on a CPU by compiled loops, in as many threads as PyTorch takes."""

    def dots(self, trial_gradient: Tensor) -> Numbers:
        out = trial_gradient.new_empty(len(self._all), 2 * self.memory + 4)
        self._loop(_dots, trial_gradient, out)
        return as_numbers(out)

    def take_step(self, decisions: Decisions, trial_gradient: Tensor) -> None:
        arrays = decisions.steps, decisions.stores, decisions.coefficients, self.slopes, self.peaks
        self._loop(_take_step, trial_gradient, *arrays)

    def _loop(self, loop: Any, trial_gradient: Tensor, *arrays: Numbers) -> None:
        (count, n), double = self.x.shape, self.x.dtype == torch.float64
        rest = n, *self._all.shape[1:], self.memory, self._all, self._newest, trial_gradient, *arrays
        run_in_threads(loop, count, (double,), rest)


class LbfgsSearch:
    """The running problems of a batch: on a device, rounds wait for nothing until the next look (:mod:`.problems`)."""

    def __init__(
        self, objective: ObjectiveFunction, start: Tensor, memory: int, first_step: float, watch: Watch | None
    ) -> None:
        self.objective = objective
        values, gradient = objective(start, torch.arange(len(start), device=start.device))
        values = as_numbers(values.to(start.dtype, copy=True))
        self.running = Running(start, values, watch)
        kind = NativeVectors if self.running.at_once and native.available() else Vectors
        self.vectors, self.state = kind(start, gradient, memory, first_step), SearchState.from_values(values, memory)

    def advance(self) -> None:
        """Evaluates each trial point; where it is accepted, takes the step and updates the direction."""
        vectors, running, steps = self.vectors, self.running, self.state.steps
        values, gradient = self.objective(vectors.trial_points(steps), running.index)
        values, gradient = values.to(vectors.x.dtype, copy=True), gradient.to(vectors.x.dtype).contiguous()
        runs, dots = running.codes == 0, vectors.dots(gradient)
        self.state, decisions = decide(self.state, runs, vectors.slopes, as_numbers(values), dots)
        self.stays, self.last_steps = decisions.stays, steps - decisions.steps
        vectors.take_step(decisions, gradient)
        uphill = ~(vectors.slopes < 0) & runs  # rounding has spoilt the memory
        if possibly_any(uphill):
            vectors.turn_downhill(uphill)
            self.state = self.state.without_pairs(uphill)
        running.count(self.state.values)

    def end(self, gradient_tolerance: float, progress_tolerance: float) -> None:
        """Ends the problems that stop here; drops them, on a device now and then."""
        vectors, state, running = self.vectors, self.state, self.running
        stuck = vectors.find_vanishing_steps(self.stays, state.steps) if possibly_any(self.stays) else self.stays
        running.end(
            {
                StopReason.GRADIENT: vectors.peaks <= gradient_tolerance,
                StopReason.PROGRESS: running.find_stalled(progress_tolerance),
                StopReason.LINE_SEARCH: stuck,
            }
        )
        if not running.at_once:  # what has ended is evaluated again at its last point
            steps = array_namespace(state.steps).where(running.codes == 0, state.steps, self.last_steps)
            self.state = state._replace(steps=steps)
        rows = running.look(vectors.x, state.values)
        if rows is not None:
            vectors.keep(rows)
            self.state = SearchState(*(select_rows(numbers, rows) for numbers in self.state))


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
    search = LbfgsSearch(objective, start, memory, first_step, watch)
    for _ in range(1, max_evaluations):
        search.advance()
        search.end(gradient_tolerance, progress_tolerance)
        if not len(search.running.index):
            break
    return search.running.minimum(search.vectors.x, search.state.values)
