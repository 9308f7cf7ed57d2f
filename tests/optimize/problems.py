"""Least-squares problems with known minima, most of them from Moré, Garbow & Hillstrom (ACM TOMS 7, 1981)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from nablahog.optimize import LeastSquares


class SumOfSquares:
    """A :class:`LeastSquares` problem from residuals (points (A, N), index (A,)) to (A, M); counts its calls."""

    def __init__(self, function: Callable[[Tensor, Tensor], Tensor]) -> None:
        self.function = function
        self.points: list[Tensor] = []
        self.linearised = 0

    def __call__(self, points: Tensor, index: Tensor) -> tuple[Tensor, Tensor]:
        self.points.append(points.clone())
        points = points.detach().requires_grad_()
        value = self.function(points, index).square().sum(1)
        (gradient,) = torch.autograd.grad(value.sum(), points)
        return value.detach(), gradient

    def residuals(self, points: Tensor, index: Tensor) -> Tensor:
        self.linearised += 1
        return self.function(points, index)


def quadratic(condition: float) -> Callable[[Tensor], Tensor]:
    """Residuals of Σ h_i (x_i - i/N)², the curvatures h spread over 1…condition."""

    def residuals(x: Tensor) -> Tensor:
        n = x.shape[1]
        curvatures = torch.logspace(0, torch.tensor(condition).log10().item(), n, dtype=x.dtype)
        return curvatures.sqrt() * (x - torch.arange(n, dtype=x.dtype) / n)

    return residuals


def rosenbrock(x: Tensor) -> Tensor:
    return torch.stack([10 * (x[:, 1] - x[:, 0] ** 2), 1 - x[:, 0]], dim=1)


def beale(x: Tensor) -> Tensor:
    return torch.stack([y - x[:, 0] * (1 - x[:, 1] ** k) for k, y in ((1, 1.5), (2, 2.25), (3, 2.625))], dim=1)


def powell_singular(x: Tensor) -> Tensor:
    """JᵀJ is singular at the minimum."""
    a, b, c, d = x.unbind(1)
    return torch.stack([a + 10 * b, 5**0.5 * (c - d), (b - 2 * c) ** 2, 10**0.5 * (a - d) ** 2], dim=1)


def exponentials(x: Tensor) -> Tensor:
    """Osborne-like: y(t) = a·e^(-bt) + c fitted to data that no such curve meets, so residuals remain."""
    t = torch.linspace(0, 3, 12, dtype=x.dtype)
    return x[:, :1] * torch.exp(-x[:, 1:2] * t) + x[:, 2:3] - (2 * torch.exp(-1.3 * t) + 0.5 + 0.1 * torch.sin(5 * t))


@dataclass(frozen=True)
class Case:
    residuals: Callable[[Tensor], Tensor]
    start: tuple[float, ...]
    minimum: tuple[float, ...]

    def problem(self) -> LeastSquares:
        return SumOfSquares(lambda x, index: self.residuals(x))

    def points(self, dtype: torch.dtype = torch.float64) -> Tensor:
        """(1, N)."""
        return torch.tensor([self.start], dtype=dtype)


CASES = {
    "round": Case(quadratic(1), (3.0,) * 20, tuple(i / 20 for i in range(20))),
    "long": Case(quadratic(1e3), (1.5, -0.7) * 15, tuple(i / 30 for i in range(30))),
    "rosenbrock": Case(rosenbrock, (-1.2, 1), (1, 1)),
    "beale": Case(beale, (1, 1), (3, 0.5)),
    "powell": Case(powell_singular, (3, -1, 0, 1), (0, 0, 0, 0)),
}


def mixed() -> tuple[SumOfSquares, Tensor]:
    """Rosenbrock, Beale and Powell's singular function as one batch, padded to four unknowns and four residuals."""
    functions = [rosenbrock, beale, powell_singular]

    def residuals(x: Tensor, index: Tensor) -> Tensor:
        each = [torch.nn.functional.pad(r, (0, 4 - r.shape[1])) for r in (f(x) for f in functions)]
        return torch.stack(each)[index, torch.arange(len(x))]

    start = torch.zeros(3, 4, dtype=torch.float64)
    for row, name in zip(start, ("rosenbrock", "beale", "powell"), strict=True):
        row[: len(CASES[name].start)] = torch.tensor(CASES[name].start)
    return SumOfSquares(residuals), start


def only(problem: SumOfSquares, row: int) -> SumOfSquares:
    """One problem of a batch, alone."""
    return SumOfSquares(lambda x, index: problem.function(x, index + row))
