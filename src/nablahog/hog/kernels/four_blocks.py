"""The four-block normaliser compiled: a cell at a time, and its adjoint.

Histograms are (rows, cols, bins) of one image, descriptors (rows, cols, channels).  What a cell has for each bin is in
lines of whole eights, with zeros behind, so that eight bins go at a time.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ...runtime.compile import compiled, inlined
from ..normalizers.four_block import DPM_ORDER, DPM_TEXTURE, PARTS, VLFEAT_TEXTURE, FourBlockNorm
from .four_block_simd import clipped_sums, clipped_totals, clipped_vjp, dot_eight, total_of_eight
from .norms import copy


class FourBlocks(NamedTuple):
    """What the loops need to know of a :class:`.normalizers.FourBlockNorm`."""

    epsilon: Any
    clip: Any
    floor: bool
    missing: bool  # whether blocks that reach beyond the grid add nothing
    dropped: int  # outermost rings of cells that are not described
    signed: bool
    first: Any  # (5,): first channel of each of PARTS, -1 if it is left out
    directed_texture: bool
    texture: Any  # by which sums are multiplied
    order: Any  # (4,): the texture channel of the block up-left, up-right, down-left, down-right


def four_blocks(scheme: FourBlockNorm, bins: int, signed: bool, real: Any) -> FourBlocks:
    """In float32 or float64, ``real``, of so many bins."""
    channels = [scheme.channels_of(part, bins, signed) for part in PARTS]
    first = np.cumsum([0, *channels[:-1]])
    dpm = scheme.texture == "dpm"
    return FourBlocks(
        epsilon=real(scheme.epsilon),
        clip=real(scheme.clip),
        floor=scheme.floor,
        missing=scheme.outside == "missing",
        dropped=int(scheme.outside == "drop"),
        signed=signed,
        first=np.where(np.array(channels) > 0, first, -1),
        directed_texture=dpm,
        texture=real(DPM_TEXTURE if dpm else VLFEAT_TEXTURE),
        order=np.argsort(DPM_ORDER) if dpm else np.arange(4),
    )


@inlined
def _padded(count: int) -> int:
    return (count + 7) // 8 * 8


@inlined
def _undirected(histograms: Any, at: int, signed: bool, n: int, found: Any) -> None:
    """The contrast-insensitive histogram of the cell at ``histograms[at:]``."""
    first, opposite = np.uintp(at), np.uintp(at + n)
    if signed:
        for k in range(n):
            found[k] = histograms[first + np.uintp(k)] + histograms[opposite + np.uintp(k)]
    else:
        copy(histograms, at, n, found, 0)


@inlined
def _factors(histograms: Any, rows: int, cols: int, bins: int, scheme: Any, factors: Any) -> None:
    """What blocks multiply their cells with: (rows + 1, cols + 1), of the cell corners."""
    n = bins // 2 if scheme.signed else bins
    undirected, energy = np.zeros(_padded(n), histograms.dtype), np.empty((rows, cols), histograms.dtype)
    for y in range(rows):
        for x in range(cols):
            _undirected(histograms, (y * cols + x) * bins, scheme.signed, n, undirected)
            total = scheme.epsilon - scheme.epsilon
            for k in range(0, undirected.size, 8):
                total += dot_eight(undirected, k, undirected, k)
            energy[y, x] = total
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
def _of_cell(factors: Any, y: int, x: int, found: Any) -> None:
    """The factors of its four blocks: up-left, up-right, down-left, down-right."""
    found[0], found[1] = factors[y, x], factors[y, x + 1]
    found[2], found[3] = factors[y + 1, x], factors[y + 1, x + 1]


@compiled
def _describe(histograms: Any, rows: int, cols: int, bins: int, channels: int, scheme: Any, found: Any) -> None:
    """Histograms of one image, in one line, to its descriptor."""
    real, drop, clip = histograms.dtype, scheme.dropped, scheme.clip
    n = bins // 2 if scheme.signed else bins
    cell, undirected = np.zeros(_padded(bins), real), np.zeros(_padded(n), real)
    four, factors = np.empty(4, real), np.empty((rows + 1, cols + 1), real)
    _factors(histograms, rows, cols, bins, scheme, factors)
    directed, folded, texture, blocks, _ = scheme.first
    totals = np.empty(32, real)
    parts = np.zeros(channels + 8, real)  # each may overlap what comes after it, which is written later
    to = 0
    for y in range(drop, rows - drop):
        for x in range(drop, cols - drop):
            begin = (y * cols + x) * bins
            _of_cell(factors, y, x, four)
            copy(histograms, begin, bins, cell, 0)
            _undirected(histograms, begin, scheme.signed, n, undirected)
            if directed >= 0:
                for k in range(0, cell.size, 8):
                    clipped_sums(cell, k, four, clip, parts, directed + k)
            if folded >= 0:
                for k in range(0, undirected.size, 8):
                    clipped_sums(undirected, k, four, clip, parts, folded + k)
            if texture >= 0:
                totals[:] = 0
                entries = cell if scheme.directed_texture else undirected
                for k in range(0, entries.size, 8):
                    clipped_totals(entries, k, four, clip, totals)
                for block in range(4):
                    parts[texture + scheme.order[block]] = scheme.texture * total_of_eight(totals, 8 * block)
            if blocks >= 0:
                for block in range(4):
                    for k in range(n):
                        entry = undirected[k] * four[block]
                        parts[blocks + block * n + k] = clip if entry > clip else entry
                for k in range(blocks + 4 * n, channels):
                    parts[k] = 0
            copy(parts, 0, channels, found, to)
            to += channels


@compiled
def four_block_norm(images: Any, scheme: Any, start: int, stop: int, found: Any) -> None:
    """Histograms of images ``start`` to ``stop`` to their descriptors."""
    _, rows, cols, bins = images.shape
    for image in range(start, stop):
        _describe(images[image].reshape(-1), rows, cols, bins, found.shape[3], scheme, found[image].reshape(-1))


@inlined
def _to_energy(to_factors: Any, factors: Any, scheme: Any, found: Any) -> None:
    """What reaches the energies of cells (rows, cols) from the factors (rows + 1, cols + 1) of their blocks."""
    rows, cols = found.shape
    half = found.dtype.type(0.5)
    largest = scheme.epsilon / scheme.epsilon / scheme.epsilon
    found[:] = 0
    for y in range(rows + 1):
        up, down = max(y - 1, 0), min(y, rows - 1)
        for x in range(cols + 1):
            left, right = max(x - 1, 0), min(x, cols - 1)
            factor = factors[y, x]
            reached = -half * to_factors[y, x] * factor * factor * factor
            if scheme.floor and factor >= largest:  # at the floor
                reached *= 0
            found[up, left] += reached
            found[up, right] += reached
            found[down, left] += reached
            found[down, right] += reached


@inlined
def _to_both(given: Any, by: Any, signed: bool, n: int, at: int, found: Any) -> None:
    """Adds ``by`` times what reaches a contrast-insensitive histogram to that of the cell at ``found[at:]``."""
    first, opposite = np.uintp(at), np.uintp(at + n)
    for k in range(n):
        found[first + np.uintp(k)] += by * given[k]
    if signed:
        for k in range(n):
            found[opposite + np.uintp(k)] += by * given[k]


@inlined
def _halves(given: Any, at: int, count: int, found: Any) -> None:
    half = found.dtype.type(0.5)
    first = np.uintp(at)
    for k in range(count):
        found[k] = half * given[first + np.uintp(k)]


@compiled
def _describe_vjp(
    histograms: Any, rows: int, cols: int, bins: int, channels: int, scheme: Any, given: Any, found: Any
) -> None:
    """What reaches the histograms of one image, in one line, from ``given`` of the descriptor."""
    real, drop, clip = histograms.dtype, scheme.dropped, scheme.clip
    one = real.type(1)
    n = bins // 2 if scheme.signed else bins
    cell, undirected = np.zeros(_padded(bins), real), np.zeros(_padded(n), real)
    to_cell, to_undirected = np.zeros(cell.size, real), np.zeros(undirected.size, real)
    of_cell, of_undirected = np.zeros(cell.size, real), np.zeros(4 * undirected.size, real)
    four, factors = np.empty(4, real), np.empty((rows + 1, cols + 1), real)
    to_factors, to_energy = np.zeros((rows + 1, cols + 1), real), np.empty((rows, cols), real)
    of_texture, nothing, totals = np.zeros(4, real), np.zeros(4, real), np.zeros(32, real)
    of_directed, of_folded = (of_texture, nothing) if scheme.directed_texture else (nothing, of_texture)
    _factors(histograms, rows, cols, bins, scheme, factors)
    directed, folded, texture, blocks, _ = scheme.first
    by_cell = directed >= 0 or (texture >= 0 and scheme.directed_texture)
    size = undirected.size
    found[:] = 0
    reached = 0
    for y in range(drop, rows - drop):
        for x in range(drop, cols - drop):
            begin = (y * cols + x) * bins
            _of_cell(factors, y, x, four)
            totals[:] = 0
            if texture >= 0:
                for block in range(4):
                    of_texture[block] = scheme.texture * given[reached + texture + scheme.order[block]]
            if by_cell:
                copy(histograms, begin, bins, cell, 0)
                if directed >= 0:
                    _halves(given, reached + directed, bins, of_cell)
                to_cell[:] = 0
                for k in range(0, cell.size, 8):
                    clipped_vjp(cell, k, four, clip, of_cell, 0, of_directed, totals, to_cell)
                copy(to_cell, 0, bins, found, begin)
            _undirected(histograms, begin, scheme.signed, n, undirected)
            to_undirected[:] = 0
            if folded >= 0:
                _halves(given, reached + folded, n, of_undirected)
            elif blocks >= 0:
                of_undirected[:n] = 0
            if blocks >= 0:
                for block in range(3, -1, -1):
                    for k in range(n):
                        by_block = given[reached + blocks + block * n + k]
                        of_undirected[block * size + k] = of_undirected[k] + by_block
            for k in range(0, size, 8):
                step = size if blocks >= 0 else 0
                clipped_vjp(undirected, k, four, clip, of_undirected, step, of_folded, totals, to_undirected)
            _to_both(to_undirected, one, scheme.signed, n, begin, found)
            to_factors[y, x] += total_of_eight(totals, 0)
            to_factors[y, x + 1] += total_of_eight(totals, 8)
            to_factors[y + 1, x] += total_of_eight(totals, 16)
            to_factors[y + 1, x + 1] += total_of_eight(totals, 24)
            reached += channels
    _to_energy(to_factors, factors, scheme, to_energy)
    for y in range(rows):
        for x in range(cols):
            begin = (y * cols + x) * bins
            _undirected(histograms, begin, scheme.signed, n, undirected)
            _to_both(undirected, to_energy[y, x] + to_energy[y, x], scheme.signed, n, begin, found)


@compiled
def four_block_norm_vjp(images: Any, scheme: Any, given: Any, start: int, stop: int, found: Any) -> None:
    """The adjoint, of images ``start`` to ``stop``."""
    _, rows, cols, bins = images.shape
    for image in range(start, stop):
        of_image, reached, to = images[image].reshape(-1), given[image].reshape(-1), found[image].reshape(-1)
        _describe_vjp(of_image, rows, cols, bins, given.shape[3], scheme, reached, to)
