"""Eq. 2-4 in vectors: magnitudes and bins of many pixels at a time.

With m its magnitude, a pixel gives (1 - f) · m to one bin and f · m to the next; a hard vote has no f.  Pixels whose
squared magnitude is below ``tiny`` have none.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from ...runtime.compile import instruction
from ...runtime.simd import Builder, Lanes, lanes

LEAST = 2.0**-120  # what is divided by


def _along(
    context: Any, builder: Any, signature: Any, arguments: Any, vote: Callable[..., tuple[Lanes, ...]], written: int
) -> Any:
    """Votes of planes of gradients, the first two arguments, to the last ones, of which the last are bins.

    ``vote`` makes them, from the gradients and a function that reads the arguments between by argument and place.
    """
    from numba.core import cgutils

    write = Builder(context, builder, signature, arguments)
    columns = lanes(write.size(0))
    size = context.make_array(signature.args[0])(context, builder, arguments[0]).nitems

    def number(which: int, at: Any) -> Lanes:
        place = write.whole(at) if isinstance(at, int) else at
        return Lanes(write, write.splat(write.load_one(which, place), columns))

    with cgutils.for_range_slice(builder, write.whole(0), size, write.whole(columns)) as (index, _):
        gx, gy = (Lanes(write, write.load(which, index, columns)) for which in (0, 1))
        *votes, bins = vote(write, gx, gy, number)
        for which, plane in enumerate(votes, len(arguments) - written):
            write.store(which, index, plane.value)
        write.store(len(arguments) - 1, index, bins.value if isinstance(bins, Lanes) else bins)
    return context.get_dummy_value()


def _magnitude(gx: Lanes, gy: Lanes, tiny: Lanes) -> Lanes:
    """‖∇‖ of Eq. 2."""
    squared = gx * gx + gy * gy
    return squared.compare("<", tiny).where(0.0, squared.sqrt())


def _in_turn(position: Lanes, count: Lanes, per_turn: Lanes) -> tuple[Lanes, Any]:
    """How far a position is from the bin at or before it, and that bin; 0 for NaN.  ``per_turn`` is 1 / count."""
    before = position.floor()
    bins = before - ((before + 0.5) * per_turn).floor() * count
    return position - before, bins.compare(">", 0.0).where(bins, 0.0).whole()


def _linear(write: Builder, gx: Lanes, gy: Lanes, number: Callable[..., Lanes]) -> tuple[Any, ...]:
    tiny, up, per_half_turn, offset, *turn_of_bins = (number(2, k) for k in range(6))
    m = _magnitude(gx, gy, tiny)
    u, v = gx, up * gy
    au, av = u.abs(), v.abs()
    steep = au.compare("<", av)
    small, large = steep.where(au, av), steep.where(av, au)
    t = small / large.compare("<", LEAST).where(LEAST, large)  # of no gradient, some number
    s = t * t
    turn = number(3, 6).to(gx)
    for k in range(5, -1, -1):
        turn = Lanes(write, write.product_sum(turn.value, s.value, number(3, k).to(gx).value))
    turn = t * turn
    turn = small.compare("==", large).where(0.25, turn)  # which may be a bin centre, too
    turn = steep.where(turn.like(0.5) - turn, turn)
    turn = u.compare("<", 0.0).where(turn.like(1.0) - turn, turn)
    position = turn.copysign(v) * per_half_turn - offset
    return m, *_in_turn(position, *turn_of_bins)


@instruction
def linear_votes(_: Any, gx: Any, gy: Any, numbers: Any, arctangent: Any, m: Any, f: Any, bins: Any) -> Any:
    """Linear votes in float32: m, f and bins of planes of gradients of whole :data:`.simd.PADDING`.

    ``numbers`` are the smallest squared magnitude, -1 if bins go against the clock and else 1, bins by half a turn, the
    first bin's place, and the number of bins.  ``arctangent`` are coefficients of the odd polynomial atan(t) / π.
    """
    from numba.core import types

    return types.void(gx, gy, numbers, arctangent, m, f, bins), partial(_along, vote=_linear, written=3)


def _opencv(write: Builder, gx: Lanes, gy: Lanes, number: Callable[..., Lanes]) -> tuple[Any, ...]:
    tiny, offset, *turn_of_bins = (number(2, k) for k in (0, 3, 4, 5))
    p1, p3, p5, p7, guard, radian, per_radian = (number(3, k) for k in range(7))
    m = _magnitude(gx, gy, tiny)
    u, v = gx.to(p1), gy.to(p1)
    au, av = u.abs(), v.abs()
    steep = au.compare("<", av)
    t = steep.where(au, av) / (steep.where(av, au) + guard)
    s = t * t
    angle = (((p7 * s + p5) * s + p3) * s + p1) * t
    angle = steep.where(angle.like(90.0) - angle, angle)
    angle = u.compare("<", 0.0).where(angle.like(180.0) - angle, angle)
    angle = v.compare("<", 0.0).where(angle.like(360.0) - angle, angle)
    position = angle * radian * per_radian - offset.to(p1)
    f, bins = _in_turn(position, *(each.to(p1) for each in turn_of_bins))
    return m, f.to(m), bins


@instruction
def opencv_votes(_: Any, gx: Any, gy: Any, numbers: Any, table: Any, m: Any, f: Any, bins: Any) -> Any:
    """The same by OpenCV's arctangent, in float32: :func:`nablahog.hog.library_angles.opencv`.

    ``table`` holds its coefficients in degrees, the guard of its division, a degree in radians, and bins by radian.
    """
    from numba.core import types

    return types.void(gx, gy, numbers, table, m, f, bins), partial(_along, vote=_opencv, written=3)


# of the arcsine by a quotient of polynomials, from fdlibm: asin(s) = s + s · z · above(z) / below(z), z = s²
_ABOVE = (
    1.66666666666666657415e-01,
    -3.25565818622400915405e-01,
    2.01212532134862925881e-01,
    -4.00555345006794114027e-02,
    7.91534994289814532176e-04,
    3.47933107596021167570e-05,
)
_BELOW = (
    1.0,
    -2.40339491173441421878,
    2.02094576023350569471,
    -6.88283971605453293030e-01,
    7.70381505559019352791e-02,
)


def _polynomial(x: Lanes, coefficients: tuple[float, ...]) -> Lanes:
    value = x.like(coefficients[-1])
    for coefficient in reversed(coefficients[:-1]):
        value = value * x + coefficient
    return value


def _arccosine(cosine: Lanes) -> Lanes:
    """Of 0…1 in float64: four times the arcsine of the sine of a quarter of the angle."""
    of_half = (cosine * 0.5 + 0.5).sqrt()
    z = cosine.like(0.5) - of_half * 0.5
    sine = z.sqrt()
    return (sine + sine * z * _polynomial(z, _ABOVE) / _polynomial(z, _BELOW)) * 4.0


def _vlfeat(write: Builder, gx: Lanes, gy: Lanes, number: Callable[..., Lanes]) -> tuple[Any, ...]:
    from numba.core import cgutils

    builder, (axes, opposite, count) = write.builder, write.arguments[5:8]
    m, least, unit = _magnitude(gx, gy, number(2, 0)), number(4, 0), number(4, 1)
    u, v = gx.to(number(3, 0)), gy.to(number(3, 0))
    whole = write.ir.IntType(32)
    place = write.vector(whole, gx.value.type.count)
    nothing, none = u.like(-1.0).value, write.zeros(place)
    sizes, bins = [write.variable(u.value.type) for _ in range(2)], [write.variable(place) for _ in range(2)]
    for of_size, of_bin in zip(sizes, bins, strict=True):
        builder.store(nothing, of_size)
        builder.store(none, of_bin)
    beyond = write.splat(builder.trunc(opposite, whole), place.count)
    with cgutils.for_range(builder, axes) as loop:
        here = u * number(3, loop.index) + v * number(3, write.add(loop.index, axes))
        size, (most, next_) = here.abs(), (Lanes(write, builder.load(each)) for each in sizes)
        best, second = (builder.load(each) for each in bins)
        this = write.splat(builder.trunc(loop.index, whole), place.count)
        this = builder.add(this, builder.select(here.compare("<", 0.0).value, beyond, none))
        better, runner_up = most.compare("<", size), next_.compare("<", size)
        builder.store(better.where(most, runner_up.where(size, next_)).value, sizes[1])
        builder.store(better.where(size, most).value, sizes[0])
        builder.store(builder.select(better.value, best, builder.select(runner_up.value, this, second)), bins[1])
        builder.store(builder.select(better.value, this, best), bins[0])
    most = Lanes(write, builder.load(sizes[0]))
    length = (u * u + v * v).sqrt().to(least)
    cosine = most.to(least) / length.compare(">", least).where(length, least)
    cosine = cosine.compare("<", 1.0).where(cosine, 1.0).to(u).to(least)  # which VLFeat rounds to float32
    of_second = (_arccosine(cosine) / unit).to(u)
    best, second = (builder.load(each) for each in bins)
    after = builder.add(best, write.ir.Constant(place, [1] * place.count))
    last = builder.icmp_signed("==", after, write.splat(builder.trunc(count, whole), place.count))
    ahead = Lanes(write, builder.icmp_signed("==", second, builder.select(last, none, after)))
    f = ahead.where(of_second, of_second.like(1.0) - of_second)
    return m, f.to(m), builder.select(ahead.value, best, second)


@instruction
def vlfeat_votes(
    _: Any,
    gx: Any,
    gy: Any,
    numbers: Any,
    directions: Any,
    arccosine: Any,
    axes: Any,
    opposite: Any,
    count: Any,
    m: Any,
    f: Any,
    bins: Any,
) -> Any:
    """The same by VLFeat's arccosine: :func:`nablahog.hog.library_angles.vlfeat`.

    ``directions`` (all cosines, all sines) are float32, ``arccosine`` float64: the least magnitude and the angle
    between two axes.  ``opposite`` is how much further a bin is where the product with an axis is negative.
    """
    from numba.core import types

    signature = types.void(gx, gy, numbers, directions, arccosine, axes, opposite, count, m, f, bins)
    return signature, partial(_along, vote=_vlfeat, written=3)


def _nearest(write: Builder, gx: Lanes, gy: Lanes, number: Callable[..., Lanes]) -> tuple[Any, ...]:
    from numba.core import cgutils

    builder, (axes, opposite) = write.builder, write.arguments[4:6]
    m = _magnitude(gx, gy, number(2, 0))
    whole = write.ir.IntType(32)
    place = write.vector(whole, gx.value.type.count)
    size, dot, axis = (write.variable(type_) for type_ in (gx.value.type, gx.value.type, place))
    builder.store(gx.like(-1.0).value, size)
    builder.store(gx.like(0.0).value, dot)
    builder.store(write.zeros(place), axis)
    with cgutils.for_range(builder, axes) as loop:
        here = gx * number(3, loop.index) + gy * number(3, write.add(loop.index, axes))
        most = Lanes(write, builder.load(size))
        better = most.compare("<", here.abs())
        builder.store(better.where(here.abs(), most).value, size)
        builder.store(better.where(here, Lanes(write, builder.load(dot))).value, dot)
        this = write.splat(builder.trunc(loop.index, whole), place.count)
        builder.store(builder.select(better.value, this, builder.load(axis)), axis)
    back = Lanes(write, builder.load(dot)).compare("<", 0.0)
    beyond = write.splat(builder.trunc(opposite, whole), place.count)
    return m, builder.add(builder.load(axis), builder.select(back.value, beyond, write.zeros(place)))


@instruction
def nearest_votes(
    _: Any, gx: Any, gy: Any, numbers: Any, directions: Any, axes: Any, opposite: Any, m: Any, bins: Any
) -> Any:
    """Hard votes for the largest |dot product| with ``directions`` (all cosines, all sines), the first on ties.

    ``opposite`` is how much further a bin is where the product is negative; ``numbers`` as of :func:`linear_votes`.
    """
    from numba.core import types

    signature = types.void(gx, gy, numbers, directions, axes, opposite, m, bins)
    return signature, partial(_along, vote=_nearest, written=2)


def _begun(write: Builder, gx: Lanes, gy: Lanes, number: Callable[..., Lanes], signed: bool) -> tuple[Any, ...]:
    from numba.core import cgutils

    builder, (count, before) = write.builder, write.arguments[4:6]
    m = _magnitude(gx, gy, number(2, 0))
    v = number(2, 1) * gy
    whole = write.ir.IntType(32)
    place = write.vector(whole, gx.value.type.count)
    back = v.compare("<", 0.0) | (v.compare("==", 0.0) & gx.compare("<", 0.0))
    us, vs = back.where(-gx, gx), back.where(-v, v)
    bins = write.variable(place)
    builder.store(write.splat(builder.trunc(before, whole), place.count), bins)
    one = write.ir.Constant(place, [1] * place.count)
    with cgutils.for_range(builder, count) as loop:
        cos, sin = number(3, loop.index), number(3, write.add(loop.index, count))
        across = vs * cos - us * sin
        begun = across.compare(">=", 0.0)
        if signed:  # the first half turn of bins has begun for all gradients in the second, the second for no other
            early = number(3, write.add(loop.index, write.times(count, 2))).compare(">", 0.0)
            begun = back.where(across.compare("<=", 0.0), begun)
            begun = early.where(begun | back, begun & back)
        found = builder.load(bins)
        builder.store(builder.select(begun.value, builder.add(found, one), found), bins)
    found, all_ = builder.load(bins), write.splat(builder.trunc(count, whole), place.count)
    for _ in range(2):
        over = builder.icmp_signed(">=", found, all_)
        found = builder.select(over, builder.sub(found, all_), found)
    return m, found


@instruction
def begun_votes(_: Any, gx: Any, gy: Any, numbers: Any, starts: Any, count: Any, before: Any, m: Any, bins: Any) -> Any:
    """Hard votes for the last bin at or before whose beginning the gradient points, or the opposite direction.

    ``starts`` (3 · count): cos and sin of where bins begin, sorted, and whether that is in the first half turn.  Before
    the first of them is the bin ``before``.  Multiples of 45° are exact; gradients that close to another beginning that
    only rounding tells on which side do not occur in 8-bit images.
    """
    from numba.core import types

    signature = types.void(gx, gy, numbers, starts, count, before, m, bins)
    return signature, partial(_along, vote=partial(_begun, signed=False), written=2)


@instruction
def begun_signed_votes(
    _: Any, gx: Any, gy: Any, numbers: Any, starts: Any, count: Any, before: Any, m: Any, bins: Any
) -> Any:
    """The same of the direction itself."""
    from numba.core import types

    signature = types.void(gx, gy, numbers, starts, count, before, m, bins)
    return signature, partial(_along, vote=partial(_begun, signed=True), written=2)
