"""A grid of OpenCV's normalised blocks, compiled: the descriptor of any window is some of them, one after the other."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch

from ...hog import BlockNorm, HOGSpec
from ...hog.pooling import pooling_matrices
from ...hog.poolings import BlockCells
from ...runtime.arrays import Floats
from ...runtime.compile import borrowing, compiled, inlined
from ...runtime.lanes import Array, Builder, Variable
from ...runtime.simd import PADDING, lanes, vector_function, vector_instruction
from .votes import Angles, Region, Row, new_row, read_row, votes_of_row

if TYPE_CHECKING:
    from llvmlite import ir


class Blocks(NamedTuple):
    """What the loops need to know of blocks.  Histograms are padded to ``line`` numbers, whole vectors."""

    width: int  # of a block, pixels
    height: int
    across: int  # pixels from block to block
    down: int
    cols: int  # of cells in a block
    rows: int
    pairs: int  # of columns of cells
    by_col: Floats  # (pairs · 2 · width,): weights of a block's columns of pixels in its columns of cells
    by_row: Floats  # (rows · height,): the same of rows
    bins: int
    line: int
    epsilon: np.float32
    epsilon_again: np.float32
    clip: np.float32


def blocks(spec: HOGSpec) -> Blocks:
    """Of a dialect of :func:`nablahog.presets.opencv`."""
    assert isinstance(spec.pooling, BlockCells)
    assert isinstance(spec.normalizer, BlockNorm)
    (height, width), (down, across), norm = spec.pooling.block, spec.pooling.step, spec.normalizer
    by_row, by_col = (each.numpy() for each in pooling_matrices(spec, height, width, torch.empty(0)))
    pairs = -(-len(by_col) // 2)
    padded = np.zeros((2 * pairs, width), np.float32)
    padded[: len(by_col)] = by_col
    return Blocks(
        width,
        height,
        across,
        down,
        cols=len(by_col),
        rows=len(by_row),
        pairs=pairs,
        by_col=padded.reshape(-1),
        by_row=np.ascontiguousarray(by_row, np.float32).reshape(-1),
        bins=spec.bins,
        line=-(-spec.bins // PADDING) * PADDING,
        epsilon=np.float32(norm.epsilon),
        epsilon_again=np.float32(norm.epsilon_again),
        clip=np.float32(norm.clip),
    )


@vector_instruction
def _pool_columns(
    write: Builder,
    histograms: Array,
    at: ir.Value,
    line: ir.Value,
    weights: Array,
    first: ir.Value,
    pixels: ir.Value,
    out: Array,
    to: ir.Value,
) -> None:
    """Sums of lines, one a pixel from ``at`` on, with the weights of two columns of cells; two lines of ``out``."""
    count = lanes(out.itemsize)
    with write.loop(line, count) as k:
        left, right = (Variable(write.constant(out.vector(count), 0.0)) for _ in range(2))
        with write.loop(pixels) as x:
            values = histograms.load(write.add(at, k, write.multiply(x, line)), count)
            for each, begin in ((left, first), (right, write.add(first, pixels))):
                each.set(values.multiply_add(weights.splat(write.add(begin, x), count), each.get()))
        out.store(write.add(to, k), left.get())
        out.store(write.add(to, k, line), right.get())


@vector_function
def _energy(write: Builder, values: Array, factor: ir.Value, clip: ir.Value) -> ir.Value:
    """Σ min(factor · v, clip)²; ``values`` are replaced by what is squared."""
    count = lanes(values.itemsize)
    scale, most = write.splat(factor, count), write.splat(clip, count)
    total = Variable(write.constant(values.vector(count), 0.0))
    with write.loop(values.size, count) as k:
        value = values.load(k, count) * scale
        value = value.compare("<", most).where(value, most)
        values.store(k, value)
        total.set(value.multiply_add(value, total.get()))
    return total.get().sum()


@inlined
def _spread(row: Row, blocks: Blocks, histograms: Floats) -> None:
    """Writes the votes of each pixel to a line of zeros, one number a bin."""
    line, last = np.uintp(blocks.line), np.int32(blocks.bins - 1)
    for k in range(row.near.size):
        x = np.uintp(k)
        bin_ = row.bins[x]
        after = np.int32(0) if bin_ == last else bin_ + np.int32(1)
        histograms[x * line + np.uintp(bin_)] = row.near[x]
        histograms[x * line + np.uintp(after)] = row.far[x]


@inlined
def _clear(row: Row, blocks: Blocks, histograms: Floats) -> None:
    """Makes all lines zeros again."""
    line, last, zero = np.uintp(blocks.line), np.int32(blocks.bins - 1), np.float32(0)
    for k in range(row.near.size):
        x = np.uintp(k)
        bin_ = row.bins[x]
        after = np.int32(0) if bin_ == last else bin_ + np.int32(1)
        histograms[x * line + np.uintp(bin_)] = zero
        histograms[x * line + np.uintp(after)] = zero


@inlined
def _add(values: Floats, weight: np.float32, sums: Floats, to: int) -> None:
    begin = np.uintp(to)
    for k in range(values.size):
        x = np.uintp(k)
        sums[begin + x] += weight * values[x]


@borrowing
def _normalize(sums: Floats, at: int, row_size: int, blocks: Blocks, work: Floats, out: Floats, to: int) -> None:
    """L2-Hys of one block, whose rows of cells are ``row_size`` apart: column by column of cells to ``out[to:]``."""
    line, one = blocks.line, np.float32(1)
    for col in range(blocks.cols):
        for row in range(blocks.rows):
            begin, end = at + row * row_size + col * line, (col * blocks.rows + row) * line
            for k in range(line):
                work[np.uintp(end) + np.uintp(k)] = sums[np.uintp(begin) + np.uintp(k)]
    energy = _energy(work, one, np.float32(np.inf))
    energy = _energy(work, one / (math.sqrt(energy) + blocks.epsilon), blocks.clip)
    factor = one / (math.sqrt(energy) + blocks.epsilon_again)
    for cell in range(blocks.cols * blocks.rows):
        for k in range(blocks.bins):
            out[np.uintp(to + cell * blocks.bins) + np.uintp(k)] = factor * work[np.uintp(cell * line) + np.uintp(k)]


@compiled
def block_grid(region: Region, angles: Angles, blocks: Blocks, out: Floats) -> None:
    """All blocks of a region, to ``out`` (columns, rows, numbers of a block).

    Votes go to the histograms of columns of cells, row by row of pixels; these are added up for the rows of blocks that
    the row of pixels is in, which lie in a ring.
    """
    cols, rows, size = out.shape
    flat = out.reshape(-1)
    width, height = region.pixel_of.size - 2, region.row_of.size - 2
    row = new_row(width, region.channels)
    histograms = np.zeros((width + 1) * blocks.line, np.float32)
    of_columns = np.zeros(cols * blocks.pairs * 2 * blocks.line, np.float32)
    ring = -(-blocks.height // blocks.down)
    sums = np.zeros(ring * blocks.rows * of_columns.size, np.float32)
    work = np.zeros(blocks.cols * blocks.rows * blocks.line, np.float32)
    read_row(region, -1, angles.values, row)
    read_row(region, 0, angles.values, row)
    for y in range(height):
        read_row(region, y + 1, angles.values, row)
        votes_of_row(region, y, angles, row)
        _spread(row, blocks, histograms)
        for col in range(cols):
            for pair in range(blocks.pairs):
                to, first = (col * blocks.pairs + pair) * 2 * blocks.line, pair * 2 * blocks.width
                at = col * blocks.across * blocks.line
                _pool_columns(histograms, at, blocks.line, blocks.by_col, first, blocks.width, of_columns, to)
        _clear(row, blocks, histograms)
        for k in range(max(0, (y - blocks.height) // blocks.down + 1), min(y // blocks.down + 1, rows)):
            inside = y - k * blocks.down
            if inside >= blocks.height:
                continue
            begin = k % ring * blocks.rows * of_columns.size
            for cell in range(blocks.rows):
                weight = blocks.by_row[cell * blocks.height + inside]
                if weight > 0:
                    _add(of_columns, weight, sums, begin + cell * of_columns.size)
            if inside == blocks.height - 1:
                for col in range(cols):
                    at = begin + col * blocks.pairs * 2 * blocks.line
                    _normalize(sums, at, of_columns.size, blocks, work, flat, (col * rows + k) * size)
                for x in range(begin, begin + blocks.rows * of_columns.size):
                    sums[np.uintp(x)] = np.float32(0)
