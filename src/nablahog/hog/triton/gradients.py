"""Eq. 1-2 in Triton: stored pixels to gradients of a tile, and the vjp from gradients back to pixels.

A tile is rows ``y`` (n, 1) and columns ``x`` (1, m) of one image.  The image is where its first pixel is, ``pixels``;
``size`` is (height, width), ``strides`` (channel, row, column), in elements.
"""

from __future__ import annotations

import triton
import triton.language as tl

from ..gradient import BLACK

_BLACK = tl.constexpr(BLACK)


@triton.jit
def root(x):
    """√, rounded to the nearest number, as in PyTorch: ties of hard votes depend on it."""
    y = tl.sqrt(x) if x.dtype == tl.float64 else tl.sqrt_rn(x)
    return y


@triton.jit
def quotient(a, b):
    """a / b, rounded to the nearest number."""
    q = a / b if a.dtype == tl.float64 else tl.div_rn(a, b)
    return q


@triton.jit
def _offset(y, x, strides, channel: tl.constexpr, READING: tl.constexpr):
    """Of pixels from the first of their image, in elements."""
    if READING.wide:
        y, x = y.to(tl.int64), x.to(tl.int64)
    offset = y * strides[1] + x * strides[2]
    for _ in tl.static_range(channel):  # not a product: it is made of 32 bits
        offset += strides[0]
    return offset


@triton.jit
def _channel(pixels, y, x, inside, strides, channel: tl.constexpr, READING: tl.constexpr, REAL: tl.constexpr):
    """Values of one channel in 0…``value_range``, or their roots."""
    value = tl.load(pixels + _offset(y, x, strides, channel, READING), mask=inside, other=0).to(REAL)
    if READING.scale != 1:
        value = value * READING.scale
    if READING.sqrt:
        dark = value <= _BLACK
        value = tl.where(dark, 0.0, root(tl.where(dark, 1.0, value)))
    return value


@triton.jit
def _value(pixels, y, x, inside, strides, channel: tl.constexpr, READING: tl.constexpr, REAL: tl.constexpr):
    """Of one channel, or the average of all: added in the order of the reference, so that a flat area stays flat."""
    stored: tl.constexpr = READING.stored
    if READING.averaged:
        value = READING.weights[0] * _channel(pixels, y, x, inside, strides, 0, READING, REAL)
        for k in tl.static_range(1, stored):
            value = value + READING.weights[k] * _channel(pixels, y, x, inside, strides, k, READING, REAL)
    else:
        value = _channel(pixels, y, x, inside, strides, channel, READING, REAL)
    return value


@triton.jit
def _edge_factor(place, count, READING: tl.constexpr, REAL: tl.constexpr):
    """How often a difference along an axis of ``count`` pixels counts at each ``place``: once, but at the border."""
    times = tl.where(count > 1, READING.border_factor, 0.0).to(REAL)
    return tl.where((place == 0) | (place == count - 1), times, 1.0)


@triton.jit
def _difference(before, after, place, count, READING: tl.constexpr, REAL: tl.constexpr):
    """The mask [-1, 0, 1] along one axis, of neighbours that are clamped to the image."""
    if READING.border_factor != 0 and not READING.border_is_own:
        before = tl.where(place == 0, READING.border_value, before)
        after = tl.where(place == count - 1, READING.border_value, after)
    change = after - before
    edge = (place == 0) | (place == count - 1)
    if READING.border_factor == 0:
        change = tl.where(edge, 0.0, change)
    else:
        change = tl.where(edge, _edge_factor(place, count, READING, REAL) * change, change)
    return change


@triton.jit
def _along_x(pixels, y, x, inside, size, strides, channel: tl.constexpr, READING: tl.constexpr, REAL: tl.constexpr):
    width = size[1]
    before, after = tl.maximum(x - 1, 0), tl.minimum(x + 1, width - 1)
    left = _value(pixels, y, before, inside, strides, channel, READING, REAL)
    right = _value(pixels, y, after, inside, strides, channel, READING, REAL)
    return _difference(left, right, x, width, READING, REAL)


@triton.jit
def _along_y(pixels, y, x, inside, size, strides, channel: tl.constexpr, READING: tl.constexpr, REAL: tl.constexpr):
    height = size[0]
    before, after = tl.maximum(y - 1, 0), tl.minimum(y + 1, height - 1)
    up = _value(pixels, before, x, inside, strides, channel, READING, REAL)
    down = _value(pixels, after, x, inside, strides, channel, READING, REAL)
    return _difference(up, down, y, height, READING, REAL)


@triton.jit
def _mirrored(place, count):
    """The neighbours of a place, mirrored at the outermost pixels."""
    before = tl.where(place == 0, tl.minimum(1, count - 1), place - 1)
    after = tl.where(place == count - 1, tl.maximum(count - 2, 0), place + 1)
    return before, after


@triton.jit
def _of_channel(pixels, y, x, inside, size, strides, channel: tl.constexpr, READING: tl.constexpr, REAL: tl.constexpr):
    """Gx and Gy of one channel."""
    gx = _along_x(pixels, y, x, inside, size, strides, channel, READING, REAL)
    gy = _along_y(pixels, y, x, inside, size, strides, channel, READING, REAL)
    if READING.sobel:  # [1, 2, 1] along the other axis
        above, below = _mirrored(y, size[0])
        left, right = _mirrored(x, size[1])
        gx = _along_x(pixels, above, x, inside, size, strides, channel, READING, REAL) + 2 * gx
        gx = gx + _along_x(pixels, below, x, inside, size, strides, channel, READING, REAL)
        gy = _along_y(pixels, y, left, inside, size, strides, channel, READING, REAL) + 2 * gy
        gy = gy + _along_y(pixels, y, right, inside, size, strides, channel, READING, REAL)
    return gx, gy


@triton.jit
def gradients(pixels, y, x, inside, size, strides, last_wins, READING: tl.constexpr, REAL: tl.constexpr):
    """Gx, Gy of Eq. 2, of the channel of largest magnitude, and which it is; of pixels not ``inside`` anything.

    Of channels of equal magnitude the first counts, but the last in columns ``last_wins`` (first, after the last).
    """
    described: tl.constexpr = READING.channels
    gx, gy = _of_channel(pixels, y, x, inside, size, strides, 0, READING, REAL)
    winner = tl.zeros_like(gx).to(tl.int32)
    if READING.channels > 1:
        last = (x >= last_wins[0]) & (x < last_wins[1])
        largest = gx * gx + gy * gy
        for k in tl.static_range(1, described):
            u, v = _of_channel(pixels, y, x, inside, size, strides, k, READING, REAL)
            squared = u * u + v * v
            better = (squared > largest) | (last & (squared == largest))
            gx, gy = tl.where(better, u, gx), tl.where(better, v, gy)
            largest, winner = tl.where(better, squared, largest), tl.where(better, k, winner)
    return gx, gy, winner


@triton.jit
def _tangent_value(
    pixels, tangents, y, x, inside, strides, other, channel: tl.constexpr, READING: tl.constexpr, REAL: tl.constexpr
):
    """The tangent of :func:`_channel`; tangents have the strides ``other``."""
    change = tl.load(tangents + _offset(y, x, other, channel, READING), mask=inside, other=0).to(REAL)
    if READING.scale != 1:
        change = change * READING.scale
    if READING.sqrt:
        value = _channel(pixels, y, x, inside, strides, channel, READING, REAL)
        dark = value == 0
        change = tl.where(dark, 0.0, quotient(change, 2 * tl.where(dark, 1.0, value)))
    return change


@triton.jit
def _tangent_along(
    pixels,
    tangents,
    y,
    x,
    inside,
    size,
    strides,
    other,
    channel: tl.constexpr,
    AXIS: tl.constexpr,
    READING: tl.constexpr,
    REAL: tl.constexpr,
):
    """Tangents of the difference along an axis: linear, so that a value beyond the image has the tangent 0."""
    stored: tl.constexpr = READING.stored
    count, place = (size[0], y) if AXIS == 0 else (size[1], x)
    before, after = tl.maximum(place - 1, 0), tl.minimum(place + 1, count - 1)
    change = tl.zeros_like((y + x).to(REAL))
    for k in tl.static_range(stored):
        if READING.averaged or k == channel:
            if AXIS == 0:
                low = _tangent_value(pixels, tangents, before, x, inside, strides, other, k, READING, REAL)
                high = _tangent_value(pixels, tangents, after, x, inside, strides, other, k, READING, REAL)
            else:
                low = _tangent_value(pixels, tangents, y, before, inside, strides, other, k, READING, REAL)
                high = _tangent_value(pixels, tangents, y, after, inside, strides, other, k, READING, REAL)
            if not READING.border_is_own:
                low, high = tl.where(place == 0, 0.0, low), tl.where(place == count - 1, 0.0, high)
            change = change + READING.weights[k] * (high - low)
    return _edge_factor(place, count, READING, REAL) * change


@triton.jit
def gradient_tangents(
    pixels, tangents, y, x, inside, size, strides, other, winner, READING: tl.constexpr, REAL: tl.constexpr
):
    """Tangents of Gx and Gy, of the channel that wins."""
    described: tl.constexpr = READING.channels
    above, below = _mirrored(y, size[0])
    left, right = _mirrored(x, size[1])
    dx = tl.zeros_like((y + x).to(REAL))
    dy = dx
    for k in tl.static_range(described):
        u = _tangent_along(pixels, tangents, y, x, inside, size, strides, other, k, 1, READING, REAL)
        v = _tangent_along(pixels, tangents, y, x, inside, size, strides, other, k, 0, READING, REAL)
        if READING.sobel:
            u = 2 * u + _tangent_along(pixels, tangents, above, x, inside, size, strides, other, k, 1, READING, REAL)
            u = u + _tangent_along(pixels, tangents, below, x, inside, size, strides, other, k, 1, READING, REAL)
            v = 2 * v + _tangent_along(pixels, tangents, y, left, inside, size, strides, other, k, 0, READING, REAL)
            v = v + _tangent_along(pixels, tangents, y, right, inside, size, strides, other, k, 0, READING, REAL)
        dx, dy = tl.where(winner == k, u, dx), tl.where(winner == k, v, dy)
    return dx, dy


@triton.jit
def _shifted(tile, SHIFT: tl.constexpr, AXIS: tl.constexpr):
    """The value ``SHIFT`` further along an axis, for each place but the outermost of the tile."""
    count: tl.constexpr = tile.shape[AXIS]
    place = tl.minimum(tl.maximum(tl.arange(0, count) + SHIFT, 0), count - 1)
    index = place[:, None] if AXIS == 0 else place[None, :]
    return tl.gather(tile, tl.broadcast_to(index, tile.shape), AXIS)


@triton.jit
def _difference_vjp(grad, place, count, AXIS: tl.constexpr, READING: tl.constexpr):
    """Of values, from gradients of the differences along an axis, each times its factor at the border."""
    to = _shifted(grad, -1, AXIS) - _shifted(grad, 1, AXIS)
    if READING.border_factor != 0 and READING.border_is_own:  # the value beyond is the outermost pixel's own
        to = to - tl.where(place == 0, grad, 0.0) + tl.where(place == count - 1, grad, 0.0)
    return to


@triton.jit
def _smoothed_vjp(grad, place, count, AXIS: tl.constexpr):
    """Of [1, 2, 1] along an axis of a mirrored image: the outermost pixels have one neighbour twice."""
    of_before, of_after = tl.where(place == 1, 2, 1), tl.where(place == count - 2, 2, 1)
    own = tl.where(count == 1, 4, 2)
    return own * grad + of_before * _shifted(grad, -1, AXIS) + of_after * _shifted(grad, 1, AXIS)


@triton.jit
def values_vjp(grad_x, grad_y, y, x, size, READING: tl.constexpr, REAL: tl.constexpr):
    """Gradients of values from those of Gx and Gy, which are 0 beyond the image; but at the rim of the tile."""
    height, width = size[0], size[1]
    of_x, of_y = _edge_factor(x, width, READING, REAL) * grad_x, _edge_factor(y, height, READING, REAL) * grad_y
    if READING.sobel:
        # the border's factor belongs to the difference, which is smoothed later along the other axis
        of_x = _edge_factor(x, width, READING, REAL) * _smoothed_vjp(grad_x, y, height, 0)
        of_y = _edge_factor(y, height, READING, REAL) * _smoothed_vjp(grad_y, x, width, 1)
    return _difference_vjp(of_x, x, width, 1, READING) + _difference_vjp(of_y, y, height, 0, READING)


@triton.jit
def pixels_vjp(grad, pixels, y, x, inside, strides, channel: tl.constexpr, READING: tl.constexpr, REAL: tl.constexpr):
    """Gradients of stored pixels of a channel from those of the values that were made from them."""
    slope: tl.constexpr = READING.weights[channel] * READING.scale
    if READING.sqrt:
        value = _channel(pixels, y, x, inside, strides, channel, READING, REAL)  # the root
        dark = value == 0
        grad = tl.where(dark, 0.0, quotient(grad, 2 * tl.where(dark, 1.0, value)))
    return grad * slope
