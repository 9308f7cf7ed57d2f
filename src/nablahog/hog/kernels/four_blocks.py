"""The four-block normaliser compiled: a cell at a time.

Histograms are (images, rows, cols, bins), descriptors (images, rows, cols, channels).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...runtime.arrays import DType, Floats, Integers, Real
from ...runtime.compile import compiled, inlined
from .norm_simd import Corners, clipped, clipped_totals, copy, dot, half_sums, read_folded, read_line
from .norms import whole_eights


class FourBlocks(NamedTuple):
    """What the loops know of a ``FourBlockNorm``."""

    epsilon: Real
    clip: Real
    floor: bool
    missing: bool  # whether blocks that reach beyond the grid add nothing
    dropped: int  # outermost rings of cells that are not described
    signed: bool
    bins: int
    undirected: int  # bins of the contrast-insensitive histogram
    first: Integers  # (5,): first channel of each of PARTS, -1 if it is left out
    directed_texture: bool
    texture: Real  # factor of texture channels
    order: Integers  # (4,): the texture channel of the block up-left, up-right, down-left, down-right


class Work(NamedTuple):
    """Workspace for one image.  Blocks are those around cell corners: (rows + 1, cols + 1).

    What a cell has for each bin is in lines: see :mod:`.norm_simd`.
    """

    histogram: Floats  # line: of a cell
    undirected: Floats  # line: its contrast-insensitive histogram
    channels: Floats  # of a cell, and eight more: a line may reach into the next part, which is written later
    totals: Floats  # (4,): for each block of a cell, the sum of the clipped entries, or the gradient of its factor
    entries: Floats  # four lines: gradients of the clipped entries of each block
    grad: Floats  # line: gradients of a histogram
    energy: Floats  # (rows, cols)
    factors: Floats  # of blocks: what they multiply their cells by
    grad_factors: Floats


@compiled
def new_work(rows: int, cols: int, channels: int, scheme: FourBlocks, dtype: DType) -> Work:
    line, corners = whole_eights(scheme.bins), (rows + 1, cols + 1)
    return Work(
        np.zeros(line, dtype),
        np.zeros(whole_eights(scheme.undirected), dtype),
        np.zeros(channels + 8, dtype),
        np.zeros(4, dtype),
        np.zeros(4 * line, dtype),
        np.zeros(line, dtype),
        np.zeros((rows, cols), dtype),
        np.zeros(corners, dtype),
        np.zeros(corners, dtype),
    )


@inlined
def fold(histograms: Floats, at: int, scheme: FourBlocks, out: Floats) -> None:
    """The contrast-insensitive histogram of the cell at ``histograms[at:]``, to a line."""
    if scheme.signed:
        read_folded(histograms, at, scheme.undirected, scheme.undirected, out, 0)
    else:
        read_line(histograms, at, 0, scheme.undirected, out, 0)


@inlined
def block_factors(histograms: Floats, scheme: FourBlocks, work: Work) -> None:
    """What each block multiplies its cells by."""
    entries, energy, factors = work.undirected, work.energy, work.factors
    rows, cols = energy.shape
    for y in range(rows):
        for x in range(cols):
            fold(histograms, (y * cols + x) * scheme.bins, scheme, entries)
            energy[y, x] = dot(entries, 0, entries, 0, entries.size)
    one = scheme.epsilon / scheme.epsilon
    for y in range(rows + 1):
        up, down = max(y - 1, 0), min(y, rows - 1)
        for x in range(cols + 1):
            left, right = max(x - 1, 0), min(x, cols - 1)
            block = (energy[up, left] + energy[up, right]) + (energy[down, left] + energy[down, right])
            if scheme.floor:
                size = math.sqrt(block)
                factors[y, x] = one / (scheme.epsilon if size < scheme.epsilon else size)
            else:
                factors[y, x] = one / math.sqrt(block + scheme.epsilon)
            if scheme.missing and (y == 0 or x == 0 or y == rows or x == cols):
                factors[y, x] = 0


@inlined
def factors_of_cell(factors: Floats, y: int, x: int) -> Corners:
    return Corners(factors[y, x], factors[y, x + 1], factors[y + 1, x], factors[y + 1, x + 1])


@inlined
def _texture(entries: Floats, four: Corners, scheme: FourBlocks, totals: Floats, out: Floats, to: int) -> None:
    """For each block, the scaled sum of the clipped entries over all bins."""
    totals[:] = 0
    clipped_totals(entries, four, scheme.clip, totals)
    for block in range(4):
        out[to + scheme.order[block]] = scheme.texture * totals[block]


@inlined
def _describe_cell(histograms: Floats, at: int, scheme: FourBlocks, four: Corners, work: Work) -> None:
    """The channels of the cell at ``histograms[at:]``, to ``work.channels``."""
    directed, undirected, texture, blocks, zero = scheme.first
    n, clip, entries, out = scheme.undirected, scheme.clip, work.undirected, work.channels
    read_line(histograms, at, 0, scheme.bins, work.histogram, 0)
    fold(histograms, at, scheme, entries)
    if directed >= 0:
        half_sums(work.histogram, four, clip, out, directed)
    if undirected >= 0:
        half_sums(entries, four, clip, out, undirected)
    if texture >= 0:
        if scheme.directed_texture:
            _texture(work.histogram, four, scheme, work.totals, out, texture)
        else:
            _texture(entries, four, scheme, work.totals, out, texture)
    if blocks >= 0:
        for block in range(4):
            clipped(entries, four[block], clip, out, blocks + block * n)
    if zero >= 0:
        out[zero] = 0


@compiled
def four_block_norm(images: Floats, scheme: FourBlocks, start: int, stop: int, out: Floats) -> None:
    """Histograms of images ``start`` to ``stop`` to their descriptors."""
    _, rows, cols, bins = images.shape
    channels, drop = out.shape[3], scheme.dropped
    work = new_work(rows, cols, channels, scheme, images.dtype)
    factors, of_cell = work.factors, work.channels
    for image in range(start, stop):
        histograms, descriptor, to = images[image].reshape(-1), out[image].reshape(-1), 0
        block_factors(histograms, scheme, work)
        for y in range(drop, rows - drop):
            for x in range(drop, cols - drop):
                four = factors_of_cell(factors, y, x)
                _describe_cell(histograms, (y * cols + x) * bins, scheme, four, work)
                copy(of_cell, 0, channels, descriptor, to)
                to += channels
