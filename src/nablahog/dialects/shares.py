"""What each convention contributes to a distance: its Shapley value."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from .conventions import Convention


@dataclass(frozen=True)
class Share:
    """What a convention contributes to the squared distance of two descriptors.

    Attributes:
        convention: which.
        says: what each of both specs says of it.
        share: its part of the squared distance; below 0 if exchanging it, in the mean, brings them further apart.
    """

    convention: Convention
    says: tuple[str, str]
    share: float


def shapley(progress: Sequence[float], number: int) -> list[float]:
    """How far each of ``number`` conventions brings us when they are exchanged in turn, in the mean over all orders.

    There are at most a dozen, so none need be left to chance.

    Args:
        progress: how far we are after each subset of exchanges, (2^number,); the first has the highest bit.
        number: how many.

    Returns:
        (number,), of the sum ``progress[-1] - progress[0]``.

    Raises:
        ValueError: there are more or fewer figures than subsets.
    """
    if len(progress) != 2**number:
        raise ValueError(f"expected {2**number} figures for {number} conventions, got {len(progress)}")
    return [math.fsum(_weighted_steps(progress, number, 1 << k)) for k in reversed(range(number))]


def _weighted_steps(progress: Sequence[float], number: int, bit: int) -> Iterator[float]:
    """What the convention of this bit adds to each subset without it, times the share of orders that pass there."""
    for taken in range(2**number):
        if not taken & bit:
            size = taken.bit_count()
            weight = math.factorial(size) * math.factorial(number - size - 1) / math.factorial(number)
            yield weight * (progress[taken | bit] - progress[taken])
