"""The trust region of the dogleg: where its path leaves the radius, and how a trial changes the radius.

The constants are those of Chumpy's ``minimize_dogleg``; the path is that of Nocedal & Wright, ch. 4.1.
"""

from __future__ import annotations

import torch
from torch import Tensor

GOOD, GROWN = 0.9, 2.5  # a gain above GOOD makes the radius at least GROWN steps long
BAD, SHRUNK = 0.05, 0.25  # a gain below BAD shrinks the radius


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


def next_radius(radius: Tensor, length: Tensor, gain: Tensor, accepted: Tensor) -> Tensor:
    """The radius (A,) after a trial.

    Args:
        radius: (A,), before.
        length: (A,), of the steps.
        gain: (A,), the decrease as a share of the predicted one.
        accepted: (A,), whether the steps are taken.
    """
    grown = torch.where(gain > GOOD, torch.maximum(radius, GROWN * length), radius)
    # Chumpy tries a rejected Gauss-Newton step again until the radius cuts it; each trial would fail like the first
    return torch.where(
        accepted, torch.where(gain >= BAD, grown, SHRUNK * radius), shrunk_below(SHRUNK * radius, length)
    )


def shrunk_below(radius: Tensor, length: Tensor) -> Tensor:
    """Radii (A,), as often a quarter of them as it takes to be less than lengths (A,) above 0."""
    times = (torch.log2(radius / length) / 2).floor().clamp(min=-1) + 1
    times = torch.where((times > 0) & (torch.ldexp(radius, 2 - 2 * times) < length), times - 1, times)  # rounding
    shrunk = torch.ldexp(radius, -2 * times)
    return torch.where(shrunk >= length, SHRUNK * shrunk, shrunk)
