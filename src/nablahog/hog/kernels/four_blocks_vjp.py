"""The vjp of the four-block normaliser, compiled: a cell at a time; see :mod:`.four_blocks`."""

from __future__ import annotations

import numpy as np

from ...runtime.arrays import Floats, Real
from ...runtime.compile import compiled, inlined
from .four_blocks import FourBlocks, Work, block_factors, factors_of_cell, fold, new_work
from .norms import copy


@inlined
def _through_clip(value: Real, factor: Real, clip: Real, grad: Real, half: Real) -> Real:
    """The gradient before the clip; at the clip itself the mean of both sides."""
    entry = value * factor
    passed = grad * half if entry == clip else grad
    return passed - passed if entry > clip else passed


@inlined
def _entries_vjp(
    entries: Floats, at: int, count: int, clip: Real, stride: int, by_texture: bool, work: Work, out: Floats
) -> None:
    """Gradients of the clipped entries of four blocks: to ``out``, of the histogram, and added to ``grad_of_cell``.

    They are those of ``grad_entries``, ``stride`` from block to block, and of texture sums ``by_texture``.
    """
    four, grad, total = work.of_cell, work.grad_entries, work.grad_of_cell
    zero, half = clip - clip, grad.dtype.type(0.5)
    a, b, c, d = total[0], total[1], total[2], total[3]
    f, g, h, i = four[0], four[1], four[2], four[3]
    t, u, v, w = zero, zero, zero, zero
    if by_texture:
        t, u, v, w = work.grad_texture[0], work.grad_texture[1], work.grad_texture[2], work.grad_texture[3]
    for k in range(count):
        x = np.uintp(k)
        value = entries[np.uintp(at) + x]
        p = _through_clip(value, f, clip, grad[x] + t, half)
        q = _through_clip(value, g, clip, grad[np.uintp(stride) + x] + u, half)
        r = _through_clip(value, h, clip, grad[np.uintp(2 * stride) + x] + v, half)
        s = _through_clip(value, i, clip, grad[np.uintp(3 * stride) + x] + w, half)
        out[x] = (p * f + q * g) + (r * h + s * i)
        a, b, c, d = a + p * value, b + q * value, c + r * value, d + s * value
    total[0], total[1], total[2], total[3] = a, b, c, d


@inlined
def _add_folded(grad: Floats, factor: Real, scheme: FourBlocks, out: Floats, to: int) -> None:
    """The vjp of :func:`fold`, times ``factor``, added to the cell at ``out[to:]``."""
    first, opposite = np.uintp(to), np.uintp(to + scheme.undirected)
    for k in range(scheme.undirected):
        out[first + np.uintp(k)] += factor * grad[k]
    if scheme.signed:
        for k in range(scheme.undirected):
            out[opposite + np.uintp(k)] += factor * grad[k]


@inlined
def _halves(grad: Floats, at: int, count: int, out: Floats) -> None:
    half = out.dtype.type(0.5)
    for k in range(count):
        out[k] = half * grad[np.uintp(at) + np.uintp(k)]


@inlined
def _cell_vjp(
    histograms: Floats, at: int, scheme: FourBlocks, work: Work, grad: Floats, begin: int, out: Floats
) -> None:
    """Gradients of one cell's channels, ``grad[begin:]``: to its histogram, ``out[at:]``, and ``work.grad_of_cell``."""
    directed, undirected, texture, blocks, _ = scheme.first
    n, one = scheme.undirected, scheme.epsilon / scheme.epsilon
    work.grad_of_cell[:] = 0
    if texture >= 0:
        for block in range(4):
            work.grad_texture[block] = scheme.texture * grad[begin + texture + scheme.order[block]]
    by_directed = texture >= 0 and scheme.directed_texture
    if directed >= 0 or by_directed:
        work.grad_entries[: scheme.bins] = 0
        if directed >= 0:
            _halves(grad, begin + directed, scheme.bins, work.grad_entries)
        _entries_vjp(histograms, at, scheme.bins, scheme.clip, 0, by_directed, work, work.grad_histogram)
        copy(work.grad_histogram, 0, scheme.bins, out, at)
    fold(histograms, at, scheme, work.undirected)
    work.grad_entries[:n] = 0
    if undirected >= 0:
        _halves(grad, begin + undirected, n, work.grad_entries)
    if blocks >= 0:
        entries = work.grad_entries
        for block in range(3, -1, -1):
            for k in range(n):
                entries[block * n + k] = entries[k] + grad[begin + blocks + block * n + k]
    by_undirected = texture >= 0 and not scheme.directed_texture
    stride = n if blocks >= 0 else 0
    _entries_vjp(work.undirected, 0, n, scheme.clip, stride, by_undirected, work, work.grad_histogram)
    _add_folded(work.grad_histogram, one, scheme, out, at)


@inlined
def _factors_vjp(scheme: FourBlocks, work: Work) -> None:
    """From gradients of the blocks' factors to those of the energies of cells, ``work.energy``."""
    energy = work.energy
    rows, cols = energy.shape
    half, factors, grad_factors = energy.dtype.type(0.5), work.factors, work.grad_factors
    largest = scheme.epsilon / scheme.epsilon / scheme.epsilon
    energy[:] = 0
    for y in range(rows + 1):
        up, down = max(y - 1, 0), min(y, rows - 1)
        for x in range(cols + 1):
            left, right = max(x - 1, 0), min(x, cols - 1)
            factor = factors[y, x]
            grad = -half * grad_factors[y, x] * factor * factor * factor
            if scheme.floor and factor >= largest:  # at the floor
                grad *= 0
            energy[up, left] += grad
            energy[up, right] += grad
            energy[down, left] += grad
            energy[down, right] += grad


@inlined
def _describe_vjp(histograms: Floats, channels: int, scheme: FourBlocks, work: Work, grad: Floats, out: Floats) -> None:
    """Gradients of one image's descriptor, in one line, to those of its histograms."""
    rows, cols = work.energy.shape
    drop, bins, total, begin = scheme.dropped, scheme.bins, work.grad_of_cell, 0
    to_factors = work.grad_factors
    block_factors(histograms, scheme, work)
    work.grad_factors[:] = 0
    out[:] = 0
    for y in range(drop, rows - drop):
        for x in range(drop, cols - drop):
            factors_of_cell(work.factors, y, x, work.of_cell)
            _cell_vjp(histograms, (y * cols + x) * bins, scheme, work, grad, begin, out)
            to_factors[y, x] += total[0]
            to_factors[y, x + 1] += total[1]
            to_factors[y + 1, x] += total[2]
            to_factors[y + 1, x + 1] += total[3]
            begin += channels
    _factors_vjp(scheme, work)
    for y in range(rows):
        for x in range(cols):
            at = (y * cols + x) * bins
            fold(histograms, at, scheme, work.undirected)
            _add_folded(work.undirected, work.energy[y, x] + work.energy[y, x], scheme, out, at)


@compiled
def four_block_norm_vjp(
    images: Floats, scheme: FourBlocks, grad_output: Floats, start: int, stop: int, grad_input: Floats
) -> None:
    """Gradients of descriptors of images ``start`` to ``stop`` to those of their histograms."""
    _, rows, cols, bins = images.shape
    work = new_work(rows, cols, bins, images.dtype)
    for image in range(start, stop):
        histograms, grad = images[image].reshape(-1), grad_output[image].reshape(-1)
        _describe_vjp(histograms, grad_output.shape[3], scheme, work, grad, grad_input[image].reshape(-1))
