"""Derivatives by differences and by the operator, side by side."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import torch
from torch import Tensor
from torch.testing import assert_close

from nablahog.hog import HOGSpec, hog
from nablahog.hog.orientation import votes

from .zoo import DOUBLE

Function: TypeAlias = Callable[[Tensor], Tensor]


def one_sided(f: Function, x: Tensor, direction: Tensor, h: float = 1e-4) -> tuple[Tensor, Tensor]:
    """The derivatives of f at x along ``direction``, from ahead and from behind, by differences of second order."""
    ahead = (4 * f(x + h * direction) - f(x + 2 * h * direction) - 3 * f(x)) / (2 * h)
    behind = (3 * f(x) - 4 * f(x - h * direction) + f(x - 2 * h * direction)) / (2 * h)
    return ahead, behind


def analytic(f: Function, x: Tensor, direction: Tensor) -> Tensor:
    """The derivative of f at x along ``direction`` that the operator returns, by both modes, which must agree."""
    _, forward = torch.func.jvp(f, (x,), (direction,))
    jacobian = torch.func.jacrev(f)(x)
    reverse = (jacobian.flatten(-x.dim()) * direction.flatten()).sum(-1)
    assert_close(forward, reverse, rtol=1e-6, atol=1e-9)
    return forward


def voter(spec: HOGSpec) -> Function:
    """The votes of one pixel as a function of its gradient (gx, gy)."""
    return lambda g: votes(g[0].view(1, 1, 1), g[1].view(1, 1, 1), spec).flatten()


def vector(*values: float, dtype: torch.dtype = DOUBLE) -> Tensor:
    return torch.tensor(values, dtype=dtype)


def assert_jacobian_equals_central_differences(x: Tensor, s: HOGSpec, tolerance: float = 1e-6) -> None:
    """All of the Jacobian of one image, by both modes, against central differences; relative to its largest entry."""
    basis = torch.eye(x.numel(), dtype=x.dtype).view(-1, *x.shape[1:])
    h = 1e-6
    central = ((hog(x + h * basis, s) - hog(x - h * basis, s)) / (2 * h)).flatten(1).T
    reverse = torch.func.jacrev(lambda z: hog(z, s))(x).reshape(central.shape)
    forward = torch.func.jacfwd(lambda z: hog(z, s))(x).reshape(central.shape)
    size = central.abs().max().item()
    assert size > 0
    assert_close(reverse, central, rtol=0, atol=tolerance * size)
    assert_close(forward, reverse, rtol=0, atol=1e-12 * size)
