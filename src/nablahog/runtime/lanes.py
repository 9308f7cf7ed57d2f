"""Values of LLVM in vector registers, with operators: what vector instructions are written with; see :mod:`.simd`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    from llvmlite import ir

# llvmlite and numba come without types: to mypy, names of theirs are Any, and Any stands for numba's own objects
Index: TypeAlias = "ir.Value | int"
Number: TypeAlias = "Lanes | float"


class Array:
    """An array among the operands of an instruction."""

    def __init__(self, write: Builder, type_: Any, value: ir.Value) -> None:
        self.write = write
        self.element: ir.Type = write.context.get_value_type(type_.dtype)
        self.itemsize = int(write.context.get_abi_sizeof(self.element))
        self._contents: Any = write.context.make_array(type_)(write.context, write.builder, value)

    @property
    def size(self) -> ir.Value:
        """The number of elements."""
        return self._contents.nitems

    def pointer(self, at: Index, type_: ir.Type) -> ir.Value:
        """The address of the element ``at``, as that of a value of the type."""
        address = self.write.builder.gep(self._contents.data, [self.write.index(at)])
        return self.write.builder.bitcast(address, type_.as_pointer())

    def vector(self, count: int) -> ir.Type:
        """The type of so many lanes of elements."""
        return self.write.ir.VectorType(self.element, count)

    def load(self, at: Index, count: int) -> Lanes:
        """The elements from ``at`` on, one a lane."""
        pointer = self.pointer(at, self.vector(count))
        return Lanes(self.write, self.write.builder.load(pointer, align=self.itemsize))

    def load_masked(self, at: Index, mask: Lanes) -> Lanes:
        """The same where the mask is true; zeros elsewhere, of which nothing is read."""
        vector = self.vector(mask.count)
        pointer, zeros = self.pointer(at, vector), self.write.constant(vector, 0.0)
        align = self.write.ir.Constant(self.write.ir.IntType(32), self.itemsize)
        name = f"llvm.masked.load.{zeros.suffix()}.p0"
        return Lanes(self.write, self.write.call(name, vector, pointer, align, mask.value, zeros.value))

    def store(self, at: Index, values: Lanes) -> None:
        """Writes a vector to the elements from ``at`` on."""
        self.write.builder.store(values.value, self.pointer(at, values.value.type), align=self.itemsize)

    def load_scalar(self, at: Index) -> ir.Value:
        return self.write.builder.load(self.pointer(at, self.element), align=self.itemsize)

    def store_scalar(self, at: Index, value: ir.Value) -> None:
        self.write.builder.store(value, self.pointer(at, self.element), align=self.itemsize)

    def splat(self, at: Index, count: int) -> Lanes:
        """One element in every lane."""
        return self.write.splat(self.load_scalar(at), count)


class Variable:
    """A vector that changes in a loop: in a register, if there are enough."""

    def __init__(self, initial: Lanes) -> None:
        from numba.core import cgutils

        self.write = initial.write
        self._pointer = cgutils.alloca_once(self.write.builder, initial.value.type)  # type: ignore[no-untyped-call]
        self.set(initial)

    def get(self) -> Lanes:
        return Lanes(self.write, self.write.builder.load(self._pointer))

    def set(self, values: Lanes) -> None:
        self.write.builder.store(values.value, self._pointer)


class Builder:
    """Appends instructions to the function that is compiled."""

    def __init__(self, context: Any, builder: ir.IRBuilder) -> None:
        from llvmlite import ir

        self.ir, self.context, self.builder = ir, context, builder

    def operand(self, type_: Any, value: ir.Value) -> Any:
        """A value of numba's type, as :func:`vector_instruction` hands it on: of which kind, the type says."""
        from numba.core import types

        if isinstance(type_, types.Array):
            return Array(self, type_, value)
        if isinstance(type_, types.BaseNamedTuple):
            named: Any = type_  # numba's hints lack its attributes
            fields = [self.operand(of, self.builder.extract_value(value, k)) for k, of in enumerate(named.types)]
            return named.instance_class(*fields)
        return value

    def index(self, value: Index) -> ir.Value:
        """A 64-bit integer, of a Python number if it is one."""
        return self.ir.IntType(64)(value) if isinstance(value, int) else value

    def add(self, *indices: Index) -> ir.Value:
        """The sum of indices."""
        total, *others = (self.index(each) for each in indices)
        for other in others:
            total = self.builder.add(total, other)
        return total

    def subtract(self, left: Index, right: Index) -> ir.Value:
        """The difference of two indices."""
        return self.builder.sub(self.index(left), self.index(right))

    def multiply(self, left: Index, right: Index) -> ir.Value:
        """The product of two indices."""
        return self.builder.mul(self.index(left), self.index(right))

    @contextmanager
    def loop(self, stop: Index, step: int = 1) -> Iterator[ir.Value]:
        """A loop from 0 to below ``stop``; the index."""
        from numba.core import cgutils

        with cgutils.for_range_slice(self.builder, self.index(0), self.index(stop), self.index(step)) as (index, _):
            yield index

    def if_less(self, left: Index, right: Index) -> AbstractContextManager[object]:
        """Instructions that run only if ``left`` is less than ``right``."""
        condition: AbstractContextManager[object] = self.builder.if_then(
            self.builder.icmp_signed("<", self.index(left), self.index(right))
        )
        return condition

    def vector(self, number: ir.Type, count: int) -> ir.Type:
        return self.ir.VectorType(number, count)

    def constant(self, type_: ir.Type, values: object) -> Lanes:
        """A vector of Python numbers, or of one in every lane."""
        numbers = values if isinstance(values, list) else [values] * type_.count
        return Lanes(self, self.ir.Constant(type_, numbers))

    def splat(self, number: ir.Value, count: int) -> Lanes:
        """A number in every lane."""
        type_ = self.vector(number.type, count)
        one = self.builder.insert_element(self.ir.Constant(type_, self.ir.Undefined), number, self.ir.IntType(32)(0))
        return self.shuffle(Lanes(self, one), Lanes(self, one), [0] * count)

    def splat_int32(self, number: ir.Value, count: int) -> Lanes:
        """A 64-bit integer as a 32-bit one in every lane."""
        return self.splat(self.builder.trunc(number, self.ir.IntType(32)), count)

    def first_lanes(self, count: ir.Value, lanes: int) -> Lanes:
        """The mask of the lanes below ``count``."""
        type_ = self.vector(self.ir.IntType(32), lanes)
        return self.constant(type_, list(range(lanes))).compare("<", self.splat_int32(count, lanes))

    def shuffle(self, left: Lanes, right: Lanes, order: list[int]) -> Lanes:
        """Lanes of two vectors by number, those of the second after those of the first."""
        index = self.vector(self.ir.IntType(32), len(order))
        return Lanes(self, self.builder.shuffle_vector(left.value, right.value, self.ir.Constant(index, order)))

    def call(self, name: str, result: ir.Type, *values: ir.Value) -> ir.Value:
        """Calls one of LLVM's intrinsic functions."""
        type_ = self.ir.FunctionType(result, [value.type for value in values])
        function = self.builder.module.globals.get(name) or self.ir.Function(self.builder.module, type_, name)
        return self.builder.call(function, values)

    def transpose(self, rows: list[Lanes]) -> list[Lanes]:
        """The columns of a square matrix of 2, 4 or 8 rows."""
        rows, count, step = list(rows), len(rows), 1
        while step < count:  # blocks of that size are transposed already: swap those beside the diagonal
            for k in range(count):
                if k & step == 0:
                    upper, lower = rows[k], rows[k + step]
                    left = [j if j & step == 0 else count + j - step for j in range(count)]
                    right = [j + step if j & step == 0 else count + j for j in range(count)]
                    rows[k], rows[k + step] = self.shuffle(upper, lower, left), self.shuffle(upper, lower, right)
            step *= 2
        return rows


class Lanes:
    """A vector, with the operators of one number; each lane is rounded by itself.

    Elements are floating-point numbers, integers, or the truth values of a mask, which comparisons make.
    """

    def __init__(self, write: Builder, value: ir.Value) -> None:
        self.write, self.value = write, value

    @property
    def count(self) -> int:
        return int(self.value.type.count)

    def like(self, value: Number) -> Lanes:
        """A Python number in every lane, of the same type."""
        return value if isinstance(value, Lanes) else self.write.constant(self.value.type, value)

    def _is_integer(self) -> bool:
        return isinstance(self.value.type.element, self.write.ir.IntType)

    def suffix(self) -> str:
        """Of names of LLVM's functions of such vectors."""
        bits = 32 if self.value.type.element == self.write.ir.FloatType() else 64
        return f"v{self.count}f{bits}"

    def _with(self, operation: str, other: Number) -> Lanes:
        name = operation if self._is_integer() else f"f{operation}"
        return Lanes(self.write, getattr(self.write.builder, name)(self.value, self.like(other).value))

    def __add__(self, other: Number) -> Lanes:
        return self._with("add", other)

    def __sub__(self, other: Number) -> Lanes:
        return self._with("sub", other)

    def __mul__(self, other: Number) -> Lanes:
        return self._with("mul", other)

    def __truediv__(self, other: Number) -> Lanes:
        return self._with("div", other)

    def __neg__(self) -> Lanes:
        return Lanes(self.write, self.write.builder.fneg(self.value))

    def __and__(self, other: Lanes) -> Lanes:
        return Lanes(self.write, self.write.builder.and_(self.value, other.value))

    def __or__(self, other: Lanes) -> Lanes:
        return Lanes(self.write, self.write.builder.or_(self.value, other.value))

    def compare(self, sign: str, other: Number) -> Lanes:
        """The mask of ``<``, ``==``, …: false where a number is NaN."""
        builder = self.write.builder
        of = builder.icmp_signed if self._is_integer() else builder.fcmp_ordered
        return Lanes(self.write, of(sign, self.value, self.like(other).value))

    def where(self, one: Number, other: Number) -> Lanes:
        """Of a mask: lanes of ``one`` where it is true, of ``other`` where not."""
        vector = one if isinstance(one, Lanes) else other
        assert isinstance(vector, Lanes)
        values = (vector.like(each).value for each in (one, other))
        return Lanes(self.write, self.write.builder.select(self.value, *values))

    def _function(self, name: str, *others: Lanes) -> Lanes:
        values = (self.value, *(other.value for other in others))
        return Lanes(self.write, self.write.call(f"llvm.{name}.{self.suffix()}", self.value.type, *values))

    def multiply_add(self, factor: Lanes, more: Lanes) -> Lanes:
        """self · factor + more, rounded once where the processor can: on one machine always alike."""
        return self._function("fmuladd", factor, more)

    def sqrt(self) -> Lanes:
        return self._function("sqrt")

    def abs(self) -> Lanes:
        return self._function("fabs")

    def floor(self) -> Lanes:
        return self._function("floor")

    def copysign(self, other: Lanes) -> Lanes:
        """With the other's signs."""
        return self._function("copysign", other)

    def to(self, other: Lanes) -> Lanes:
        """As floating-point numbers of the other's type."""
        mine, theirs = (each.value.type.element == self.write.ir.FloatType() for each in (self, other))
        if mine == theirs:
            return self
        type_ = self.write.vector(other.value.type.element, self.count)
        convert = self.write.builder.fpext if mine else self.write.builder.fptrunc
        return Lanes(self.write, convert(self.value, type_))

    def to_int32(self) -> Lanes:
        """As 32-bit integers, which they are already in value."""
        type_ = self.write.vector(self.write.ir.IntType(32), self.count)
        return Lanes(self.write, self.write.builder.fptosi(self.value, type_))

    def sum(self) -> ir.Value:
        """The sum of all lanes, in pairs of pairs of pairs."""
        return self._in_pairs(lambda low, high: low + high)

    def max(self) -> ir.Value:
        """The largest lane."""
        return self._in_pairs(lambda low, high: low.compare(">", high).where(low, high))

    def _in_pairs(self, combine: Callable[[Lanes, Lanes], Lanes]) -> ir.Value:
        values, half = self, self.count // 2
        while half:
            low, high = (self.write.shuffle(values, values, list(range(k, k + half))) for k in (0, half))
            values, half = combine(low, high), half // 2
        return self.write.builder.extract_element(values.value, self.write.ir.IntType(32)(0))
