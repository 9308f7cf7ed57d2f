"""Normalisers in vector instructions, eight numbers at a time.

LLVM's own vector loops begin at 32 numbers; few histograms and blocks have as many.  A *line* is an array of whole
eights: a short vector with zeros behind.

Gains of a call of `hog` over plain Numba loops in the place of these instructions (one image of 256 x 256, AMD EPYC,
AVX2, float32): block normaliser 1.11 (`skimage`), 1.08 (`opencv`), its vjp 1.05 (`opencv`); four blocks 1.02, their vjp
1.14 (`uoctti`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

from ...runtime.arrays import Real
from ...runtime.lanes import Array, Builder, Index, Lanes, Variable
from ...runtime.simd import vector_function, vector_instruction

if TYPE_CHECKING:
    from llvmlite import ir


def _in_pieces(write: Builder, count: ir.Value, piece: Callable[[Index, int], None], overlap: bool) -> None:
    """Calls ``piece`` for ``count`` numbers, with an index and a number of lanes: eights, then single ones.

    If they may ``overlap``, the last of eight or more are an eight, too.
    """
    whole = write.builder.and_(count, write.index(-8))
    with write.loop(whole, 8) as k:
        piece(k, 8)
    if overlap:
        with write.builder.if_else(write.builder.icmp_signed("<", count, write.index(8))) as (short, long):
            with short, write.loop(count) as k:
                piece(k, 1)
            with long:
                piece(write.subtract(count, 8), 8)
        return
    with write.loop(write.subtract(count, whole)) as k:
        piece(write.add(whole, k), 1)


def _moves(scale: bool, more: bool) -> Callable[..., None]:
    """An instruction: copies ``count`` numbers ``source[begin:]`` to ``out[to:]``, or if ``more`` adds them.

    If it is to ``scale`` them, it takes a factor after the others.
    """

    @vector_instruction
    def move(
        write: Builder, source: Array, begin: ir.Value, count: ir.Value, out: Array, to: ir.Value, *factor: ir.Value
    ) -> None:
        def piece(k: Index, n: int) -> None:
            values, place = source.load(write.add(begin, k), n), write.add(to, k)
            if scale:
                values = values * write.splat(factor[0], n)
            out.store(place, out.load(place, n) + values if more else values)

        _in_pieces(write, count, piece, not more)

    return move


copy, copy_scaled, add, add_scaled = _moves(False, False), _moves(True, False), _moves(False, True), _moves(True, True)


def _in_eights(
    write: Builder, count: ir.Value, eight: Callable[[ir.Value, Callable[[Array, Index], Lanes]], None]
) -> None:
    """Calls ``eight`` with each index, and a function that loads numbers of an array, zeros beyond ``count``."""
    whole = write.builder.and_(count, write.index(-8))
    with write.loop(whole, 8) as k:
        eight(k, lambda of, at: of.load(at, 8))
    with write.if_less(whole, count):
        mask = write.first_lanes(write.subtract(count, whole), 8)
        eight(whole, lambda of, at: of.load_masked(at, mask))


def _reads(stretches: int) -> Callable[..., None]:
    """An instruction: the sum of so many stretches of ``count`` numbers, to the line at ``out[to:]``.

    The first begins at ``source[begin:]``, the second ``step`` further.
    """

    @vector_instruction
    def read(
        write: Builder, source: Array, begin: ir.Value, step: ir.Value, count: ir.Value, out: Array, to: ir.Value
    ) -> None:
        def eight(k: ir.Value, load: Callable[[Array, Index], Lanes]) -> None:
            places = [write.add(begin, write.multiply(step, number), k) for number in range(stretches)]
            total, *others = (load(source, place) for place in places)
            for other in others:
                total = total + other
            out.store(write.add(to, k), total)

        _in_eights(write, count, eight)

    return read


read_line, read_folded = _reads(1), _reads(2)


@vector_function
def dot(write: Builder, left: Array, at: ir.Value, right: Array, begin: ir.Value, count: ir.Value) -> ir.Value:
    """The dot product of ``count`` numbers."""
    total = Variable(write.constant(left.vector(8), 0.0))

    def eight(k: ir.Value, load: Callable[[Array, Index], Lanes]) -> None:
        total.set(total.get() + load(left, write.add(at, k)) * load(right, write.add(begin, k)))

    _in_eights(write, count, eight)
    return total.get().sum()


def _each_eight(rule: Callable[..., Lanes]) -> Callable[..., None]:
    """An instruction: ``out[to:]`` = ``rule`` of each eight of lines, which come first, and of numbers.

    A NamedTuple of numbers is one argument of the rule.
    """

    @vector_instruction
    def apply(write: Builder, *operands: Array | ir.Value) -> None:
        *inputs, out, to = operands
        with write.loop(inputs[0].size, 8) as k:
            out.store(write.add(to, k), rule(*(_eight(write, each, k) for each in inputs)))

    return apply


def _eight(write: Builder, operand: Array | ir.Value | tuple[ir.Value, ...], at: ir.Value) -> object:
    if isinstance(operand, Array):
        return operand.load(at, 8)
    if isinstance(operand, tuple):
        return [write.splat(each, 8) for each in operand]
    return write.splat(operand, 8)


def _clip(entries: Lanes, clip: Lanes) -> Lanes:
    return entries.compare(">", clip).where(clip, entries)


def _through_clip(entries: Lanes, clip: Lanes, grad: Lanes) -> Lanes:
    """The gradient before the clip; at the clip itself the mean of both sides."""
    passed = entries.compare("==", clip).where(grad * 0.5, grad)
    return entries.compare(">", clip).where(0.0, passed)


@_each_eight
def roots(x: Lanes, factor: Lanes) -> Lanes:
    return (x * factor).sqrt()


@_each_eight
def roots_vjp(x: Lanes, grad: Lanes, factor: Lanes) -> Lanes:
    """Zero at zero."""
    root = (x * factor).sqrt()
    return root.compare(">", 0.0).where(grad * 0.5 / root, 0.0)


@_each_eight
def clipped(x: Lanes, factor: Lanes, clip: Lanes) -> Lanes:
    return _clip(x * factor, clip)


@_each_eight
def clipped_norm_vjp(x: Lanes, grad: Lanes, factor: Lanes, clip: Lanes, by_grad: Lanes, by_clipped: Lanes) -> Lanes:
    """The vjp of :func:`clipped`, where that is normalised again."""
    entries = x * factor
    return _through_clip(entries, clip, grad * by_grad - _clip(entries, clip) * by_clipped)


@_each_eight
def norm_vjp(x: Lanes, grad: Lanes, by_grad: Lanes, by_x: Lanes, less: Lanes) -> Lanes:
    return grad * by_grad - (x * by_x + less)


class Corners(NamedTuple):
    """Numbers of the four blocks around a cell."""

    up_left: Real
    up_right: Real
    down_left: Real
    down_right: Real


@_each_eight
def half_sums(x: Lanes, factors: list[Lanes], clip: Lanes) -> Lanes:
    """Half the sum of the clipped entries in four blocks."""
    a, b, c, d = (_clip(x * factor, clip) for factor in factors)
    return ((a + b) + (c + d)) * 0.5


def _add_sums(write: Builder, sums: list[Variable], out: Array) -> None:
    """Adds the sums of four vectors of eight lanes to four numbers."""
    halves = [each.get() for each in sums]
    fours = [write.shuffle(x, x, [0, 1, 2, 3]) + write.shuffle(x, x, [4, 5, 6, 7]) for x in halves]
    a, b, c, d = write.transpose(fours)
    out.store(0, out.load(0, 4) + ((a + c) + (b + d)))


@vector_instruction
def clipped_totals(write: Builder, x: Array, factors: Corners, clip: ir.Value, out: Array) -> None:
    """Adds the sums of the clipped entries over all bins, of each block, to four numbers, ``out``."""
    limit, by = write.splat(clip, 8), [write.splat(factor, 8) for factor in factors]
    totals = [Variable(limit.like(0.0)) for _ in by]
    with write.loop(x.size, 8) as k:
        values = x.load(k, 8)
        for total, factor in zip(totals, by, strict=True):
            total.set(total.get() + _clip(values * factor, limit))
    _add_sums(write, totals, out)


@vector_instruction
def clipped_vjp(
    write: Builder,
    x: Array,
    factors: Corners,
    clip: ir.Value,
    grad: Array,
    stride: ir.Value,
    by_grad: ir.Value,
    grad_totals: Corners,
    grad_factors: Array,
    out: Array,
) -> None:
    """Gradients of the clipped entries of four blocks: to the line ``out``, and added to four ``grad_factors``.

    They are ``by_grad`` times ``grad``, ``stride`` from block to block, and those of each block's sum, ``grad_totals``.
    """
    limit, by = write.splat(clip, 8), [write.splat(factor, 8) for factor in factors]
    of_all, scale = [write.splat(each, 8) for each in grad_totals], write.splat(by_grad, 8)
    totals = [Variable(limit.like(0.0)) for _ in by]
    with write.loop(x.size, 8) as k:
        values = x.load(k, 8)
        grad_x = limit.like(0.0)
        for block, (factor, of_sum, total) in enumerate(zip(by, of_all, totals, strict=True)):
            of_block = grad.load(write.add(k, write.multiply(stride, block)), 8)
            passed = _through_clip(values * factor, limit, of_block * scale + of_sum)
            grad_x = passed.multiply_add(factor, grad_x)
            total.set(passed.multiply_add(values, total.get()))
        out.store(k, grad_x)
    _add_sums(write, totals, grad_factors)
