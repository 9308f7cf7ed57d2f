"""What a dogleg may spend, and when it stops."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

TRIAL, MODEL, PRODUCT = 2, 1, 1  # half evaluations: value and gradient; residuals with their graph; J or Jᵀ times v


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
        """Whether so many more half evaluations than were ``spent`` (A,) are beyond the budget, (A,)."""
        return spent + halves > 2 * self.max_evaluations

    def short(self, length: Tensor, x: Tensor) -> Tensor:
        """Whether a step's length or the radius (A,) is too small at the points (A, N), (A,)."""
        short: Tensor = length <= self.step_tolerance * x.norm(dim=1)
        return short
