"""Gauss-Newton steps by conjugate gradients (Nocedal & Wright, Numerical Optimization, ch. 5 and 10), without a matrix.

The residuals are linearised once at each point, by keeping their graph; every product with J or Jᵀ is one pass through
it.  A Jacobian that is a product of simple ones stays so: with the global normaliser of Eq. 7, (I - c·vvᵀ)·a times the
local Jacobian of the histograms v, never the dense matrix that these make.
"""

from __future__ import annotations

import torch
from torch import Tensor

from .result import LeastSquares


class Linearization:
    """The Jacobians J of some problems of a batch, each at its point.

    J·v is taken as the derivative by w of Jᵀ·w, which costs as much as Jᵀ·w.  PyTorch's forward mode would compute the
    residuals anew for each product; on HOG it takes four to six times as long.  The graphs of all its problems are in
    memory at once, some 7 MB for a UoCTTI image of 128x128 pixels.

    Args:
        problem: whose J it is.
        points: (A, N).
        index: (A,), the problems at these points.

    Attributes:
        size: M, the number of residuals.
    """

    def __init__(self, problem: LeastSquares, points: Tensor, index: Tensor) -> None:
        self.index = index
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


class GaussNewtonSteps:
    """Conjugate gradients on JᵀJ d = g for each problem of a batch, half an iteration at a time.

    From d = 0, the first iterate is the Cauchy step, the minimum of ‖J d‖² - 2gᵀd along g.  All iterates lie in the
    range of Jᵀ, and their length grows: where JᵀJ is singular they tend to the shortest solution, and ended early they
    leave out the directions in which the residuals hardly change.

    Attributes:
        step: (B, N), the iterate.
        image: (B, M), J·step.
        cauchy, cauchy_image: the first iterate, and J times it.
        iterations: (B,) int64, those that led to ``step``.
    """

    def __init__(self, like: Tensor) -> None:
        self.descent, self.error, self.direction, self.step, self.cauchy = like.new_zeros(5, *like.shape)
        self.image, self.cauchy_image = like.new_zeros(2, len(like), 0)  # M follows from the first linearisation
        self.iterations = torch.zeros(len(like), dtype=torch.long, device=like.device)
        # problems that are linearised together share a graph for as long as one of them needs it
        self._models: dict[int, Linearization] = {}
        self._model = torch.zeros_like(self.iterations)  # number of the one that a problem uses
        self._made = 0

    def linearize(self, problem: LeastSquares, points: Tensor, rows: Tensor, descent: Tensor) -> None:
        """Starts anew the problems ``rows`` (A,), at ``points`` (A, N), where g is ``descent`` (A, N)."""
        model = Linearization(problem, points, rows)
        self._made += 1
        self._models[self._made], self._model[rows] = model, self._made
        if not self.image.shape[1]:
            self.image, self.cauchy_image = points.new_zeros(2, len(self.image), model.size)
        self.descent[rows] = self.error[rows] = self.direction[rows] = descent
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
        images = torch.zeros_like(self.image)
        for model, mask in self._used(rows):
            images[model.index[mask]] = model.jvp(self.direction[model.index])[mask]
        length = (self.error[rows] * self.direction[rows]).sum(1) / images[rows].square().sum(1)
        finite: Tensor = length.isfinite()
        rows, length = rows[finite], length[finite].unsqueeze(1)
        self.step[rows] += length * self.direction[rows]
        self.image[rows] += length * images[rows]
        self.iterations[rows] += 1
        first = rows[self.iterations[rows] == 1]
        self.cauchy[first], self.cauchy_image[first] = self.step[first], self.image[first]
        return finite

    def update_direction(self, rows: Tensor) -> Tensor:
        """Finds the next directions of the problems ``rows`` (A,): one product with Jᵀ.

        Returns:
            (A,), ‖JᵀJ·step - g‖ / ‖g‖.
        """
        products = torch.zeros_like(self.step)
        for model, mask in self._used(rows):
            products[model.index[mask]] = model.vjp(self.image[model.index])[mask]
        # from the step itself, not from the last error: so rounding does not add up
        error = self.descent[rows] - products[rows]
        before, now = self.error[rows].square().sum(1), error.square().sum(1)
        self.direction[rows] = error + (now / before).unsqueeze(1) * self.direction[rows]
        self.error[rows] = error
        accuracy: Tensor = (now / self.descent[rows].square().sum(1)).sqrt()
        return accuracy

    def _used(self, rows: Tensor) -> list[tuple[Linearization, Tensor]]:
        """The linearisations of the problems ``rows`` (A,), each with a mask of its problems among them."""
        included = torch.zeros_like(self._model, dtype=torch.bool)
        included[rows] = True
        return [
            (model, mask)
            for number, model in self._models.items()
            if (mask := included[model.index] & (self._model[model.index] == number)).any()
        ]
