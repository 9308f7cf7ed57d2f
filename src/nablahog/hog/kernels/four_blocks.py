"""The four-block normaliser compiled: a cell at a time, and its adjoint.

Histograms are (rows, cols, bins) of one image, descriptors (rows, cols, channels).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ...compile import compiled
from ..normalize import DPM_ORDER, DPM_TEXTURE, VLFEAT_TEXTURE
from ..normalizers import PARTS, FourBlockNorm


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
    channels = [scheme.channels_of(part, bins if signed else 2 * bins) for part in PARTS]
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


@compiled
def _undirected(cell: Any, signed: bool, found: Any) -> None:
    """The contrast-insensitive histogram of a cell (bins,)."""
    for k in range(found.size):
        found[k] = cell[k] + cell[k + found.size] if signed else cell[k]


@compiled
def _factors(histograms: Any, scheme: Any, undirected: Any, factors: Any) -> None:
    """What blocks multiply their cells with: (rows + 1, cols + 1), of the cell corners."""
    rows, cols, _ = histograms.shape
    energy = np.empty((rows, cols), histograms.dtype)
    for y in range(rows):
        for x in range(cols):
            _undirected(histograms[y, x], scheme.signed, undirected)
            total = scheme.epsilon - scheme.epsilon
            for k in range(undirected.size):
                total += undirected[k] * undirected[k]
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


@compiled
def _sums(entries: Any, four: Any, clip: Any, half: Any, found: Any) -> None:
    """Half the sum over the blocks of clipped entries."""
    a, b, c, d = four[0], four[1], four[2], four[3]
    for k in range(entries.size):
        entry = entries[k]
        p, q, r, s = entry * a, entry * b, entry * c, entry * d
        p = clip if p > clip else p
        q = clip if q > clip else q
        r = clip if r > clip else r
        s = clip if s > clip else s
        found[k] = half * ((p + q) + (r + s))


@compiled
def _clipped_total(entries: Any, factor: Any, clip: Any) -> Any:
    total = clip - clip
    for k in range(entries.size):
        entry = entries[k] * factor
        total += clip if entry > clip else entry
    return total


@compiled
def _describe(histograms: Any, scheme: Any, found: Any) -> None:
    """Histograms of one image to their descriptor."""
    rows, cols, bins = histograms.shape
    real = histograms.dtype.type
    undirected = np.empty(bins // 2 if scheme.signed else bins, histograms.dtype)
    factors, four = np.empty((rows + 1, cols + 1), histograms.dtype), np.empty(4, histograms.dtype)
    _factors(histograms, scheme, undirected, factors)
    directed, folded, texture, blocks, zero = scheme.first
    n, drop, half = undirected.size, scheme.dropped, real(0.5)
    for y in range(drop, rows - drop):
        for x in range(drop, cols - drop):
            cell, to = histograms[y, x], found[y - drop, x - drop]
            _undirected(cell, scheme.signed, undirected)
            for block in range(4):
                four[block] = factors[y + block // 2, x + block % 2]
            if directed >= 0:
                _sums(cell, four, scheme.clip, half, to[directed : directed + bins])
            if folded >= 0:
                _sums(undirected, four, scheme.clip, half, to[folded : folded + n])
            for block in range(4):
                if texture >= 0:
                    entries = cell if scheme.directed_texture else undirected
                    total = _clipped_total(entries, four[block], scheme.clip)
                    to[texture + scheme.order[block]] = scheme.texture * total
                if blocks >= 0:
                    for k in range(n):
                        entry = undirected[k] * four[block]
                        to[blocks + block * n + k] = scheme.clip if entry > scheme.clip else entry
            if zero >= 0:
                to[zero] = 0


@compiled
def four_block_norm(histograms: Any, scheme: Any, start: int, stop: int, found: Any) -> None:
    """Histograms of images ``start`` to ``stop`` to their descriptors."""
    for image in range(start, stop):
        _describe(histograms[image], scheme, found[image])


@compiled
def _add_adjoint(entries: Any, factor: Any, clip: Any, share: Any, each: Any, given: Any, found: Any) -> Any:
    """Adds what reaches the entries of a block, given ``share`` · ``given`` + ``each`` of them; returns the factor's.

    At the clip itself, the mean of both sides.
    """
    half = entries.dtype.type(0.5)
    zero = half - half
    total = zero
    for k in range(entries.size):
        entry = entries[k] * factor
        reached = share * given[k] + each
        reached = zero if entry > clip else half * reached if entry == clip else reached
        found[k] += reached * factor
        total += reached * entries[k]
    return total


@compiled
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


@compiled
def _describe_adjoint(histograms: Any, scheme: Any, given: Any, found: Any) -> None:
    """What reaches the histograms of one image, ``found``, from ``given`` of the descriptor."""
    rows, cols, bins = histograms.shape
    real = histograms.dtype.type
    n = bins // 2 if scheme.signed else bins
    undirected, to_undirected = np.empty(n, histograms.dtype), np.empty(n, histograms.dtype)
    factors, to_factors = (
        np.empty((rows + 1, cols + 1), histograms.dtype),
        np.zeros((rows + 1, cols + 1), histograms.dtype),
    )
    to_energy = np.empty((rows, cols), histograms.dtype)
    _factors(histograms, scheme, undirected, factors)
    directed, folded, texture, blocks, _ = scheme.first
    drop, half, one, zero, clip = scheme.dropped, real(0.5), real(1), real(0), scheme.clip
    found[:] = 0
    nothing = np.zeros(bins, histograms.dtype)
    for y in range(drop, rows - drop):
        for x in range(drop, cols - drop):
            cell, to, reached = histograms[y, x], found[y, x], given[y - drop, x - drop]
            _undirected(cell, scheme.signed, undirected)
            to_undirected[:] = 0
            for block in range(4):
                row, col = y + block // 2, x + block % 2
                factor = factors[row, col]
                each = scheme.texture * reached[texture + scheme.order[block]] if texture >= 0 else zero
                of_directed = each if scheme.directed_texture else zero
                total = zero
                if directed >= 0:
                    total += _add_adjoint(
                        cell, factor, clip, half, of_directed, reached[directed : directed + bins], to
                    )
                elif of_directed != zero:
                    total += _add_adjoint(cell, factor, clip, zero, of_directed, nothing, to)
                of_folded = zero if scheme.directed_texture else each
                if folded >= 0:
                    part = reached[folded : folded + n]
                    total += _add_adjoint(undirected, factor, clip, half, of_folded, part, to_undirected)
                elif of_folded != zero:
                    total += _add_adjoint(undirected, factor, clip, zero, of_folded, nothing[:n], to_undirected)
                if blocks >= 0:
                    part = reached[blocks + block * n : blocks + (block + 1) * n]
                    total += _add_adjoint(undirected, factor, clip, one, zero, part, to_undirected)
                to_factors[row, col] += total
            for k in range(n):
                to[k] += to_undirected[k]
                if scheme.signed:
                    to[k + n] += to_undirected[k]
    _to_energy(to_factors, factors, scheme, to_energy)
    for y in range(rows):
        for x in range(cols):
            cell, to = histograms[y, x], found[y, x]
            _undirected(cell, scheme.signed, undirected)
            for k in range(n):
                reached_by = real(2) * undirected[k] * to_energy[y, x]
                to[k] += reached_by
                if scheme.signed:
                    to[k + n] += reached_by


@compiled
def four_block_adjoint(histograms: Any, scheme: Any, given: Any, start: int, stop: int, found: Any) -> None:
    """The adjoint, of images ``start`` to ``stop``."""
    for image in range(start, stop):
        _describe_adjoint(histograms[image], scheme, given[image], found[image])
