"""Scores of windows by a linear detector, compiled."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...runtime.arrays import Floats, Integers
from ...runtime.compile import compiled
from ...runtime.lanes import Array, Builder, Variable
from ...runtime.simd import lanes, vector_instruction

if TYPE_CHECKING:
    from llvmlite import ir

TOGETHER = 4  # windows that share the reading of weights


@vector_instruction
def _dot_products(
    write: Builder,
    grid: Array,
    starts: Array,
    first: ir.Value,
    step: ir.Value,
    weights: Array,
    runs: ir.Value,
    run: ir.Value,
    out: Array,
) -> None:
    """Of windows ``first`` and the next three, each in ``runs`` parts ``step`` apart, to ``out[first:]``.

    Each part is added up for itself, so that rounding errors do not grow with the length of all.
    """
    count = lanes(grid.itemsize)
    zero = write.constant(grid.vector(count), 0.0)
    totals, sums = ([Variable(zero) for _ in range(TOGETHER)] for _ in range(2))
    begins = [starts.load_scalar(write.add(first, k)) for k in range(TOGETHER)]
    with write.loop(runs) as part:
        for sum_ in sums:
            sum_.set(zero)
        with write.loop(run, count) as k:
            weight = weights.load(write.add(write.multiply(part, run), k), count)
            for begin, sum_ in zip(begins, sums, strict=True):
                values = grid.load(write.add(begin, write.multiply(part, step), k), count)
                sum_.set(values.multiply_add(weight, sum_.get()))
        for total, sum_ in zip(totals, sums, strict=True):
            total.set(total.get() + sum_.get())
    for k, total in enumerate(totals):
        out.store_scalar(write.add(first, k), total.get().sum())


@compiled
def window_scores(grid: Floats, starts: Integers, step: int, weights: Floats, runs: int, out: Floats) -> None:
    """Dot products of windows with the weights.

    Args:
        grid: blocks, in one line, with padding behind.
        starts: where windows begin in the grid, as many as a multiple of :data:`TOGETHER`.
        step: from one column of blocks of a window to the next.
        weights: those of each of the ``runs`` columns, padded with zeros to whole vectors.
        runs: columns of blocks of a window.
        out: a number a window.
    """
    run = weights.size // runs
    for first in range(0, np.int64(starts.size), 4):
        _dot_products(grid, starts, first, step, weights, runs, run, out)
