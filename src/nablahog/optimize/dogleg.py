"""Powell's dogleg on a batch of independent least-squares problems, without any matrix.

The rules are those of Chumpy's ``minimize_dogleg``, which the paper uses: steps, radius, stops and their constants.
One thing differs: Chumpy solves for the Gauss-Newton step directly, here conjugate gradients do (:mod:`.gauss_newton`).

In each round every running problem does what is next for it: one iteration of conjugate gradients, the trial of a step,
or both.  No problem waits for another.
"""

from __future__ import annotations

import torch
from torch import Tensor

from .gauss_newton import GaussNewtonSteps
from .result import History, LeastSquares, Minimum, ObjectiveFunction, StopReason, Watch

GOOD, GROWN = 0.9, 2.5  # a gain above GOOD makes the radius at least GROWN steps long
BAD, SHRUNK = 0.05, 0.25  # a gain below BAD shrinks the radius
TRIAL, MODEL, PRODUCT = 2, 1, 1  # half evaluations: value and gradient; residuals with their graph; J or Jᵀ times v


def _on_path(cauchy: Tensor, newton: Tensor, radius: Tensor) -> tuple[Tensor, Tensor]:
    """Where the path 0, cauchy, newton (A, N) ends or leaves the radius (A,): weights (A, 1) of cauchy and newton."""
    length = cauchy.norm(dim=1)
    outside = length >= radius
    leg = newton - cauchy
    # the root of ‖cauchy + t·leg‖ = radius, in the form that subtracts no nearly equal numbers
    along, room = (cauchy * leg).sum(1), radius.square() - length.square()
    t = room / (along + (along.square() + leg.square().sum(1) * room).sqrt())
    t = torch.where(newton.norm(dim=1) <= radius, 1, t)
    of_cauchy, of_newton = torch.where(outside, radius / length, 1 - t), torch.where(outside, 0, t)
    return of_cauchy.unsqueeze(1), of_newton.unsqueeze(1)


class _Running:
    """Which problems still look for a Gauss-Newton step (``solving``) and which have one to try (``trying``)."""

    def __init__(self, like: Tensor) -> None:
        self.solving = torch.ones(len(like), dtype=torch.bool, device=like.device)
        self.trying = torch.zeros_like(self.solving)
        self.reasons = [StopReason.BUDGET] * len(like)

    def __bool__(self) -> bool:
        return bool((self.solving | self.trying).any())

    @staticmethod
    def rows(which: Tensor) -> Tensor:
        return which.nonzero().squeeze(1)

    def try_step(self, rows: Tensor, why: Tensor) -> None:
        """Those of ``rows`` (A,) for which ``why`` (A,) holds have their step, unless they have stopped."""
        rows = rows[why & self.solving[rows]]
        self.solving[rows], self.trying[rows] = False, True

    def solve(self, rows: Tensor) -> None:
        self.solving[rows], self.trying[rows] = True, False

    def stop(self, rows: Tensor, why: Tensor, reason: StopReason) -> None:
        """Stop those of ``rows`` (A,) for which ``why`` (A,) holds, unless they have stopped for another reason."""
        rows = rows[why & (self.solving[rows] | self.trying[rows])]
        self.solving[rows] = self.trying[rows] = False
        for problem in rows.tolist():
            self.reasons[problem] = reason


def dogleg(
    problem: LeastSquares | ObjectiveFunction,
    start: Tensor,
    *,
    max_evaluations: int = 300,
    max_iterations: int = 200,
    radius: float | None = None,
    gradient_tolerance: float = 1e-15,
    step_tolerance: float = 1e-15,
    progress_tolerance: float = 0.0,
    cg_iterations: int = 10,
    cg_tolerance: float = 0.1,
    watch: Watch | None = None,
) -> Minimum:
    """Minimise a batch of sums of squares.

    Args:
        problem: :class:`LeastSquares`, called with the running problems' points and indices only.  Problems must not
            influence each other.
        start: (B, N), float32 or float64.
        max_evaluations: budget of each problem.  A trial, value and gradient, is one; the residuals to linearise, and J
            or Jᵀ times a vector, are half of one each.  Conjugate gradients end while enough is left to try their step.
        max_iterations: accepted steps of each problem (Chumpy's ``maxiter``).
        radius: of the first trust region (``delta_0``); by default the length of the first Gauss-Newton step.
        gradient_tolerance: stop a problem when the largest absolute entry of Jᵀr, half the gradient, is at most this
            (``e_1``).
        step_tolerance: stop a problem when its step or its radius is at most this share of ‖x‖ (``e_2``).
        progress_tolerance: stop a problem when a step lowers the value by less than this share of it (``e_3``).
        cg_iterations: the most for one Gauss-Newton step; 1 makes it the Cauchy step.
        cg_tolerance: a Gauss-Newton step will do when ‖JᵀJ d + Jᵀr‖ is at most this share of ‖Jᵀr‖.
        watch: see :data:`Watch`.

    Returns:
        For each problem the lowest point found, never worse than its start.

    Raises:
        TypeError: the problem has no residuals.
    """
    if not isinstance(problem, LeastSquares):
        raise TypeError(f"dogleg needs a problem with residuals (LeastSquares), got {type(problem).__name__}")
    x = start.detach().clone()
    rows = torch.arange(len(x), device=x.device)
    value, gradient = problem(x, rows)
    descent = -gradient / 2  # g = -Jᵀr
    delta = torch.full_like(value, torch.inf if radius is None else radius)  # infinite: not yet known
    spent, budget = torch.full_like(rows, TRIAL), 2 * max_evaluations  # half evaluations
    steps = torch.zeros_like(rows)
    history = History(value, len(x))

    def record(rows: Tensor) -> None:
        evaluations = (spent[rows] + 1) // 2
        history.add(evaluations, rows, value[rows])
        if watch is not None:
            watch(rows, evaluations)

    record(rows)
    newton, running = GaussNewtonSteps(x), _Running(value)
    running.stop(rows, ~(value.isfinite() & descent.isfinite().all(1)), StopReason.NOT_FINITE)
    running.stop(rows, descent.abs().amax(1) <= gradient_tolerance, StopReason.GRADIENT)
    running.stop(rows, spent + MODEL + PRODUCT + TRIAL > budget, StopReason.BUDGET)
    moved = running.rows(running.solving)

    while running:
        if len(moved):
            newton.begin(problem, x[moved], moved, descent[moved])
            spent[moved] += MODEL
        rows = running.rows(running.solving)
        if len(rows):
            seen = newton.advance(rows)
            spent[rows] += PRODUCT
            running.stop(rows, newton.iterations[rows] == 0, StopReason.NOT_FINITE)
            cut = (newton.iterations[rows] == 1) & (newton.cauchy[rows].norm(dim=1) >= delta[rows])
            last = newton.iterations[rows] >= cg_iterations
            poor = spent[rows] + 2 * PRODUCT + TRIAL > budget
            running.try_step(rows, cut | ~seen | last | poor)
        rows = running.rows(running.solving)
        if len(rows):
            error = newton.turn(rows)
            spent[rows] += PRODUCT
            running.try_step(rows, error <= cg_tolerance)
        newton.end(running.rows(~running.solving))

        rows = running.rows(running.trying)
        of_cauchy, of_newton = _on_path(newton.cauchy[rows], newton.step[rows], delta[rows])
        step = of_cauchy * newton.cauchy[rows] + of_newton * newton.step[rows]
        image = of_cauchy * newton.cauchy_image[rows] + of_newton * newton.image[rows]
        length = step.norm(dim=1)
        delta[rows] = torch.where(delta[rows].isinf(), length, delta[rows])
        running.stop(rows, length <= step_tolerance * x[rows].norm(dim=1), StopReason.STEP)
        go_on = running.trying[rows]
        rows, step, image, length = rows[go_on], step[go_on], image[go_on], length[go_on]
        moved = rows[:0]
        if not len(rows):
            continue

        trial = x[rows] + step
        trial_value, trial_gradient = problem(trial, rows)
        spent[rows] += TRIAL
        predicted = 2 * (descent[rows] * step).sum(1) - image.square().sum(1)
        gain = (value[rows] - trial_value) / predicted
        accepted = (gain > 0) & (trial_value < value[rows]) & trial_gradient.isfinite().all(1)
        grown = torch.where(gain > GOOD, torch.maximum(delta[rows], GROWN * length), delta[rows])
        delta[rows] = torch.where(accepted & (gain >= BAD), grown, SHRUNK * delta[rows])
        # Chumpy tries a rejected Gauss-Newton step again and again until the radius cuts it; the outcome is known
        while len(same := rows[~accepted & (delta[rows] >= length)]):
            delta[same] *= SHRUNK

        better = rows[accepted]
        progress = torch.where(accepted, (value[rows] - trial_value) / value[rows], torch.inf)
        x[better], value[better] = trial[accepted], trial_value[accepted]
        descent[better] = -trial_gradient[accepted] / 2
        steps[better] += 1
        record(rows)
        running.solve(better)
        running.stop(rows, descent[rows].abs().amax(1) <= gradient_tolerance, StopReason.GRADIENT)
        running.stop(rows, progress < progress_tolerance, StopReason.PROGRESS)
        running.stop(rows, delta[rows] <= step_tolerance * x[rows].norm(dim=1), StopReason.RADIUS)
        running.stop(rows, steps[rows] >= max_iterations, StopReason.ITERATIONS)
        running.stop(
            rows, spent[rows] + torch.where(accepted, MODEL + PRODUCT + TRIAL, TRIAL) > budget, StopReason.BUDGET
        )
        moved = better[running.solving[better]]

    evaluations = (spent + 1) // 2
    return Minimum(x, value, evaluations, running.reasons, history.filled(int(evaluations.max())))
