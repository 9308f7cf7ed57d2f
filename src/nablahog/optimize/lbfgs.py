"""Limited-memory BFGS on a batch of independent problems (Nocedal & Wright, Numerical Optimization, ch. 7.2).

Each round evaluates every running problem once, at its own trial point.  A problem whose trial is accepted takes the
step and updates its direction at once; one whose trial is not shrinks or grows its step (:mod:`.lbfgs_decisions`).  No
problem waits for another.
"""

from __future__ import annotations

import torch
from torch import Tensor

from .. import native
from .lbfgs_decisions import SearchState, decide
from .lbfgs_vectors import NativeVectors, Vectors
from .result import Minimum, ObjectiveFunction, StopReason, Watch
from .running import Running, array_namespace, as_numbers, may_hold, of_rows


class LbfgsSearch:
    """The running problems of a batch: on a device, rounds wait for nothing until the next look (:mod:`.running`)."""

    def __init__(
        self, objective: ObjectiveFunction, start: Tensor, memory: int, first_step: float, watch: Watch | None
    ) -> None:
        self.objective = objective
        values, gradient = objective(start, torch.arange(len(start), device=start.device))
        values = as_numbers(values.to(start.dtype, copy=True))
        self.running = Running(start, values, watch)
        kind = NativeVectors if self.running.at_once and native.available() else Vectors
        self.vectors, self.state = kind(start, gradient, memory, first_step), SearchState.at_start(values, memory)

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
        if may_hold(uphill):
            vectors.turn_downhill(uphill)
            self.state = self.state.without_pairs(uphill)
        running.count(self.state.values)

    def end(self, gradient_tolerance: float, progress_tolerance: float) -> None:
        """Ends the problems that stop here; drops them, on a device now and then."""
        vectors, state, running = self.vectors, self.state, self.running
        stuck = vectors.lost(self.stays, state.steps) if may_hold(self.stays) else self.stays
        running.end(
            {
                StopReason.GRADIENT: vectors.peaks <= gradient_tolerance,
                StopReason.PROGRESS: running.slow(progress_tolerance),
                StopReason.LINE_SEARCH: stuck,
            }
        )
        if not running.at_once:  # what has ended is evaluated again at its last point
            steps = array_namespace(state.steps).where(running.codes == 0, state.steps, self.last_steps)
            self.state = state._replace(steps=steps)
        rows = running.look(vectors.x, state.values)
        if rows is not None:
            vectors.keep(rows)
            self.state = SearchState(*(of_rows(each, rows) for each in self.state))

    def minimum(self) -> Minimum:
        return self.running.minimum(self.vectors.x, self.state.values)


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
    return search.minimum()
