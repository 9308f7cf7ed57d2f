"""Numbers side by side: the vector instructions of a processor, for what loops over single numbers are too slow for.

A *plane* is an array of one dimension.  What is read beyond what is meant is multiplied by a weight of zero, so planes
are padded: to whole :data:`PADDING` numbers, with finite ones.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

PADDING = 16  # numbers, at least as many as go at a time


@cache
def lanes(size: int) -> int:
    """How many numbers of so many bytes go at a time."""
    from llvmlite.binding import get_host_cpu_features

    return (64 if get_host_cpu_features().get("avx512f") else 32) // size


def taking(arguments: tuple[Any, ...], build: Callable[..., Any]) -> Any:
    """What numba wants to know of an instruction with ``*arguments``: its signature, and what builds it."""
    from numba.core import types

    each = types.void(*arguments)

    def of_each(context: Any, builder: Any, _: Any, values: Any) -> Any:
        return build(context, builder, each, [builder.extract_value(values[0], k) for k in range(len(arguments))])

    whole = types.StarArgTuple(arguments)  # type: ignore[no-untyped-call]
    return types.void(whole), of_each


class Builder:
    """Builds instructions on vectors from the arguments of a call by a compiled function: arrays, places, numbers."""

    def __init__(self, context: Any, builder: Any, signature: Any, arguments: Any) -> None:
        from llvmlite import ir

        self.ir, self.context, self.builder = ir, context, builder
        self.types, self.arguments = signature.args, arguments

    def number(self, which: int) -> Any:
        """The type of an array's numbers."""
        return self.context.get_value_type(self.types[which].dtype)

    def size(self, which: int) -> int:
        """Their bytes."""
        return int(self.context.get_abi_sizeof(self.number(which)))

    def vector(self, number: Any, count: int) -> Any:
        return self.ir.VectorType(number, count)

    def whole(self, value: int) -> Any:
        return self.ir.IntType(64)(value)

    def add(self, *places: Any) -> Any:
        total, *others = places
        for other in others:
            total = self.builder.add(total, self.whole(other) if isinstance(other, int) else other)
        return total

    def times(self, left: Any, right: Any) -> Any:
        return self.builder.mul(left, self.whole(right) if isinstance(right, int) else right)

    def place(self, which: int, at: Any, type_: Any) -> Any:
        array = self.context.make_array(self.types[which])(self.context, self.builder, self.arguments[which])
        return self.builder.bitcast(self.builder.gep(array.data, [at]), type_.as_pointer())

    def load(self, which: int, at: Any, count: int) -> Any:
        """So many numbers of an array from a place on."""
        type_ = self.vector(self.number(which), count)
        return self.builder.load(self.place(which, at, type_), align=self.size(which))

    def load_one(self, which: int, at: Any) -> Any:
        return self.builder.load(self.place(which, at, self.number(which)), align=self.size(which))

    def store(self, which: int, at: Any, values: Any) -> None:
        self.builder.store(values, self.place(which, at, values.type), align=self.size(which))

    def splat(self, number: Any, count: int) -> Any:
        """A number so many times."""
        type_ = self.vector(number.type, count)
        one = self.builder.insert_element(self.ir.Constant(type_, self.ir.Undefined), number, self.ir.IntType(32)(0))
        return self.shuffle(one, one, [0] * count)

    def shuffle(self, left: Any, right: Any, order: list[int]) -> Any:
        """Numbers of two vectors by their places, those of the second after those of the first."""
        index = self.ir.VectorType(self.ir.IntType(32), len(order))
        return self.builder.shuffle_vector(left, right, self.ir.Constant(index, order))

    def product_sum(self, left: Any, right: Any, more: Any) -> Any:
        """left · right + more, rounded once where the processor can: on one machine always alike."""
        bits = 32 if left.type.element == self.ir.FloatType() else 64
        return self.call(f"llvm.fmuladd.v{left.type.count}f{bits}", left, right, more)

    def call(self, name: str, *values: Any) -> Any:
        """One of LLVM's own functions, of vectors of one type to another of it."""
        type_ = self.ir.FunctionType(values[0].type, [value.type for value in values])
        function = self.builder.module.globals.get(name) or self.ir.Function(self.builder.module, type_, name)
        return self.builder.call(function, values)

    def total(self, values: Any) -> Any:
        """Their sum, in pairs of pairs of pairs."""
        return self._in_pairs(values, lambda low, high: low + high)

    def largest(self, values: Any) -> Any:
        """The largest of them."""
        return self._in_pairs(values, lambda low, high: low.compare(">", high).where(low, high))

    def _in_pairs(self, values: Any, of_two: Callable[[Lanes, Lanes], Lanes]) -> Any:
        half = values.type.count // 2
        while half:
            low, high = (self.shuffle(values, values, list(range(first, first + half))) for first in (0, half))
            values, half = of_two(Lanes(self, low), Lanes(self, high)).value, half // 2
        return self.builder.extract_element(values, self.ir.IntType(32)(0))

    def variable(self, type_: Any) -> Any:
        """Where a value can be stored and loaded: a register, if there are enough."""
        from numba.core import cgutils

        return cgutils.alloca_once(self.builder, type_)  # type: ignore[no-untyped-call]

    def zeros(self, type_: Any) -> Any:
        return self.ir.Constant(type_, None)

    def transposed(self, rows: list[Any]) -> list[Any]:
        """The columns of a square matrix of 2, 4 or 8 rows."""
        count, step = len(rows), 1
        while step < count:  # blocks of that size are square already: swap those beside the diagonal
            for k in range(count):
                if k & step == 0:
                    upper, lower = rows[k], rows[k + step]
                    left = [j if j & step == 0 else count + j - step for j in range(count)]
                    right = [j + step if j & step == 0 else count + j for j in range(count)]
                    rows[k], rows[k + step] = self.shuffle(upper, lower, left), self.shuffle(upper, lower, right)
            step *= 2
        return rows


class Lanes:
    """Numbers side by side, with the operators of one number; each is rounded by itself.

    Comparisons make a vector of truth values, false where a number is NaN.
    """

    def __init__(self, write: Builder, value: Any) -> None:
        self.write, self.value = write, value

    def like(self, value: Any) -> Lanes:
        """Of a Python number, the same everywhere."""
        if isinstance(value, Lanes):
            return value
        return Lanes(self.write, self.write.ir.Constant(self.value.type, [value] * self.value.type.count))

    def _with(self, operation: str, other: Any) -> Lanes:
        return Lanes(self.write, getattr(self.write.builder, operation)(self.value, self.like(other).value))

    def __add__(self, other: Any) -> Lanes:
        return self._with("fadd", other)

    def __sub__(self, other: Any) -> Lanes:
        return self._with("fsub", other)

    def __mul__(self, other: Any) -> Lanes:
        return self._with("fmul", other)

    def __truediv__(self, other: Any) -> Lanes:
        return self._with("fdiv", other)

    def __neg__(self) -> Lanes:
        return Lanes(self.write, self.write.builder.fneg(self.value))

    def __and__(self, other: Lanes) -> Lanes:
        return self._with("and_", other)

    def __or__(self, other: Lanes) -> Lanes:
        return self._with("or_", other)

    def compare(self, sign: str, other: Any) -> Lanes:
        """Compared by ``<``, ``==``, …"""
        return Lanes(self.write, self.write.builder.fcmp_ordered(sign, self.value, self.like(other).value))

    def where(self, one: Any, other: Any) -> Lanes:
        """Of truth values: ``one`` where they are true, and ``other`` where not."""
        which = one if isinstance(one, Lanes) else other
        values = (which.like(each).value for each in (one, other))
        return Lanes(self.write, self.write.builder.select(self.value, *values))

    def _function(self, name: str) -> Lanes:
        bits = 32 if self.value.type.element == self.write.ir.FloatType() else 64
        return Lanes(self.write, self.write.call(f"llvm.{name}.v{self.value.type.count}f{bits}", self.value))

    def sqrt(self) -> Lanes:
        return self._function("sqrt")

    def abs(self) -> Lanes:
        """The absolute value."""
        return self._function("fabs")

    def copysign(self, other: Lanes) -> Lanes:
        """With the other's signs."""
        bits = 32 if self.value.type.element == self.write.ir.FloatType() else 64
        name = f"llvm.copysign.v{self.value.type.count}f{bits}"
        return Lanes(self.write, self.write.call(name, self.value, other.value))

    def floor(self) -> Lanes:
        return self._function("floor")

    def to(self, other: Lanes) -> Lanes:
        """As numbers of the other's type."""
        mine, theirs = (each.value.type.element == self.write.ir.FloatType() for each in (self, other))
        if mine == theirs:
            return self
        type_ = self.write.vector(other.value.type.element, self.value.type.count)
        change = self.write.builder.fpext if mine else self.write.builder.fptrunc
        return Lanes(self.write, change(self.value, type_))

    def whole(self) -> Any:
        """As 32-bit integers, of which they are values."""
        to = self.write.vector(self.write.ir.IntType(32), self.value.type.count)
        return self.write.builder.fptosi(self.value, to)
