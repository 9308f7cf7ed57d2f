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
        index: (A,), the problems that are there.

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
            self._pulled = self._grad(self._residuals, self._points, self._weights, create_graph=True)

    @staticmethod
    def _grad(output: Tensor, of: Tensor, vectors: Tensor, create_graph: bool = False) -> Tensor:
        (product,) = torch.autograd.grad(output, of, vectors, retain_graph=True, create_graph=create_graph)
        return product

    def times(self, vectors: Tensor) -> Tensor:
        """J·v: (A, N) to (A, M)."""
        return self._grad(self._pulled, self._weights, vectors)

    def transpose_times(self, vectors: Tensor) -> Tensor:
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
        self.image, self.cauchy_image = like.new_zeros(2, len(like), 0)  # M is not known yet
        self.iterations = torch.zeros(len(like), dtype=torch.long, device=like.device)
        # problems that began together share a graph for as long as one of them needs it
        self._models: dict[int, Linearization] = {}
        self._model = torch.zeros_like(self.iterations)  # number of the one that a problem uses
        self._made = 0

    def begin(self, problem: LeastSquares, points: Tensor, rows: Tensor, descent: Tensor) -> None:
        """The problems ``rows`` (A,) now are at ``points`` (A, N), where g is ``descent`` (A, N)."""
        model = Linearization(problem, points, rows)
        self._made += 1
        self._models[self._made], self._model[rows] = model, self._made
        if not self.image.shape[1]:
            self.image, self.cauchy_image = points.new_zeros(2, len(self.image), model.size)
        self.descent[rows] = self.error[rows] = self.direction[rows] = descent
        self.step[rows], self.image[rows], self.iterations[rows] = 0, 0, 0

    def end(self, rows: Tensor) -> None:
        """The problems ``rows`` (A,) need no more iterations where they are."""
        self._model[rows] = 0
        used = set(self._model.tolist())
        self._models = {number: model for number, model in self._models.items() if number in used}

    def advance(self, rows: Tensor) -> Tensor:
        """Half an iteration of the problems ``rows`` (A,), one product with J: the best step along the direction.

        Returns:
            (A,): whether there was one; if not, J does not see the direction, and ``step`` is as before.
        """
        seen = torch.zeros_like(self.image)
        for model, mine in self._used(rows):
            seen[model.index[mine]] = model.times(self.direction[model.index])[mine]
        length = (self.error[rows] * self.direction[rows]).sum(1) / seen[rows].square().sum(1)
        fine: Tensor = length.isfinite()
        rows, length = rows[fine], length[fine].unsqueeze(1)
        self.step[rows] += length * self.direction[rows]
        self.image[rows] += length * seen[rows]
        self.iterations[rows] += 1
        first = rows[self.iterations[rows] == 1]
        self.cauchy[first], self.cauchy_image[first] = self.step[first], self.image[first]
        return fine

    def turn(self, rows: Tensor) -> Tensor:
        """The other half, one product with Jᵀ: the next direction.

        Returns:
            (A,), ‖JᵀJ·step - g‖ / ‖g‖.
        """
        pulled = torch.zeros_like(self.step)
        for model, mine in self._used(rows):
            pulled[model.index[mine]] = model.transpose_times(self.image[model.index])[mine]
        # from the step itself, not from the last error: so rounding does not add up
        error = self.descent[rows] - pulled[rows]
        before, now = self.error[rows].square().sum(1), error.square().sum(1)
        self.direction[rows] = error + (now / before).unsqueeze(1) * self.direction[rows]
        self.error[rows] = error
        accuracy: Tensor = (now / self.descent[rows].square().sum(1)).sqrt()
        return accuracy

    def _used(self, rows: Tensor) -> list[tuple[Linearization, Tensor]]:
        """The linearisations of the problems ``rows`` (A,), and which of the problems of each are meant."""
        meant = torch.zeros_like(self._model, dtype=torch.bool)
        meant[rows] = True
        return [
            (model, mine)
            for number, model in self._models.items()
            if (mine := meant[model.index] & (self._model[model.index] == number)).any()
        ]
