"""Means and medians with their uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

RESAMPLES = 10_000


@dataclass(frozen=True)
class Statistics:
    """Of n values: mean, median, and a 95 % interval of the mean; None if there are no values."""

    mean: float | None
    median: float | None
    low: float | None
    high: float | None
    n: int


def statistics(values: Sequence[float]) -> Statistics:
    """Mean, median and the percentile bootstrap interval of the mean, of :data:`RESAMPLES` resamples of fixed seed."""
    if not values:
        return Statistics(None, None, None, None, 0)
    array = np.array(values, dtype=np.float64)
    low, high = interval(array, np.mean)
    return Statistics(float(array.mean()), float(np.median(array)), low, high, len(array))


def interval(values: NDArray[np.float64], of: Callable[..., NDArray[np.float64]]) -> tuple[float, float]:
    """The 95 % percentile bootstrap interval of ``of(values)``, of :data:`RESAMPLES` resamples of fixed seed.

    Args:
        values: (n,), at least one.
        of: such as ``np.median``: takes the (resamples, n) and ``axis=1``.
    """
    resamples = np.random.default_rng(0).choice(values, (RESAMPLES, len(values)))
    low, high = np.quantile(of(resamples, axis=1), (0.025, 0.975))
    return float(low), float(high)
