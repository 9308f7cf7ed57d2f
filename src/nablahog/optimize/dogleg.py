"""Powell's dogleg on a batch of independent least-squares problems, without any matrix.

The rules are those of Chumpy's ``minimize_dogleg``, which the paper uses: steps, radius, stops and their constants.
One thing differs: Chumpy solves for the Gauss-Newton step directly, here conjugate gradients do (:mod:`.gauss_newton`),
as exactly as ``cg_tolerance`` says.  The path in the trust region is that of Nocedal & Wright, ch. 4.1.

A round is a step: conjugate gradients of all problems that have moved, in step with each other, then one trial of all
that run.  What a problem does not do is masked.  A device is waited for once a round, to read which problems have ended
and which have moved.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import torch
from torch import Tensor

from .gauss_newton import GraphJacobian, NewtonSteps, newton_steps
from .problems import (
    Accepted,
    Jacobian,
    LeastSquares,
    Linearizable,
    Minimum,
    ObjectiveFunction,
    Running,
    StopReason,
    Watch,
)

TRIAL, MODEL, PRODUCT = 2, 1, 1  # half evaluations: value and gradient; residuals with their graph; J or Jᵀ times v
GOOD_GAIN, RADIUS_GROWTH = 0.9, 2.5  # a gain above GOOD_GAIN makes the radius at least RADIUS_GROWTH steps long
LEAST_GAIN, RADIUS_SHRINKAGE = 0.05, 0.25  # a gain below LEAST_GAIN shrinks the radius


@dataclass(frozen=True, kw_only=True)
class DoglegRules:
    """When the dogleg stops, and how exact its Gauss-Newton steps are.

    Attributes:
        max_evaluations: budget of each problem.  A trial, value and gradient, is one; the residuals to linearise, and J
            or Jᵀ times a vector, are half of one each.  Conjugate gradients end while enough is left to try their step.
        max_iterations: accepted steps of each problem (Chumpy's ``maxiter``).
        gradient_tolerance: stop a problem when the largest absolute entry of Jᵀr, half the gradient, is at most this
            (``e_1``).
        step_tolerance: stop a problem when its step or its radius is at most this share of ‖x‖ (``e_2``).
        progress_tolerance: stop a problem when a step lowers the value by less than this share of it (``e_3``).
        cg_iterations: the most for one Gauss-Newton step; 1 makes it the Cauchy step.
        cg_tolerance: a Gauss-Newton step will do when ‖JᵀJ d + Jᵀr‖ is at most this share of ‖Jᵀr‖.
    """

    max_evaluations: int = 300
    max_iterations: int = 200
    gradient_tolerance: float = 1e-15
    step_tolerance: float = 1e-15
    progress_tolerance: float = 0.0
    cg_iterations: int = 10
    cg_tolerance: float = 0.1

    def flat(self, descent: Tensor) -> Tensor:
        """Whether the gradient is small enough, (A,); ``descent`` (A, N) is -Jᵀr."""
        return descent.abs().amax(1) <= self.gradient_tolerance

    def too_dear(self, spent: Tensor, halves: int | Tensor) -> Tensor:
        """Whether further half evaluations, after those ``spent`` (A,), exceed the budget, (A,)."""
        return spent + halves > 2 * self.max_evaluations

    def short(self, length: Tensor, x: Tensor) -> Tensor:
        """Whether a step's length or the radius (A,) is too small at the points (A, N), (A,)."""
        short: Tensor = length <= self.step_tolerance * x.norm(dim=1)
        return short


class DoglegSearch:
    """The running problems of a batch.

    Attributes:
        x, value: (A, N), (A,), the lowest points so far.
        descent: (A, N), -Jᵀr there, half the negative gradient.
        spent: (A,), half evaluations.
        iterations: (A,), accepted steps.
        radius: (A,), of the trust region; at first ∞ for the length of the first step.
        newton: the last steps of all.
        moved: (A',), rows that have no linearisation at their point yet.
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
        self.problem, self.rules, self.accepted = problem, rules, accepted
        self.x = start.detach().clone()
        value, gradient = problem(self.x, torch.arange(len(start), device=start.device))
        self.value, self.descent = value.clone(), -gradient / 2
        self.running = running = Running(start, self.value, watch)
        self.spent, self.iterations = torch.full_like(running.index, TRIAL), torch.zeros_like(running.index)
        self.radius = torch.full_like(self.value, torch.inf if radius is None else radius)
        self.newton: NewtonSteps | None = None
        running.end(
            {
                StopReason.NOT_FINITE: ~(self.value.isfinite() & self.descent.isfinite().all(1)),
                StopReason.GRADIENT: rules.flat(self.descent),
                StopReason.BUDGET: rules.too_dear(self.spent, MODEL + PRODUCT + TRIAL),
            }
        )
        (codes,) = running.read()
        self._drop(codes, torch.ones_like(codes))

    def _drop(self, codes: Tensor, moved: Tensor) -> None:
        """Drops those that have ended, and notes which of the others have ``moved``, (A,) each, as read."""
        if codes.any():
            remaining = self.running.drop(codes, self.x, self.value)
            moved, rows = moved[remaining], remaining.to(self.x.device)
            self.x, self.value, self.descent = self.x[rows], self.value[rows], self.descent[rows]
            self.spent, self.iterations, self.radius = self.spent[rows], self.iterations[rows], self.radius[rows]
            self.newton = self.newton and NewtonSteps(*(tensor[rows] for tensor in self.newton))
        self.moved = moved.nonzero().squeeze(1).to(self.x.device)

    def linearize(self) -> None:
        """Gauss-Newton steps of the problems that have moved."""
        rows, rules, problem = self.moved, self.rules, self.problem
        linearize = problem.linearize if isinstance(problem, Linearizable) else partial(GraphJacobian, problem)
        jacobian: Jacobian = linearize(self.x[rows], self.running.index[rows])
        spent = self.spent[rows] + MODEL
        budget = 2 * rules.max_evaluations - TRIAL - spent
        newton, products, found = newton_steps(
            jacobian,
            self.descent[rows],
            self.radius[rows],
            budget,
            rules.cg_iterations,
            rules.cg_tolerance,
            at_once=self.running.at_once,
        )
        self.spent[rows] = spent + PRODUCT * products
        not_found = torch.zeros_like(self.running.codes, dtype=torch.bool).index_copy(0, rows, ~found)
        self.running.end({StopReason.NOT_FINITE: not_found})
        if self.newton is not None:
            newton = NewtonSteps(*(old.index_copy(0, rows, new) for old, new in zip(self.newton, newton, strict=True)))
        self.newton = newton

    def try_step(self) -> None:
        """The trial of each problem; those that it lowers move."""
        running, newton = self.running, self.newton
        assert newton is not None
        cauchy_weight, newton_weight = path_weights(newton.cauchy, newton.step, self.radius)
        step = cauchy_weight * newton.cauchy + newton_weight * newton.step
        image = cauchy_weight * newton.cauchy_image + newton_weight * newton.image
        length = step.norm(dim=1)
        self.radius = torch.where(self.radius.isinf(), length, self.radius)
        running.end({StopReason.STEP: self.rules.short(length, self.x)})
        tries = running.codes == 0
        trial = self.x + step
        value, gradient = self.problem(trial, running.index)
        self.spent = self.spent + TRIAL * tries
        predicted = 2 * (self.descent * step).sum(1) - image.square().sum(1)
        gain = (self.value - value) / predicted
        accepted = tries & (gain > 0) & (value < self.value) & gradient.isfinite().all(1)
        progress = torch.where(accepted, (self.value - value) / self.value, torch.inf)
        self.radius = next_radius(self.radius, length, gain, accepted)
        self.iterations = self.iterations + accepted
        self.x = torch.where(accepted.unsqueeze(1), trial, self.x)
        self.descent = torch.where(accepted.unsqueeze(1), -gradient / 2, self.descent)
        self.value = torch.where(accepted, value, self.value)
        running.count(self.value, (self.spent + 1) // 2)
        running.end(
            {
                StopReason.GRADIENT: self.rules.flat(self.descent),
                StopReason.PROGRESS: progress < self.rules.progress_tolerance,
                StopReason.RADIUS: self.rules.short(self.radius, self.x),
                StopReason.ITERATIONS: self.iterations >= self.rules.max_iterations,
                StopReason.BUDGET: self.rules.too_dear(
                    self.spent, torch.where(accepted, MODEL + PRODUCT + TRIAL, TRIAL)
                ),
            }
        )
        self.look(accepted)

    def look(self, accepted: Tensor) -> None:
        """Reads which problems have ended and which have moved, their trials ``accepted`` (A,)."""
        running = self.running
        codes, moved = running.read(accepted)
        rows = moved.nonzero().squeeze(1).to(self.x.device)
        if self.accepted is not None and len(rows):
            self.accepted(running.index[rows], self.iterations[rows], self.x[rows])
        self._drop(codes, moved)


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
        watch: see :data:`.problems.Watch`.
        accepted: see :data:`.problems.Accepted`.
        rules: budget and tolerances, the fields of :class:`DoglegRules`.

    Returns:
        For each problem the lowest point found, never worse than its start.

    Raises:
        TypeError: the problem has no residuals, or there is no such rule.
    """
    if not isinstance(problem, LeastSquares):
        raise TypeError(f"dogleg needs a problem with residuals (LeastSquares), got {type(problem).__name__}")
    search = DoglegSearch(problem, start, radius, DoglegRules(**rules), watch, accepted)
    while len(search.running.index):
        if len(search.moved):
            search.linearize()
        search.try_step()
    return search.running.minimum(search.x, search.value)


def path_weights(cauchy: Tensor, newton: Tensor, radius: Tensor) -> tuple[Tensor, Tensor]:
    """Where the path 0, cauchy, newton (A, N) ends or leaves the radius (A,): weights (A, 1) of cauchy and newton."""
    length = cauchy.norm(dim=1)
    outside = length >= radius
    leg = newton - cauchy
    # the root of ‖cauchy + t·leg‖ = radius, in the form that does not subtract nearly equal numbers
    along, room = (cauchy * leg).sum(1), radius.square() - length.square()
    t = room / (along + (along.square() + leg.square().sum(1) * room).sqrt())
    t = torch.where(newton.norm(dim=1) <= radius, 1, t)
    cauchy_weight, newton_weight = torch.where(outside, radius / length, 1 - t), torch.where(outside, 0, t)
    return cauchy_weight.unsqueeze(1), newton_weight.unsqueeze(1)


def next_radius(radius: Tensor, length: Tensor, gain: Tensor, accepted: Tensor) -> Tensor:
    """The radius (A,) after trials; ``gain`` (A,) is the decrease as a share of the predicted one."""
    grown = torch.where(gain > GOOD_GAIN, torch.maximum(radius, RADIUS_GROWTH * length), radius)
    # Chumpy tries a rejected Gauss-Newton step again until the radius cuts it; each trial would fail like the first
    return torch.where(
        accepted,
        torch.where(gain >= LEAST_GAIN, grown, RADIUS_SHRINKAGE * radius),
        shrink_below(RADIUS_SHRINKAGE * radius, length),
    )


def shrink_below(radius: Tensor, length: Tensor) -> Tensor:
    """Radii (A,), as often a quarter of them as it takes to be less than lengths (A,) above 0."""
    times = (torch.log2(radius / length) / 2).floor().clamp(min=-1) + 1
    times = torch.where((times > 0) & (torch.ldexp(radius, 2 - 2 * times) < length), times - 1, times)  # rounding
    shrunk = torch.ldexp(radius, -2 * times)
    return torch.where(shrunk >= length, RADIUS_SHRINKAGE * shrunk, shrunk)
