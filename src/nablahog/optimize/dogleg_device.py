"""The dogleg on a device, which is waited for once a trial.

A round is a step: conjugate gradients of all problems that have moved, in step with each other, then one trial of all
that run.  What a problem does not do is masked; the rules and, up to rounding, the numbers are those of :mod:`.dogleg`.
At the end of a round one transfer says which problems have ended and which have moved.
"""

from __future__ import annotations

import torch
from torch import Tensor

from . import endings
from .dogleg_rules import MODEL, PRODUCT, TRIAL, DoglegRules
from .gauss_newton import GraphJacobian
from .result import Accepted, History, Jacobian, LeastSquares, Linearizable, Minimum, StopReason, Watch
from .trust_region import Step, TrustRegion


class _Newton:
    """The last Gauss-Newton and Cauchy steps of all problems, as :class:`.trust_region.NewtonSteps`."""

    def __init__(self, like: Tensor) -> None:
        self.step, self.cauchy = like.new_zeros(2, *like.shape)
        self.image, self.cauchy_image = like.new_zeros(2, len(like), 0)  # M follows from the first linearisation

    def enter(self, rows: Tensor, step: Tensor, image: Tensor, cauchy: Tensor, cauchy_image: Tensor) -> None:
        """Those of the problems ``rows`` (A,): (A, N) and (A, M)."""
        if not self.image.shape[1]:
            self.image, self.cauchy_image = image.new_zeros(2, len(self.image), image.shape[1])
        self.step[rows], self.image[rows] = step, image
        self.cauchy[rows], self.cauchy_image[rows] = cauchy, cauchy_image


class DeviceDogleg:
    """A batch on its way.

    Attributes:
        x, value: (B, N), (B,), the lowest points so far.
        descent: (B, N), -Jᵀr there, half the negative gradient.
        spent: (B,), half evaluations.
        iterations: (B,), accepted steps.
        codes: (B,), of :func:`.endings.enter`.
        told: (B,), evaluations at the last trial.
        rows, moved: the problems that run, and those of them that have no linearisation at their point yet.
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
        self.rows = torch.arange(len(start), device=start.device)
        value, gradient = problem(self.x, self.rows)
        self.value, self.descent = value.clone(), -gradient / 2
        self.spent, self.iterations = torch.full_like(self.rows, TRIAL), torch.zeros_like(self.rows)
        self.codes = torch.zeros_like(self.rows, dtype=torch.int8)
        self.reasons = [StopReason.BUDGET] * len(start)
        self.history, self.region = History(self.value, len(start)), TrustRegion(self.value, radius)
        self.newton = _Newton(self.x)
        self.told = torch.zeros_like(self.spent)
        self.codes = endings.enter(
            self.codes,
            {
                StopReason.NOT_FINITE: ~(self.value.isfinite() & self.descent.isfinite().all(1)),
                StopReason.GRADIENT: self.rules.flat(self.descent[self.rows]),
                StopReason.BUDGET: self.rules.too_dear(self.spent[self.rows], MODEL + PRODUCT + TRIAL),
            },
        )
        everywhere = torch.ones_like(self.codes, dtype=torch.bool)
        self._look(self.rows, everywhere, everywhere)

    def run(self) -> Minimum:
        while len(self.rows):
            if len(self.moved):
                self._linearize()
            self._try()
        evaluations = (self.spent + 1) // 2
        return Minimum(self.x, self.value, evaluations, self.reasons, self.history.filled(int(evaluations.max())))

    def _end(self, rows: Tensor, holds: dict[StopReason, Tensor]) -> None:
        self.codes[rows] = endings.enter(self.codes[rows], holds)

    def _look(self, rows: Tensor, tried: Tensor, lower: Tensor) -> Tensor:
        """Reads what has become of ``rows`` (A,): which of them run, and which have moved.

        Args:
            rows: (A,).
            tried, lower: (A,), which have been evaluated, and which of these are at a new point.

        Returns:
            The latter, as indices.
        """
        evaluations = self.told[rows] = torch.where(tried, (self.spent[rows] + 1) // 2, self.told[rows])
        read = torch.stack([self.codes[rows].long(), lower.long(), evaluations, rows]).cpu()  # one wait for the device
        codes, moved, most, problems = read.unbind()
        done = endings.read(codes, problems, self.reasons)
        self.history.add(evaluations, rows, self.value[rows], int(most.max()))
        if self.watch is not None:
            self.watch(rows, evaluations)
        at_new, running = moved != 0, ~done
        self.rows, self.moved = (problems[which].to(rows.device) for which in (running, running & at_new))
        return problems[at_new].to(rows.device)

    def _linearize(self) -> None:
        """Gauss-Newton steps of the problems that have moved, by conjugate gradients."""
        rows, rules = self.moved, self.rules
        jacobian: Jacobian
        if isinstance(self.problem, Linearizable):
            jacobian = self.problem.linearize(self.x[rows], rows)
        else:
            jacobian = GraphJacobian(self.problem, self.x[rows], rows)
        self.spent[rows] += MODEL
        descent = self.descent[rows]
        direction = jacobian.precondition(descent)
        error = first_error = (descent * direction).sum(1)
        step, cauchy = torch.zeros_like(direction), torch.zeros_like(direction)
        image = cauchy_image = self.x.new_zeros(len(rows), jacobian.size)
        iterations, solving = torch.zeros_like(rows), self.codes[rows] == 0
        for iteration in range(1, rules.cg_iterations + 1):
            images = jacobian.jvp(direction)
            length = error / images.square().sum(1)
            taken = solving & length.isfinite()
            step, image = (
                torch.where(taken.unsqueeze(1), whole + length.unsqueeze(1) * part, whole)
                for whole, part in ((step, direction), (image, images))
            )
            iterations = iterations + taken
            self.spent[rows] += PRODUCT * solving
            first = (taken & (iterations == 1)).unsqueeze(1)
            cauchy, cauchy_image = torch.where(first, step, cauchy), torch.where(first, image, cauchy_image)
            self._end(rows, {StopReason.NOT_FINITE: solving & (iterations == 0)})
            cut = (iterations == 1) & (cauchy.norm(dim=1) >= self.region.radius[rows])
            solving = taken & ~cut & ~self.rules.too_dear(self.spent[rows], 2 * PRODUCT + TRIAL)
            if iteration == rules.cg_iterations:
                break
            # from the step itself, not from the last error: so rounding does not add up
            residual = descent - jacobian.vjp(image)
            preconditioned = jacobian.precondition(residual)
            now = (residual * preconditioned).sum(1)
            self.spent[rows] += PRODUCT * solving
            direction = torch.where(
                solving.unsqueeze(1), preconditioned + (now / error).unsqueeze(1) * direction, direction
            )
            error = torch.where(solving, now, error)
            solving = solving & ~((error / first_error).sqrt() <= rules.cg_tolerance)
            if iteration % endings.ROUNDS_BETWEEN_LOOKS == 0 and not solving.any():
                break
        self.newton.enter(rows, step, image, cauchy, cauchy_image)

    def _try(self) -> None:
        """The trial of each problem; those that it lowers move."""
        rows = self.rows
        step = self.region.step(self.newton, rows)
        self._end(rows, {StopReason.STEP: self.rules.short(step.length, self.x[rows])})
        running = self.codes[rows] == 0
        accepted, progress = self._take(rows, step, running)
        self._end(
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
        lower = self._look(rows, running, accepted)
        if self.accepted is not None and len(lower):
            self.accepted(lower, self.iterations[lower], self.x[lower])

    def _take(self, rows: Tensor, step: Step, running: Tensor) -> tuple[Tensor, Tensor]:
        """Which trials (A,) are accepted, and the share of the value (A,) that they take away, ∞ of the others."""
        before = self.value[rows]
        trial = self.x[rows] + step.step
        value, gradient = self.problem(trial, rows)
        self.spent[rows] += TRIAL * running
        predicted = 2 * (self.descent[rows] * step.step).sum(1) - step.image.square().sum(1)
        gain = (before - value) / predicted
        accepted = running & (gain > 0) & (value < before) & gradient.isfinite().all(1)
        self.region.update(rows, step.length, gain, accepted)
        progress = torch.where(accepted, (before - value) / before, torch.inf)
        column = accepted.unsqueeze(1)
        self.x[rows] = torch.where(column, trial, self.x[rows])
        self.value[rows] = torch.where(accepted, value, before)
        self.descent[rows] = torch.where(column, -gradient / 2, self.descent[rows])
        self.iterations[rows] += accepted
        return accepted, progress
