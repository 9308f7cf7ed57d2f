"""Powell's dogleg on a batch of independent least-squares problems, without any matrix.

The rules are those of Chumpy's ``minimize_dogleg``, which the paper uses: steps, radius, stops and their constants.
One thing differs: Chumpy solves for the Gauss-Newton step directly, here conjugate gradients do (:mod:`.gauss_newton`),
as exactly as ``cg_tolerance`` says.
The steps along the path and the radius are in :mod:`.trust_region`.

In each round every running problem does what is next for it: one iteration of conjugate gradients, the trial of a step,
or both.  No problem waits for another.  On a GPU, where the device would be waited for, rounds are whole steps:
:mod:`.dogleg_device`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from . import endings
from .dogleg_device import DeviceDogleg
from .dogleg_rules import MODEL, PRODUCT, TRIAL, DoglegRules
from .gauss_newton import GaussNewtonSteps
from .result import Accepted, History, LeastSquares, Minimum, ObjectiveFunction, StopReason, Watch
from .trust_region import Step, TrustRegion


class _Phases:
    """Which problems look for a Gauss-Newton step (``solving``), and which have one to try (``trying``).

    The others have stopped; ``reasons`` says why.
    """

    def __init__(self, like: Tensor) -> None:
        self.solving = torch.ones(len(like), dtype=torch.bool, device=like.device)
        self.trying = torch.zeros_like(self.solving)
        self.reasons = [StopReason.BUDGET] * len(like)

    def running(self) -> bool:
        return bool((self.solving | self.trying).any())

    def try_step(self, rows: Tensor, mask: Tensor) -> None:
        """Those of ``rows`` (A,) for which ``mask`` (A,) holds have their step, unless they have stopped."""
        rows = rows[mask & self.solving[rows]]
        self.solving[rows], self.trying[rows] = False, True

    def solve(self, rows: Tensor) -> None:
        """The problems ``rows`` (A,) look for their next step."""
        self.solving[rows], self.trying[rows] = True, False

    def stop(self, rows: Tensor, holds: Mapping[StopReason, Tensor]) -> None:
        """Stops those of ``rows`` (A,) for which a reason holds, (A,) each, unless they have stopped before."""
        for reason, mask in holds.items():
            stopped = rows[mask & (self.solving[rows] | self.trying[rows])]
            self.solving[stopped] = self.trying[stopped] = False
            for problem in stopped.tolist():
                self.reasons[problem] = reason


class _Search:
    """A batch on its way.

    Attributes:
        x, value: (B, N), (B,), the lowest points so far.
        descent: (B, N), -Jᵀr there, half the negative gradient.
        spent: (B,), half evaluations.
        iterations: (B,), accepted steps.
        moved: rows that have no linearisation at their point yet.
    """

    def __init__(
        self,
        problem: LeastSquares,
        start: Tensor,
        radius: float | None,
        rules: DoglegRules,
        watch: Watch | None,
        accepted: Accepted | None,
    ) -> None:
        self.problem, self.rules, self.watch, self.accepted = problem, rules, watch, accepted
        self.x = start.detach().clone()
        rows = torch.arange(len(self.x), device=self.x.device)
        self.value, gradient = problem(self.x, rows)
        self.descent = -gradient / 2
        self.spent, self.iterations = torch.full_like(rows, TRIAL), torch.zeros_like(rows)
        self.history = History(self.value, len(rows))
        self.newton, self.region = GaussNewtonSteps(self.x), TrustRegion(self.value, radius)
        self.phases = _Phases(self.value)
        self._record(rows)
        not_finite = ~(self.value.isfinite() & self.descent.isfinite().all(1))
        self.phases.stop(
            rows,
            {
                StopReason.NOT_FINITE: not_finite,
                StopReason.GRADIENT: self.rules.flat(self.descent[rows]),
                StopReason.BUDGET: self.rules.too_dear(self.spent[rows], MODEL + PRODUCT + TRIAL),
            },
        )
        self.moved = rows[self.phases.solving]

    def _record(self, rows: Tensor) -> None:
        evaluations = (self.spent[rows] + 1) // 2
        self.history.add(evaluations, rows, self.value[rows])
        if self.watch is not None:
            self.watch(rows, evaluations)

    def solve(self) -> None:
        """One iteration of conjugate gradients of each problem that looks for a Gauss-Newton step."""
        newton, phases, rules = self.newton, self.phases, self.rules
        if len(self.moved):
            newton.linearize(self.problem, self.x[self.moved], self.moved, self.descent[self.moved])
            self.spent[self.moved] += MODEL
        rows = phases.solving.nonzero().squeeze(1)
        if len(rows):
            stepped = newton.take_step(rows)
            self.spent[rows] += PRODUCT
            phases.stop(rows, {StopReason.NOT_FINITE: newton.iterations[rows] == 0})
            cut = (newton.iterations[rows] == 1) & (newton.cauchy[rows].norm(dim=1) >= self.region.radius[rows])
            last = newton.iterations[rows] >= rules.cg_iterations
            phases.try_step(rows, cut | ~stepped | last | self.rules.too_dear(self.spent[rows], 2 * PRODUCT + TRIAL))
        rows = phases.solving.nonzero().squeeze(1)
        if len(rows):
            error = newton.update_direction(rows)
            self.spent[rows] += PRODUCT
            phases.try_step(rows, error <= rules.cg_tolerance)
        newton.release((~phases.solving).nonzero().squeeze(1))

    def try_steps(self) -> None:
        """The trial of each problem that has a step; those that it lowers move."""
        rows = self.phases.trying.nonzero().squeeze(1)
        self.moved = rows[:0]
        if not len(rows):
            return
        step = self.region.step(self.newton, rows)
        self.phases.stop(rows, {StopReason.STEP: self.rules.short(step.length, self.x[rows])})
        trying = self.phases.trying[rows]
        rows, step = rows[trying], step.of(trying)
        if len(rows):
            accepted, progress = self._try(rows, step)
            self.phases.stop(
                rows,
                {
                    StopReason.GRADIENT: self.rules.flat(self.descent[rows]),
                    StopReason.PROGRESS: progress < self.rules.progress_tolerance,
                    StopReason.RADIUS: self.rules.short(self.region.radius[rows], self.x[rows]),
                    StopReason.ITERATIONS: self.iterations[rows] >= self.rules.max_iterations,
                    StopReason.BUDGET: self.rules.too_dear(
                        self.spent[rows], torch.where(accepted, MODEL + PRODUCT + TRIAL, TRIAL)
                    ),
                },
            )
            moved = rows[accepted]
            self.moved = moved[self.phases.solving[moved]]

    def _try(self, rows: Tensor, step: Step) -> tuple[Tensor, Tensor]:
        """Which trials (A,) are accepted, and the share of the value (A,) that they take away, ∞ of the others."""
        trial = self.x[rows] + step.step
        value, gradient = self.problem(trial, rows)
        self.spent[rows] += TRIAL
        predicted = 2 * (self.descent[rows] * step.step).sum(1) - step.image.square().sum(1)
        gain = (self.value[rows] - value) / predicted
        accepted = (gain > 0) & (value < self.value[rows]) & gradient.isfinite().all(1)
        self.region.update(rows, step.length, gain, accepted)
        progress = torch.where(accepted, (self.value[rows] - value) / self.value[rows], torch.inf)
        lower = rows[accepted]
        self.x[lower], self.value[lower] = trial[accepted], value[accepted]
        self.descent[lower] = -gradient[accepted] / 2
        self.iterations[lower] += 1
        self._record(rows)
        if self.accepted is not None and len(lower):
            self.accepted(lower, self.iterations[lower], self.x[lower])
        self.phases.solve(lower)
        return accepted, progress

    def minimum(self) -> Minimum:
        evaluations = (self.spent + 1) // 2
        history = self.history.filled(int(evaluations.max()))
        return Minimum(self.x, self.value, evaluations, self.phases.reasons, history)


def dogleg(
    problem: LeastSquares | ObjectiveFunction,
    start: Tensor,
    *,
    radius: float | None = None,
    watch: Watch | None = None,
    accepted: Accepted | None = None,
    **rules: Any,
) -> Minimum:
    """Minimise a batch of sums of squares.

    Args:
        problem: :class:`LeastSquares`, called with the running problems' points and indices only.  Problems must not
            influence each other.
        start: (B, N), float32 or float64.
        radius: of the first trust region (``delta_0``); by default the length of the first Gauss-Newton step.
        watch: see :data:`.result.Watch`.
        accepted: see :data:`.result.Accepted`.
        rules: budget and tolerances, the fields of :class:`DoglegRules`.

    Returns:
        For each problem the lowest point found, never worse than its start.

    Raises:
        TypeError: the problem has no residuals, or there is no such rule.
    """
    if not isinstance(problem, LeastSquares):
        raise TypeError(f"dogleg needs a problem with residuals (LeastSquares), got {type(problem).__name__}")
    options = problem, start, radius, DoglegRules(**rules), watch, accepted
    if not endings.dropped_at_once(start):
        return DeviceDogleg(*options).run()
    search = _Search(*options)
    while search.phases.running():
        search.solve()
        search.try_steps()
    return search.minimum()
