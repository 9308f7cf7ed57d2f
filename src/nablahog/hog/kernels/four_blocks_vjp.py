"""The vjp of the four-block normaliser, compiled: a cell at a time; see :mod:`.four_blocks`."""

from __future__ import annotations

from ...runtime.arrays import Floats, Real
from ...runtime.compile import compiled, inlined
from .four_blocks import FourBlocks, Work, block_factors, factors_of_cell, fold, new_work
from .norm_simd import Corners, add_scaled, clipped_vjp, copy, read_line
from .norms import whole_eights


@inlined
def _add_folded(grad: Floats, factor: Real, scheme: FourBlocks, out: Floats, to: int) -> None:
    """The vjp of :func:`fold`, times ``factor``, added to the cell at ``out[to:]``."""
    add_scaled(grad, 0, scheme.undirected, out, to, factor)
    if scheme.signed:
        add_scaled(grad, 0, scheme.undirected, out, to + scheme.undirected, factor)


@inlined
def _add_blocks(grad: Floats, begin: int, n: int, entries: Floats) -> None:
    """Gradients of ``n`` entries of each block, added to half the first line of ``entries``: one line each."""
    line, half = whole_eights(n), entries.dtype.type(0.5)
    for block in range(3, -1, -1):
        for k in range(n):
            entries[block * line + k] = half * entries[k] + grad[begin + block * n + k]


@inlined
def _grad_totals(grad: Floats, begin: int, scheme: FourBlocks, wanted: bool) -> Corners:
    """Gradients of the sum over the bins of each block, of those of the texture at ``grad[begin:]``; zeros if not."""
    by, order = scheme.texture, scheme.order
    if not wanted:
        zero = by - by
        return Corners(zero, zero, zero, zero)
    a, b, c, d = grad[begin + order[0]], grad[begin + order[1]], grad[begin + order[2]], grad[begin + order[3]]
    return Corners(by * a, by * b, by * c, by * d)


@inlined
def _directed_vjp(
    histograms: Floats, at: int, scheme: FourBlocks, four: Corners, work: Work, grad: Floats, begin: int, out: Floats
) -> None:
    """Gradients of the channels that the histogram itself has, to ``out[at:]``."""
    directed, _, texture, _, _ = scheme.first
    entries, half, bins = work.entries, grad.dtype.type(0.5), scheme.bins
    totals = _grad_totals(grad, begin + texture, scheme, texture >= 0 and scheme.directed_texture)
    if directed >= 0:
        read_line(grad, begin + directed, 0, bins, entries, 0)
    else:
        entries[:] = 0
    read_line(histograms, at, 0, bins, work.histogram, 0)
    clipped_vjp(work.histogram, four, scheme.clip, entries, 0, half, totals, work.totals, work.grad)
    copy(work.grad, 0, bins, out, at)


@inlined
def _undirected_vjp(
    histograms: Floats, at: int, scheme: FourBlocks, four: Corners, work: Work, grad: Floats, begin: int, out: Floats
) -> None:
    """Gradients of the channels of the contrast-insensitive histogram, added to ``out[at:]``."""
    _, undirected, texture, blocks, _ = scheme.first
    entries, one, n = work.entries, grad.dtype.type(1), scheme.undirected
    totals = _grad_totals(grad, begin + texture, scheme, texture >= 0 and not scheme.directed_texture)
    if undirected >= 0:
        read_line(grad, begin + undirected, 0, n, entries, 0)
    else:
        entries[:] = 0
    stride, factor = 0, grad.dtype.type(0.5)
    if blocks >= 0:
        _add_blocks(grad, begin + blocks, n, entries)
        stride, factor = whole_eights(n), one
    fold(histograms, at, scheme, work.undirected)
    clipped_vjp(work.undirected, four, scheme.clip, entries, stride, factor, totals, work.totals, work.grad)
    _add_folded(work.grad, one, scheme, out, at)


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
    drop, bins, begin = scheme.dropped, scheme.bins, 0
    factors, grad_factors, totals, undirected = work.factors, work.grad_factors, work.totals, work.undirected
    by_directed = scheme.first[0] >= 0 or (scheme.first[2] >= 0 and scheme.directed_texture)
    block_factors(histograms, scheme, work)
    grad_factors[:] = 0
    out[:] = 0
    for y in range(drop, rows - drop):
        for x in range(drop, cols - drop):
            four, at = factors_of_cell(factors, y, x), (y * cols + x) * bins
            totals[:] = 0
            if by_directed:
                _directed_vjp(histograms, at, scheme, four, work, grad, begin, out)
            _undirected_vjp(histograms, at, scheme, four, work, grad, begin, out)
            grad_factors[y, x] += totals[0]
            grad_factors[y, x + 1] += totals[1]
            grad_factors[y + 1, x] += totals[2]
            grad_factors[y + 1, x + 1] += totals[3]
            begin += channels
    _factors_vjp(scheme, work)
    for y in range(rows):
        for x in range(cols):
            at = (y * cols + x) * bins
            fold(histograms, at, scheme, undirected)
            _add_folded(undirected, work.energy[y, x] + work.energy[y, x], scheme, out, at)


@compiled
def four_block_norm_vjp(
    images: Floats, scheme: FourBlocks, grad_output: Floats, start: int, stop: int, grad_input: Floats
) -> None:
    """Gradients of descriptors of images ``start`` to ``stop`` to those of their histograms."""
    _, rows, cols, _ = images.shape
    work = new_work(rows, cols, grad_output.shape[3], scheme, images.dtype)
    for image in range(start, stop):
        histograms, grad = images[image].reshape(-1), grad_output[image].reshape(-1)
        _describe_vjp(histograms, grad_output.shape[3], scheme, work, grad, grad_input[image].reshape(-1))
