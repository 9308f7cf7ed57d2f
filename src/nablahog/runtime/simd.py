"""Vector instructions for compiled loops: what Numba does not vectorise by itself, written in LLVM's own terms.

A *lane* is one element of a vector register.  A *plane* is an array of one dimension.  Loads may read beyond the
elements that are meant, with weight zero; so planes are padded to whole :data:`PADDING` elements, all finite.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .compile import instruction
from .lanes import Builder
from .processor import vector_bytes

if TYPE_CHECKING:
    from llvmlite import ir

PADDING = 16  # elements, at least as many as a vector has
CACHE_LINE = 64  # bytes


def whole_vectors(count: int) -> int:
    """``count`` elements rounded up to whole vectors."""
    return (count + PADDING - 1) // PADDING * PADDING


def aligned_zeros(count: int, dtype: npt.DTypeLike) -> npt.NDArray[Any]:
    """A plane of zeros that begins with a cache line, so that no vector lies in two."""
    kind = np.dtype(dtype)
    memory = np.zeros(count * kind.itemsize + CACHE_LINE, np.uint8)
    begin = -memory.ctypes.data % CACHE_LINE
    return memory[begin : begin + count * kind.itemsize].view(kind)


def lanes(size: int) -> int:
    """Lanes of a vector register, of elements of ``size`` bytes."""
    return vector_bytes() // size


def vector_instruction(build: Callable[..., None]) -> Callable[..., None]:
    """Makes ``build`` an instruction that compiled functions call like any other function.

    ``build`` is called while such a function is compiled, with a :class:`Builder` and the operands of the call: an
    :class:`Array` for an array, LLVM's value for a number, a NamedTuple of these for a NamedTuple.
    """
    return _instruction(build, returns=False)


def vector_function(build: Callable[..., ir.Value]) -> Callable[..., Any]:
    """The same with a result, of the type that its first operand, or that array's elements have."""
    return _instruction(build, returns=True)


def _instruction(build: Callable[..., Any], returns: bool) -> Callable[..., Any]:
    # numba's own types of arguments, contexts and builders have no names for a type checker
    def define(_: Any, *arguments: Any) -> tuple[Any, Callable[..., ir.Value]]:
        from numba.core import types

        def generate(context: Any, builder: ir.IRBuilder, _: Any, values: Any) -> ir.Value:
            write = Builder(context, builder)
            operands = [write.operand(type_, builder.extract_value(values[0], k)) for k, type_ in enumerate(arguments)]
            result = build(write, *operands)
            return result if returns else context.get_dummy_value()

        result = getattr(arguments[0], "dtype", arguments[0]) if returns else types.void
        return result(types.StarArgTuple(arguments)), generate  # type: ignore[no-untyped-call]

    return instruction(define, build)
