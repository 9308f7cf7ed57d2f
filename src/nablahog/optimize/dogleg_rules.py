"""What a dogleg may spend, and when it stops."""

from __future__ import annotations

from dataclasses import dataclass

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
