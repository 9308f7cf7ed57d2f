"""What reaches the votes of pixels, looked up: of :mod:`.pooling_vjp_simd`, where sixteen numbers are found at a time.

Pixels of a row and a run hear from the same four cells.  Of two cells beside each other, what reaches their bins, each
the sum of two rows of cells, is a table in registers; a pixel takes its bins' entries of both and adds them up.
"""

from __future__ import annotations

from typing import Any

from ...runtime.compile import instruction
from ...runtime.simd import Builder, lanes, taking

ENTRIES = 32  # of a table, in two vectors
_AT_ONCE = 16


def fits(size: int, bins: int) -> bool:
    """Whether the processor looks up numbers of so many bytes, and tables hold so many bins and those beside them."""
    return size == 4 and lanes(size) == _AT_ONCE and bins + 2 <= ENTRIES


class _Tables(Builder):
    """Two tables of entries, of each two vectors."""

    def mixed_rows(self, cell: Any, next_row: Any, weights: list[Any]) -> list[Any]:
        """The table of a cell: the sum of two rows of cells, by their weights."""
        halves = []
        for half in (0, _AT_ONCE):
            above, below = (self.load(0, self.add(cell, more, half), _AT_ONCE) for more in (0, next_row))
            halves.append(self.product_sum(below, weights[1], self.builder.fmul(above, weights[0])))
        return halves

    def entries(self, table: list[Any], places: Any) -> Any:
        name = "llvm.x86.avx512.vpermi2var.ps.512"
        type_ = self.ir.FunctionType(table[0].type, [table[0].type, places.type, table[1].type])
        function = self.builder.module.globals.get(name) or self.ir.Function(self.builder.module, type_, name)
        return self.builder.call(function, [table[0], places, table[1]])


def _look_up(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    from numba.core import cgutils

    write = _Tables(context, builder, signature, arguments)
    at, line, next_row = arguments[1:4]
    first, count, share, length, weight, to = (arguments[which] for which in (5, 6, 8, 9, 11, 15))
    if not fits(write.size(0), 0):
        return context.get_dummy_value()  # which is never called
    weights = [write.splat(write.load_one(10, write.add(weight, row)), _AT_ONCE) for row in range(2)]
    left, right = (write.mixed_rows(cell, next_row, weights) for cell in (at, write.add(at, line)))
    with cgutils.for_range_slice(builder, write.whole(0), count, write.whole(_AT_ONCE)) as (x, _):
        bins = write.load(4, write.add(first, x), _AT_ONCE)
        by_left, by_right = (
            write.load(7, place, _AT_ONCE) for place in (write.add(share, x), write.add(share, length, x))
        )
        for later in range(3):
            places = builder.add(bins, write.ir.Constant(bins.type, [later] * _AT_ONCE))
            reached = builder.fmul(write.entries(left, places), by_left)
            reached = write.product_sum(write.entries(right, places), by_right, reached)
            write.store(12 + later, write.add(to, x), reached)
    return context.get_dummy_value()


@instruction
def look_up(_: Any, *arguments: Any) -> Any:
    """What reaches the votes of pixels of a row and a run: for the bin before their own, their own, and the next.

    Its arguments, in this order:

    * cells: what reaches bins, a cell's begin with the last and end with the first once more; at: the left cell's in
      the upper row of cells; line: from there to the right one's; next_row: to those in the lower row.
    * bins: the pixels' own; first: the first pixel's; count: of pixels, which is rounded up to whole sixteens.
    * shares: weights of columns; share: of the first for the left cell; length: from there to those for the right one.
    * rows: weights of rows; weight: of the pixels' row in the upper row of cells, which the lower one's is next to.
    * before, here, after: planes to write; to: the first pixel's place there.
    """
    return taking(arguments, _look_up)
