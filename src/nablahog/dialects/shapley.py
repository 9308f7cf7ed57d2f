"""The contribution of each convention to a distance: its Shapley value.

Source: Shapley, A Value for n-Person Games (1953).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from .conventions import Convention


@dataclass(frozen=True)
class ShapleyContribution:
    """The contribution of a convention to the squared distance of two descriptors.

    Attributes:
        convention: fields of the specs.
        settings: their values in each of both specs, as text.
        value: the part of the squared distance; below 0 if exchanging the convention increases the distance on average.
    """

    convention: Convention
    settings: tuple[str, str]
    value: float


def shapley(values: Sequence[float], players: int) -> list[float]:
    """Shapley values: the mean over all orders of what each player adds to the value of those before it.

    Args:
        values: (2^players,), the value of each subset; the first player is the highest bit of its index.
        players: their number, at most about a dozen.

    Returns:
        (players,), with the sum ``values[-1] - values[0]``.

    Raises:
        ValueError: there are more or fewer values than subsets.
    """
    if len(values) != 2**players:
        raise ValueError(f"expected the values of {2**players} subsets of {players} players, got {len(values)}")
    return [math.fsum(_weighted_gains(values, players, 1 << k)) for k in reversed(range(players))]


def _weighted_gains(values: Sequence[float], players: int, bit: int) -> Iterator[float]:
    """What the player of this bit adds to each subset without it, times the probability of that subset in an order."""
    for subset in range(2**players):
        if not subset & bit:
            size = subset.bit_count()
            weight = math.factorial(size) * math.factorial(players - size - 1) / math.factorial(players)
            yield weight * (values[subset | bit] - values[subset])
