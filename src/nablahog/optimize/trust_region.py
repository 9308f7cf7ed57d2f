"""The trust region of the dogleg: where its path leaves the radius, and how a trial changes the radius.

The constants are those of Chumpy's ``minimize_dogleg``; the path is that of Nocedal & Wright, ch. 4.1.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import torch
from torch import Tensor

GOOD, GROWN = 0.9, 2.5  # a gain above GOOD makes the radius at least GROWN steps long
BAD, SHRUNK = 0.05, 0.25  # a gain below BAD shrinks the radius


class NewtonSteps(Protocol):
    """Gauss-Newton steps and Cauchy steps (B, N), and J times each (B, M)."""

    step: Tensor
    image: Tensor
    cauchy: Tensor
    cauchy_image: Tensor


class Step(NamedTuple):
    """Steps (A, N) with J times each (A, M) and their lengths (A,)."""

    step: Tensor
    image: Tensor
    length: Tensor

    def of(self, mask: Tensor) -> Step:
        """Those for which ``mask`` (A,) holds."""
        return Step(*(tensor[mask] for tensor in self))


def path_weights(cauchy: Tensor, newton: Tensor, radius: Tensor) -> tuple[Tensor, Tensor]:
    """Where the path 0, cauchy, newton (A, N) ends or leaves the radius (A,): weights (A, 1) of cauchy and newton."""
    length = cauchy.norm(dim=1)
    outside = length >= radius
    leg = newton - cauchy
    # the root of ‖cauchy + t·leg‖ = radius, in the form that subtracts no nearly equal numbers
    along, room = (cauchy * leg).sum(1), radius.square() - length.square()
    t = room / (along + (along.square() + leg.square().sum(1) * room).sqrt())
    t = torch.where(newton.norm(dim=1) <= radius, 1, t)
    of_cauchy, of_newton = torch.where(outside, radius / length, 1 - t), torch.where(outside, 0, t)
    return of_cauchy.unsqueeze(1), of_newton.unsqueeze(1)


class TrustRegion:
    """The radius of each problem.

    Args:
        like: (B,), dtype and device.
        radius: the first; None for the length of the first step.
    """

    def __init__(self, like: Tensor, radius: float | None) -> None:
        self.radius = torch.full_like(like, torch.inf if radius is None else radius)

    def step(self, newton: NewtonSteps, rows: Tensor) -> Step:
        """The dogleg steps of the problems ``rows`` (A,)."""
        weights = path_weights(newton.cauchy[rows], newton.step[rows], self.radius[rows])
        step = weights[0] * newton.cauchy[rows] + weights[1] * newton.step[rows]
        image = weights[0] * newton.cauchy_image[rows] + weights[1] * newton.image[rows]
        length = step.norm(dim=1)
        self.radius[rows] = torch.where(self.radius[rows].isinf(), length, self.radius[rows])
        return Step(step, image, length)

    def update(self, rows: Tensor, length: Tensor, gain: Tensor, accepted: Tensor) -> None:
        """After trials of the problems ``rows`` (A,).

        Args:
            rows: (A,).
            length: (A,), of their steps.
            gain: (A,), the decrease as a share of the predicted one.
            accepted: (A,).
        """
        radius = self.radius[rows]
        grown = torch.where(gain > GOOD, torch.maximum(radius, GROWN * length), radius)
        self.radius[rows] = torch.where(accepted & (gain >= BAD), grown, SHRUNK * radius)
        # Chumpy tries a rejected Gauss-Newton step again until the radius cuts it; each trial would fail like the first
        self.radius[rows] = torch.where(accepted, self.radius[rows], shrunk_below(self.radius[rows], length))


def shrunk_below(radius: Tensor, length: Tensor) -> Tensor:
    """Radii (A,), as often a quarter of them as it takes to be less than lengths (A,) above 0."""
    times = (torch.log2(radius / length) / 2).floor().clamp(min=-1) + 1
    times = torch.where((times > 0) & (torch.ldexp(radius, 2 - 2 * times) < length), times - 1, times)  # rounding
    shrunk = torch.ldexp(radius, -2 * times)
    return torch.where(shrunk >= length, SHRUNK * shrunk, shrunk)
