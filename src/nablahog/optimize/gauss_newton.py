"""Gauss-Newton steps by conjugate gradients (Nocedal & Wright, Numerical Optimization, ch. 5 and 10), without a matrix.

The residuals are linearised once at each point, by keeping their graph; every product with J or Jᵀ is one pass through
it.  A Jacobian that is a product of simple ones stays so: with the global normaliser of Eq. 7, (I - c·vvᵀ)·a times the
local Jacobian of the histograms v, never the dense matrix that these make.  A :class:`~.problems.Linearizable` problem
brings its own products, and a preconditioner.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from .problems import ROUNDS_BETWEEN_LOOKS, Jacobian, LeastSquares


class GraphJacobian:
    """A :class:`~.problems.Jacobian` from the graph of the residuals.

    J·v is taken as the derivative by w of Jᵀ·w, which costs as much as Jᵀ·w.  PyTorch's forward mode would compute the
    residuals anew for each product; on HOG it takes four to six times as long.  The graphs of all its problems are in
    memory at once, some 7 MB for a UoCTTI image of 128x128 pixels.
    """

    def __init__(self, problem: LeastSquares, points: Tensor, index: Tensor) -> None:
        with torch.enable_grad():
            self._points = points.detach().requires_grad_()
            self._residuals = problem.residuals(self._points, index)
            self.size = self._residuals.shape[1]
            self._weights = torch.zeros_like(self._residuals, requires_grad=True)
            self._vjp = self._grad(self._residuals, self._points, self._weights, create_graph=True)

    @staticmethod
    def _grad(output: Tensor, inputs: Tensor, vectors: Tensor, create_graph: bool = False) -> Tensor:
        (product,) = torch.autograd.grad(output, inputs, vectors, retain_graph=True, create_graph=create_graph)
        return product

    def jvp(self, vectors: Tensor) -> Tensor:
        return self._grad(self._vjp, self._weights, vectors)

    def vjp(self, vectors: Tensor) -> Tensor:
        return self._grad(self._residuals, self._points, vectors)

    def precondition(self, vectors: Tensor) -> Tensor:
        return vectors  # none is known


class NewtonSteps(NamedTuple):
    """Gauss-Newton steps and Cauchy steps (A, N), and J times each (A, M)."""

    step: Tensor
    image: Tensor
    cauchy: Tensor
    cauchy_image: Tensor


def newton_steps(
    jacobian: Jacobian,
    descent: Tensor,
    radius: Tensor,
    budget: Tensor,
    iterations: int,
    tolerance: float,
    *,
    at_once: bool = True,
) -> tuple[NewtonSteps, Tensor, Tensor]:
    """Conjugate gradients on JᵀJ d = g, preconditioned, for each of A problems: ``descent`` (A, N) is g.

    From d = 0, the first iterate is the Cauchy step, the minimum of ‖J d‖² - 2gᵀd along g, or along W⁻¹g with a
    preconditioner W.  Without, all iterates lie in the range of Jᵀ, and their length grows: where JᵀJ is singular they
    tend to the shortest solution, and ended early they leave out the directions in which the residuals hardly change.

    A Cauchy step longer than ``radius`` (A,) will do, and a step for which ‖JᵀJ d - g‖ is at most a share ``tolerance``
    of ‖g‖, lengths ‖v‖² = vᵀW⁻¹v; ``budget`` (A,) is of products with J or Jᵀ.  Unless ``at_once``, a device is asked
    only once in ten iterations whether all have their steps.

    Returns:
        The steps; the products (A,) that each took; and whether there is a step, (A,): if not, J·g is 0 or not finite.
    """
    direction = jacobian.precondition(descent)
    error = first_error = (descent * direction).sum(1)  # (g - JᵀJ d)ᵀ W⁻¹ (g - JᵀJ d)
    step = cauchy = torch.zeros_like(direction)
    image = cauchy_image = descent.new_zeros(len(descent), jacobian.size)
    products = torch.zeros_like(budget)
    solving = found = torch.ones_like(budget, dtype=torch.bool)
    for iteration in range(1, iterations + 1):
        images = jacobian.jvp(direction)
        length = error / images.square().sum(1)
        products = products + solving
        solving = solving & length.isfinite()
        step, image = (
            torch.where(solving.unsqueeze(1), total + length.unsqueeze(1) * change, total)
            for total, change in ((step, direction), (image, images))
        )
        if iteration == 1:
            found, cauchy, cauchy_image = solving, step, image
            solving = solving & (cauchy.norm(dim=1) < radius)
        solving = solving & (products + 2 <= budget)
        if iteration == iterations or (at_once and not solving.any()):
            break
        # from the step itself, not from the last error, so that rounding does not accumulate
        residual = descent - jacobian.vjp(image)
        preconditioned = jacobian.precondition(residual)
        new_error = (residual * preconditioned).sum(1)
        products = products + solving
        conjugate = preconditioned + (new_error / error).unsqueeze(1) * direction
        direction, error = (
            torch.where(solving.unsqueeze(1), conjugate, direction),
            torch.where(solving, new_error, error),
        )
        solving = solving & ~((error / first_error).sqrt() <= tolerance)
        if (at_once or iteration % ROUNDS_BETWEEN_LOOKS == 0) and not solving.any():
            break
    return NewtonSteps(step, image, cauchy, cauchy_image), products, found
