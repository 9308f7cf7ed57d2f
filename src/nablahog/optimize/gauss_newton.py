"""Gauss-Newton steps by conjugate gradients (Nocedal & Wright, Numerical Optimization, ch. 5 and 10), without a matrix.

The residuals are linearised once at each point, by keeping their graph; every product with J or Jᵀ is one pass through
it.  A Jacobian that is a product of simple ones stays so: with the global normaliser of Eq. 7, (I - c·vvᵀ)·a times the
local Jacobian of the histograms v, never the dense matrix that these make.  A :class:`~.result.Linearizable` problem
brings its own products, and a preconditioner.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from .result import Jacobian, LeastSquares, Linearizable


class GraphJacobian:
    """A :class:`~.result.Jacobian` from the graph of the residuals.

    J·v is taken as the derivative by w of Jᵀ·w, which costs as much as Jᵀ·w.  PyTorch's forward mode would compute the
    residuals anew for each product; on HOG it takes four to six times as long.  The graphs of all its problems are in
    memory at once, some 7 MB for a UoCTTI image of 128x128 pixels.

    Args:
        problem: whose J it is.
        points: (A, N).
        index: (A,), the problems at these points.
    """

    def __init__(self, problem: LeastSquares, points: Tensor, index: Tensor) -> None:
        with torch.enable_grad():
            self._points = points.detach().requires_grad_()
            self._residuals = problem.residuals(self._points, index)
            self.size = self._residuals.shape[1]
            self._weights = torch.zeros_like(self._residuals, requires_grad=True)
            self._vjp = self._grad(self._residuals, self._points, self._weights, create_graph=True)

    @staticmethod
    def _grad(output: Tensor, of: Tensor, vectors: Tensor, create_graph: bool = False) -> Tensor:
        (product,) = torch.autograd.grad(output, of, vectors, retain_graph=True, create_graph=create_graph)
        return product

    def jvp(self, vectors: Tensor) -> Tensor:
        """J·v: (A, N) to (A, M)."""
        return self._grad(self._vjp, self._weights, vectors)

    def vjp(self, vectors: Tensor) -> Tensor:
        """Jᵀ·v: (A, M) to (A, N)."""
        return self._grad(self._residuals, self._points, vectors)

    def precondition(self, vectors: Tensor) -> Tensor:
        """None is known: the vectors themselves."""
        return vectors


class _Model(NamedTuple):
    """The problems (A,) that were linearised together, and their Jacobian."""

    problems: Tensor
    jacobian: Jacobian


class GaussNewtonSteps:
    """Conjugate gradients on JᵀJ d = g for each problem of a batch, preconditioned, half an iteration at a time.

    From d = 0, the first iterate is the Cauchy step, the minimum of ‖J d‖² - 2gᵀd along g, or along W⁻¹g with a
    preconditioner W.  Without, all iterates lie in the range of Jᵀ, and their length grows: where JᵀJ is singular they
    tend to the shortest solution, and ended early they leave out the directions in which the residuals hardly change.

    Attributes:
        step: (B, N), the iterate.
        image: (B, M), J·step.
        cauchy, cauchy_image: the first iterate, and J times it.
        iterations: (B,) int64, those that led to ``step``.
    """

    def __init__(self, like: Tensor) -> None:
        self.descent, self.direction, self.step, self.cauchy = like.new_zeros(4, *like.shape)
        self.first_error, self.error = like.new_zeros(2, len(like))  # (g - JᵀJ d)ᵀ W⁻¹ (g - JᵀJ d), at d = 0 and now
        self.image, self.cauchy_image = like.new_zeros(2, len(like), 0)  # M follows from the first linearisation
        self.iterations = torch.zeros(len(like), dtype=torch.long, device=like.device)
        # problems that are linearised together share a graph for as long as one of them needs it
        self._models: dict[int, _Model] = {}
        self._model = torch.zeros_like(self.iterations)  # number of the one that a problem uses
        self._made = 0

    def linearize(self, problem: LeastSquares, points: Tensor, rows: Tensor, descent: Tensor) -> None:
        """Starts anew the problems ``rows`` (A,), at ``points`` (A, N), where g is ``descent`` (A, N)."""
        jacobian: Jacobian
        if isinstance(problem, Linearizable):
            jacobian = problem.linearize(points, rows)
        else:
            jacobian = GraphJacobian(problem, points, rows)
        self._made += 1
        self._models[self._made], self._model[rows] = _Model(rows, jacobian), self._made
        if not self.image.shape[1]:
            self.image, self.cauchy_image = points.new_zeros(2, len(self.image), jacobian.size)
        direction = jacobian.precondition(descent)
        self.descent[rows], self.direction[rows] = descent, direction
        self.first_error[rows] = self.error[rows] = (descent * direction).sum(1)
        self.step[rows], self.image[rows], self.iterations[rows] = 0, 0, 0

    def release(self, rows: Tensor) -> None:
        """Frees the graphs that only the problems ``rows`` (A,) have used."""
        self._model[rows] = 0
        used = set(self._model.tolist())
        self._models = {number: model for number, model in self._models.items() if number in used}

    def take_step(self, rows: Tensor) -> Tensor:
        """Takes the best step of the problems ``rows`` (A,) along their directions: one product with J.

        Returns:
            (A,): whether there was one; if not, J·direction is 0, and ``step`` is as before.
        """
        taken = torch.zeros_like(self.iterations, dtype=torch.bool)
        for model, mask in self._used(rows):
            index, images = model.problems[mask], model.jacobian.jvp(self.direction[model.problems])[mask]
            length = self.error[index] / images.square().sum(1)
            finite = length.isfinite()
            taken[index] = finite
            index, length = index[finite], length[finite].unsqueeze(1)
            self.step[index] += length * self.direction[index]
            self.image[index] += length * images[finite]
        some = rows[taken[rows]]
        self.iterations[some] += 1
        first = some[self.iterations[some] == 1]
        self.cauchy[first], self.cauchy_image[first] = self.step[first], self.image[first]
        return taken[rows]

    def update_direction(self, rows: Tensor) -> Tensor:
        """Finds the next directions of the problems ``rows`` (A,): one product with Jᵀ.

        Returns:
            (A,), ‖JᵀJ·step - g‖ / ‖g‖, lengths ‖v‖² = vᵀW⁻¹v with a preconditioner.
        """
        for model, mask in self._used(rows):
            # from the step itself, not from the last error: so rounding does not add up
            error = self.descent[model.problems] - model.jacobian.vjp(self.image[model.problems])
            preconditioned = model.jacobian.precondition(error)
            index, now = model.problems[mask], (error * preconditioned).sum(1)[mask]
            conjugate = (now / self.error[index]).unsqueeze(1) * self.direction[index]
            self.direction[index] = preconditioned[mask] + conjugate
            self.error[index] = now
        accuracy: Tensor = (self.error[rows] / self.first_error[rows]).sqrt()
        return accuracy

    def _used(self, rows: Tensor) -> list[tuple[_Model, Tensor]]:
        """The linearisations of the problems ``rows`` (A,), each with a mask of its problems among them."""
        included = torch.zeros_like(self._model, dtype=torch.bool)
        included[rows] = True
        return [
            (model, mask)
            for number, model in self._models.items()
            if (mask := included[model.problems] & (self._model[model.problems] == number)).any()
        ]
