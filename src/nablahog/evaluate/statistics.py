"""A mean with its uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

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
    means = np.random.default_rng(0).choice(array, (RESAMPLES, len(array))).mean(axis=1)
    low, high = np.quantile(means, (0.025, 0.975))
    return Statistics(float(array.mean()), float(np.median(array)), float(low), float(high), len(array))
