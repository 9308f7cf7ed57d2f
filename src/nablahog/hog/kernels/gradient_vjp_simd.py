"""The adjoint of gradients in vectors: from what reaches votes to what reaches gradients, and on to values."""

from __future__ import annotations

from functools import partial
from typing import Any

from ...runtime.compile import instruction
from ...runtime.simd import Builder, Lanes, lanes, taking


def _to_gradients(context: Any, builder: Any, signature: Any, arguments: Any, hard: bool) -> Any:
    from numba.core import cgutils

    write = Builder(context, builder, signature, arguments)
    columns = lanes(write.size(0))
    at, width, slope, to = arguments[10], arguments[11], arguments[12], arguments[15]
    index = write.vector(write.ir.IntType(64), columns)
    each = write.ir.Constant(index, list(range(columns)))
    by_slope = Lanes(write, write.splat(slope, columns))
    with cgutils.for_range_slice(builder, write.whole(0), width, write.whole(columns)) as (x, _):
        place = write.add(at, x)
        m, f, here, after, exact, before_exact, here_exact, after_exact, gx, gy = (
            Lanes(write, write.load(which, place, columns)) for which in range(10)
        )
        inside = Lanes(write, builder.icmp_signed("<", each, write.splat(builder.sub(width, x), columns)))
        inverse = (m.compare(">", 0.0) & inside).where(m.like(1.0) / m, 0.0)
        along = here if hard else here + f * (after - here)
        along = m.compare(">", 0.0).where(along * inverse, 0.0)
        us, vs = along * gx, along * gy
        if not hard:
            change = exact.compare("==", 0.0).where((after_exact - before_exact) * 0.5, after_exact - here_exact)
            across = m.compare(">", 0.0).where(by_slope * change * inverse, 0.0)
            us, vs = us - across * gy, vs + across * gx
        begin = write.add(to, x, 1)
        for which, values in ((13, us), (14, vs)):
            write.store(which, begin, inside.where(values, 0.0).value)
    return context.get_dummy_value()


def _returns(hard: bool) -> Any:
    """An instruction: what reaches the gradients of a row of pixels, to lines with an end in front.

    By their magnitudes between two bins; by their angles, of which hard votes know nothing, the difference of the two,
    on a bin centre the mean of those on both sides.  Its arguments, in this order:

    * planes: m and f; what reaches the votes here and after; the same of the exact angle: f, before, here and after; gx
      and gy.  at: the first pixel; width: of the row.
    * slope: bins per radian.
    * to_gx, to_gy: to write, zeros behind the row to whole vectors; to: the end in front.
    """

    def returns(_: Any, *arguments: Any) -> Any:
        return taking(arguments, partial(_to_gradients, hard=hard))

    return instruction(returns)


votes_vjp, hard_votes_vjp = _returns(hard=False), _returns(hard=True)


@instruction
def central_vjp(
    _: Any, to_gx: Any, to_gy: Any, line: Any, above: Any, below: Any, width: Any, slope: Any, found: Any, to: Any
) -> Any:
    """What reaches a row of values from central differences, times ``slope``, to ``found[to:]``.

    From the gradients of the row, which begin with an end at ``to_gx[line:]``, and those above and below at ``to_gy``.
    The row is at least as wide as a vector.
    """
    from numba.core import types

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        from numba.core import cgutils

        write = Builder(context, builder, signature, arguments)
        columns = lanes(write.size(0))
        (line, above, below, width, slope), to = arguments[2:7], arguments[8]
        by_slope = Lanes(write, write.splat(slope, columns))
        last = builder.sub(width, write.whole(columns))
        with cgutils.for_range_slice(builder, write.whole(0), width, write.whole(columns)) as (k, _):
            x = builder.select(builder.icmp_signed("<", k, last), k, last)  # the last may overlap the one before it
            left, right, up, down = (
                Lanes(write, write.load(which, write.add(begin, x, more), columns))
                for which, begin, more in ((0, line, 0), (0, line, 2), (1, above, 1), (1, below, 1))
            )
            write.store(7, write.add(to, x), (by_slope * (left - right + up - down)).value)
        return context.get_dummy_value()

    return types.void(to_gx, to_gy, line, above, below, width, slope, found, to), build
