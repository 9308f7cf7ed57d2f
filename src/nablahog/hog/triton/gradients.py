"""Eq. 1-2 in Triton: stored pixels to gradients of a tile, and the vjp from gradients back to pixels.

A tile is of one image: rows ``y`` and columns ``x`` that broadcast.  ``size`` is (height, width), ``strides`` (channel,
row, column), in elements.
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
def places(pixels, y, x, strides, READING: tl.constexpr):
    """Where pixels of the first channel are in memory."""
    if READING.wide:
        y, x = y.to(tl.int64), x.to(tl.int64)
    return pixels + y * strides[1] + x * strides[2]


@triton.jit
def _channel_places(at, strides, channel: tl.constexpr):
    for _ in tl.static_range(channel):  # not a product: it is made of 32 bits
        at += strides[0]
    return at


@triton.jit
def _channel(at, strides, channel: tl.constexpr, READING: tl.constexpr, REAL: tl.constexpr):
    """Values of one channel in 0…``value_range``, or their roots."""
    value = tl.load(_channel_places(at, strides, channel)).to(REAL)
    if READING.scale != 1:
        value = value * READING.scale
    if READING.sqrt:
        dark = value <= _BLACK
        value = tl.where(dark, 0.0 * value, root(tl.where(dark, 1.0, value)))  # NaN of -∞
    return value


@triton.jit
def value(at, strides, channel: tl.constexpr, READING: tl.constexpr, REAL: tl.constexpr):
    """Values of one channel, or the average of all, added in the reference's order, so that flat areas stay flat."""
    stored: tl.constexpr = READING.stored
    if READING.averaged:
        total = READING.weights[0] * _channel(at, strides, 0, READING, REAL)
        for k in tl.static_range(1, stored):
            total = total + READING.weights[k] * _channel(at, strides, k, READING, REAL)
    else:
        total = _channel(at, strides, channel, READING, REAL)
    return total


@triton.jit
def _edge_factor(place, count, READING: tl.constexpr, REAL: tl.constexpr):
    """How often a difference along an axis of ``count`` pixels counts at each ``place``: once, but at the border."""
    times = tl.where(count > 1, READING.border_factor, 0.0).to(REAL)
    return tl.where((place == 0) | (place == count - 1), times, 1.0)


@triton.jit
def neighbour(place, count, READING: tl.constexpr):
    """Where a neighbour of a pixel is read: beyond the border at the nearest pixel, or as in a mirrored image."""
    if READING.border_factor == 0:
        place = tl.where(place < 0, -place, tl.where(place >= count, 2 * count - 2 - place, place))
    return tl.minimum(tl.maximum(place, 0), count - 1)


@triton.jit
def _difference(before, after, place, count, READING: tl.constexpr, REAL: tl.constexpr, BEYOND: tl.constexpr):
    """The mask [-1, 0, 1] along one axis, of values at each :func:`neighbour`, or ``BEYOND`` beyond the border."""
    if READING.border_factor != 0 and not READING.border_is_own:
        before = tl.where(place == 0, BEYOND, before)
        after = tl.where(place == count - 1, BEYOND, after)
    change = after - before  # 0 at the border of a mirrored image
    if READING.border_factor > 1:
        change = _edge_factor(place, count, READING, REAL) * change
    return change


@triton.jit
def _gradient(around, y, x, size, READING: tl.constexpr, REAL: tl.constexpr, BEYOND: tl.constexpr):
    """Gx and Gy of values (3 x 3 tiles, rows from above: of the neighbours)."""
    height, width = size[0], size[1]
    gx = _difference(around[3], around[5], x, width, READING, REAL, BEYOND)
    gy = _difference(around[1], around[7], y, height, READING, REAL, BEYOND)
    if READING.sobel:  # [1, 2, 1] along the other axis, mirrored at the outermost pixels
        above = _difference(around[0], around[2], x, width, READING, REAL, BEYOND)
        below = _difference(around[6], around[8], x, width, READING, REAL, BEYOND)
        left = _difference(around[0], around[6], y, height, READING, REAL, BEYOND)
        right = _difference(around[2], around[8], y, height, READING, REAL, BEYOND)
        if READING.border_factor != 0:  # or neighbours are mirrored already
            above, below = tl.where(y == 0, below, above), tl.where(y == height - 1, above, below)
            left, right = tl.where(x == 0, right, left), tl.where(x == width - 1, left, right)
        gx, gy = above + 2 * gx + below, left + 2 * gy + right
    return gx, gy


@triton.jit
def gradients(arounds, y, x, size, last_wins, READING: tl.constexpr, REAL: tl.constexpr):
    """Gx, Gy of Eq. 2, of the channel of largest magnitude, and which it is.

    ``arounds`` has 3 x 3 tiles of values of each channel, of each :func:`neighbour` of the pixels, rows from above; the
    corners count with Sobel's mask only.  Of channels of equal magnitude the first counts, but the last in
    columns ``last_wins`` (first, after the last).
    """
    gx, gy = _gradient(arounds[0], y, x, size, READING, REAL, READING.border_value)
    winner = tl.zeros_like(gx).to(tl.int32)
    if READING.channels > 1:
        described: tl.constexpr = READING.channels
        last = (x >= last_wins[0]) & (x < last_wins[1])
        largest = gx * gx + gy * gy
        for k in tl.static_range(1, described):
            u, v = _gradient(arounds[k], y, x, size, READING, REAL, READING.border_value)
            squared = u * u + v * v
            better = (squared > largest) | (last & (squared == largest))
            gx, gy = tl.where(better, u, gx), tl.where(better, v, gy)
            largest, winner = tl.where(better, squared, largest), tl.where(better, k, winner)
    return gx, gy, winner


@triton.jit
def around(pixels, y, x, size, strides, READING: tl.constexpr, REAL: tl.constexpr):
    """The neighbours of a tile of pixels for :func:`gradients`; beyond the image, those of the nearest pixel inside."""
    described: tl.constexpr = READING.channels
    y, x = tl.minimum(tl.maximum(y, 0), size[0] - 1), tl.minimum(tl.maximum(x, 0), size[1] - 1)
    unread = tl.zeros((y + x).shape, REAL)
    arounds = ()
    for k in tl.static_range(described):
        values = ()
        for place in tl.static_range(9):
            if place % 2 == 1 or (READING.sobel and place != 4):
                beside_y = neighbour(y + (place // 3 - 1), size[0], READING)
                beside_x = neighbour(x + (place % 3 - 1), size[1], READING)
                at = places(pixels, beside_y, beside_x, strides, READING)
                values = values + (value(at, strides, k, READING, REAL),)
            else:
                values = values + (unread,)
        arounds = arounds + (values,)
    return arounds


@triton.jit
def _shifted(tile, SHIFT: tl.constexpr, AXIS: tl.constexpr):
    """The value ``SHIFT`` further along an axis, for each place but the outermost of the tile."""
    count: tl.constexpr = tile.shape[AXIS]
    place = tl.minimum(tl.maximum(tl.arange(0, count) + SHIFT, 0), count - 1)
    index = place[:, None] if AXIS == 0 else place[None, :]
    return tl.gather(tile, tl.broadcast_to(index, tile.shape), AXIS)


@triton.jit
def _difference_vjp(grad, place, count, AXIS: tl.constexpr, READING: tl.constexpr):
    """Gradient of the values from that of the differences along an axis, each times its factor at the border."""
    to = _shifted(grad, -1, AXIS) - _shifted(grad, 1, AXIS)
    if READING.border_factor != 0 and READING.border_is_own:  # the value beyond is the outermost pixel's own
        to = to - tl.where(place == 0, grad, 0.0) + tl.where(place == count - 1, grad, 0.0)
    return to


@triton.jit
def _smoothed_vjp(grad, place, count, AXIS: tl.constexpr):
    """The vjp of [1, 2, 1] along an axis of a mirrored image: outermost pixels have one neighbour twice."""
    weight_before, weight_after = tl.where(place == 1, 2, 1), tl.where(place == count - 2, 2, 1)
    own = tl.where(count == 1, 4, 2)
    return own * grad + weight_before * _shifted(grad, -1, AXIS) + weight_after * _shifted(grad, 1, AXIS)


@triton.jit
def values_vjp(grad_x, grad_y, y, x, size, READING: tl.constexpr, REAL: tl.constexpr):
    """Gradients of values from those of Gx and Gy, which are 0 beyond the image; but at the rim of the tile."""
    height, width = size[0], size[1]
    grad_dx, grad_dy = _edge_factor(x, width, READING, REAL) * grad_x, _edge_factor(y, height, READING, REAL) * grad_y
    if READING.sobel:
        # the border's factor belongs to the difference, which is smoothed later along the other axis
        grad_dx = _edge_factor(x, width, READING, REAL) * _smoothed_vjp(grad_x, y, height, 0)
        grad_dy = _edge_factor(y, height, READING, REAL) * _smoothed_vjp(grad_y, x, width, 1)
    return _difference_vjp(grad_dx, x, width, 1, READING) + _difference_vjp(grad_dy, y, height, 0, READING)


@triton.jit
def pixels_vjp(grad, at, strides, channel: tl.constexpr, READING: tl.constexpr, REAL: tl.constexpr):
    """Gradients of stored pixels of a channel from those of the values that were made from them."""
    slope: tl.constexpr = READING.weights[channel] * READING.scale
    if READING.sqrt:
        root_value = _channel(at, strides, channel, READING, REAL)
        dark = root_value == 0
        grad = tl.where(dark, 0.0, quotient(grad, 2 * tl.where(dark, 1.0, root_value)))
    return grad * slope
