"""Eight bins at a time: the instructions of normalisers.  Lines are padded to whole eights with zeros."""

from __future__ import annotations

from typing import Any

from ...compile import instruction


class _Eight:
    """Builds instructions on eight numbers, from the arguments of a call: arrays, where they begin, and more."""

    def __init__(self, context: Any, builder: Any, signature: Any, arguments: Any) -> None:
        from llvmlite import ir

        self.ir, self.context, self.builder = ir, context, builder
        self.signature, self.arguments = signature, arguments
        self.number = context.get_value_type(signature.args[0].dtype)
        self.type = ir.VectorType(self.number, 8)
        self.size = context.get_abi_sizeof(self.number)

    def place(self, which: int, at: Any, type_: Any) -> Any:
        array = self.context.make_array(self.signature.args[which])(self.context, self.builder, self.arguments[which])
        return self.builder.bitcast(self.builder.gep(array.data, [at]), type_.as_pointer())

    def load(self, which: int, at: Any) -> Any:
        return self.builder.load(self.place(which, at, self.type), align=self.size)

    def store(self, which: int, at: Any, value: Any) -> None:
        self.builder.store(value, self.place(which, at, self.type), align=self.size)

    def number_of(self, which: int, index: int) -> Any:
        """One number of an array."""
        return self.builder.load(self.place(which, self.ir.IntType(64)(index), self.number), align=self.size)

    def all(self, number: Any) -> Any:
        """A number eight times."""
        one = self.builder.insert_element(
            self.ir.Constant(self.type, self.ir.Undefined), number, self.ir.IntType(32)(0)
        )
        return self.builder.shuffle_vector(
            one, one, self.ir.Constant(self.ir.VectorType(self.ir.IntType(32), 8), [0] * 8)
        )

    def constant(self, value: float) -> Any:
        return self.ir.Constant(self.type, [value] * 8)

    def clipped(self, entries: Any, clip: Any) -> Any:
        return self.builder.select(self.builder.fcmp_ordered(">", entries, clip), clip, entries)

    def total(self, values: Any) -> Any:
        """Their sum, in pairs of pairs of pairs."""
        for half in (4, 2, 1):
            index = self.ir.VectorType(self.ir.IntType(32), half)
            low, high = (self.ir.Constant(index, list(range(first, first + half))) for first in (0, half))
            values = self.builder.fadd(*(self.builder.shuffle_vector(values, values, ends) for ends in (low, high)))
        return self.builder.extract_element(values, self.ir.IntType(32)(0))


@instruction
def dot_eight(_: Any, left: Any, at: Any, right: Any, beside: Any) -> Any:
    """The sum of eight products, of ``left[at:]`` and ``right[beside:]``."""

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        eight = _Eight(context, builder, signature, arguments)
        return eight.total(builder.fmul(eight.load(0, arguments[1]), eight.load(2, arguments[3])))

    return left.dtype(left, at, right, beside), build


@instruction
def clipped_sums(_: Any, entries: Any, at: Any, factors: Any, clip: Any, found: Any, to: Any) -> Any:
    """To ``found[to:]``: half the sum, over the four ``factors``, of ``entries[at:]`` times each, clipped."""
    from numba.core import types

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        eight = _Eight(context, builder, signature, arguments)
        values, limit = eight.load(0, arguments[1]), eight.all(arguments[3])
        a, b, c, d = (eight.clipped(builder.fmul(values, eight.all(eight.number_of(2, k))), limit) for k in range(4))
        sums = builder.fadd(builder.fadd(a, b), builder.fadd(c, d))
        eight.store(4, arguments[5], builder.fmul(sums, eight.constant(0.5)))
        return context.get_dummy_value()

    return types.void(entries, at, factors, clip, found, to), build


@instruction
def clipped_total(_: Any, entries: Any, at: Any, factor: Any, clip: Any) -> Any:
    """The sum of ``entries[at:]`` times a factor, clipped."""

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        eight = _Eight(context, builder, signature, arguments)
        values = builder.fmul(eight.load(0, arguments[1]), eight.all(arguments[2]))
        return eight.total(eight.clipped(values, eight.all(arguments[3])))

    return entries.dtype(entries, at, factor, clip), build


@instruction
def clipped_adjoint(
    _: Any, entries: Any, at: Any, factors: Any, clip: Any, given: Any, step: Any, each: Any, totals: Any, found: Any
) -> Any:
    """What reaches ``entries[at:]``, added to ``found[at:]``, and the four ``factors``, added to ``totals``.

    The clipped entries of a block are reached by ``given[block · step + at:]`` and all alike by ``each[block]``.  At
    the clip itself, the mean of both sides passes.
    """
    from numba.core import types

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        eight = _Eight(context, builder, signature, arguments)
        begin, step = arguments[1], arguments[5]
        values, limit = eight.load(0, begin), eight.all(arguments[3])
        zero, half = eight.constant(0.0), eight.constant(0.5)
        found = eight.load(8, begin)
        place = begin
        for block in range(4):
            factor = eight.all(eight.number_of(2, block))
            product = builder.fmul(values, factor)
            reached = builder.fadd(eight.load(4, place), eight.all(eight.number_of(6, block)))
            at_clip = builder.fcmp_ordered("==", product, limit)
            passed = builder.select(at_clip, builder.fmul(half, reached), reached)
            passed = builder.select(builder.fcmp_ordered(">", product, limit), zero, passed)
            found = builder.fadd(found, builder.fmul(passed, factor))
            total = builder.fadd(eight.number_of(7, block), eight.total(builder.fmul(passed, values)))
            builder.store(total, eight.place(7, eight.ir.IntType(64)(block), eight.number), align=eight.size)
            place = builder.add(place, step)
        eight.store(8, begin, found)
        return context.get_dummy_value()

    return types.void(entries, at, factors, clip, given, step, each, totals, found), build
