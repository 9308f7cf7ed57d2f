"""Four weights at a time: the instructions by which a pixel adds to, and reads from, the cells it lies between.

A *group* holds one orientation bin after the other, and of each bin four cells side by side in memory, its lanes.  A
pixel has one weight for each lane, the product of two vectors of four: of its row and of its column of pixels.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from ...compile import instruction


def _vectors(context: Any, builder: Any, signature: Any, arguments: Any) -> tuple[Any, Any, Any]:
    """For arguments (group, at, …, row weights, at, column weights, at): its address, the weights, and their type."""
    from llvmlite import ir

    def address(which: int) -> Any:
        array = context.make_array(signature.args[which])(context, builder, arguments[which])
        return builder.gep(array.data, [arguments[which + 1]])

    count = len(arguments)
    four = ir.VectorType(context.get_value_type(signature.args[0].dtype), 4)
    rows, cols = (builder.load(builder.bitcast(address(k), four.as_pointer()), align=4) for k in (count - 4, count - 2))
    return address(0), builder.fmul(rows, cols), four


def _add(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    """Adds ``votes`` · weights to as many bins as there are votes, of which the first is at the address."""
    from llvmlite import ir

    place, weights, four = _vectors(context, builder, signature, arguments)
    votes = arguments[2:-4]
    count = 4 * len(votes)
    wide = ir.VectorType(four.element, count)
    index = ir.VectorType(ir.IntType(32), count)
    # each vote four times beside each other, and the four weights as often as there are votes
    spread = ir.Constant(ir.VectorType(four.element, len(votes)), ir.Undefined)
    for k, vote in enumerate(votes):
        spread = builder.insert_element(spread, vote, ir.IntType(32)(k))
    spread = builder.shuffle_vector(spread, spread, ir.Constant(index, [k // 4 for k in range(count)]))
    weights = builder.shuffle_vector(weights, weights, ir.Constant(index, [k % 4 for k in range(count)]))
    place = builder.bitcast(place, wide.as_pointer())
    size = context.get_abi_sizeof(four.element)
    product = builder.fmul(weights, spread)
    builder.store(builder.fadd(builder.load(place, align=size), product), place, align=size)
    return context.get_dummy_value()


@instruction
def add_one(_: Any, group: Any, at: Any, vote: Any, by_row: Any, row: Any, by_col: Any, col: Any) -> Any:
    """Adds a hard vote to the bin at ``group[at:]``."""
    from numba.core import types

    return types.void(group, at, vote, by_row, row, by_col, col), _add


@instruction
def add_two(_: Any, group: Any, at: Any, near: Any, far: Any, by_row: Any, row: Any, by_col: Any, col: Any) -> Any:
    """Adds a linear vote to the bin at ``group[at:]`` and the one after it."""
    from numba.core import types

    return types.void(group, at, near, far, by_row, row, by_col, col), _add


@instruction
def add_four(
    _: Any, group: Any, at: Any, a: Any, b: Any, c: Any, d: Any, by_row: Any, row: Any, by_col: Any, col: Any
) -> Any:
    """Adds to four bins in a row."""
    from numba.core import types

    return types.void(group, at, a, b, c, d, by_row, row, by_col, col), _add


def _read(context: Any, builder: Any, signature: Any, arguments: Any, more: bool) -> Any:
    """The sums over the lanes of four bins from the address on, put or added to (found, at)."""
    from llvmlite import ir

    place, weights, four = _vectors(context, builder, signature, arguments)
    size = context.get_abi_sizeof(four.element)
    eight, index = ir.VectorType(four.element, 8), ir.VectorType(ir.IntType(32), 8)
    place = builder.bitcast(place, eight.as_pointer())
    twice = builder.shuffle_vector(weights, weights, ir.Constant(index, [0, 1, 2, 3] * 2))
    low, high = (builder.fmul(builder.load(builder.gep(place, [ir.IntType(64)(k)]), align=size), twice) for k in (0, 1))

    def pairs(left: Any, right: Any, wide: int) -> Any:
        index = ir.VectorType(ir.IntType(32), wide)
        even, odd = (ir.Constant(index, list(range(first, 2 * wide, 2))) for first in (0, 1))
        return builder.fadd(builder.shuffle_vector(left, right, even), builder.shuffle_vector(left, right, odd))

    sums = pairs(low, high, 8)  # of two lanes: two for each bin
    ends = [ir.Constant(ir.VectorType(ir.IntType(32), 4), list(range(k, k + 4))) for k in (0, 4)]
    left, right = (builder.shuffle_vector(sums, sums, end) for end in ends)
    sums = pairs(left, right, 4)
    array = context.make_array(signature.args[2])(context, builder, arguments[2])
    to = builder.bitcast(builder.gep(array.data, [arguments[3]]), four.as_pointer())
    builder.store(builder.fadd(builder.load(to, align=size), sums) if more else sums, to, align=size)
    return context.get_dummy_value()


@instruction
def read_four(_: Any, group: Any, at: Any, found: Any, to: Any, by_row: Any, row: Any, by_col: Any, col: Any) -> Any:
    """To ``found[to:]``, what the pixel's weights make of the lanes of each of four bins from ``group[at:]`` on."""
    from numba.core import types

    return types.void(group, at, found, to, by_row, row, by_col, col), partial(_read, more=False)


@instruction
def read_four_more(
    _: Any, group: Any, at: Any, found: Any, to: Any, by_row: Any, row: Any, by_col: Any, col: Any
) -> Any:
    """The same, added to what is there."""
    from numba.core import types

    return types.void(group, at, found, to, by_row, row, by_col, col), partial(_read, more=True)


@instruction
def collect_four(_: Any, group: Any, at: Any, cells: Any, a: Any, b: Any, c: Any, d: Any) -> Any:
    """Adds four bins from ``group[at:]`` to those of four cells, one for each lane: ``cells[a:]`` … ``cells[d:]``."""
    from numba.core import types

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        from llvmlite import ir

        number = context.get_value_type(signature.args[0].dtype)
        size, four = context.get_abi_sizeof(number), ir.VectorType(number, 4)

        def place(which: int, at: Any) -> Any:
            array = context.make_array(signature.args[which])(context, builder, arguments[which])
            return builder.bitcast(builder.gep(array.data, [at]), four.as_pointer())

        def mixed(left: Any, right: Any, *order: int) -> Any:
            return builder.shuffle_vector(left, right, ir.Constant(ir.VectorType(ir.IntType(32), 4), list(order)))

        first = place(0, arguments[1])
        p, q, r, s = (builder.load(builder.gep(first, [ir.IntType(64)(k)]), align=size) for k in range(4))
        low, high = (
            (mixed(p, q, 0, 4, 1, 5), mixed(r, s, 0, 4, 1, 5)),
            (mixed(p, q, 2, 6, 3, 7), mixed(r, s, 2, 6, 3, 7)),
        )
        lanes = [mixed(*pair, *order) for pair in (low, high) for order in ((0, 1, 4, 5), (2, 3, 6, 7))]
        for lane, at in zip(lanes, arguments[3:], strict=True):
            to = place(2, at)
            builder.store(builder.fadd(builder.load(to, align=size), lane), to, align=size)
        return context.get_dummy_value()

    return types.void(group, at, cells, a, b, c, d), build
