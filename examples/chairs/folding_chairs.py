"""Folding chairs: legs that cross at the sides, or, with seat and back of canvas, in front and behind.

Lengths in centimetres; z up, the front looks to -y, the floor is z = 0.
"""

from __future__ import annotations

import numpy as np
from solids import Floats, Generator, Parts, Solid, bar, outline, rounded, sheet, slab, tube


def folding(generator: Generator) -> Parts:
    """A folding chair of wood or tube, or a director's chair."""
    return _director(generator) if generator.random() < 0.3 else _crossed(generator)


def _crossed(generator: Generator) -> Parts:
    """Legs that cross below the seat, seen from the side: the front ones go on as the posts of the back."""
    width, depth, top = generator.uniform(40, 47), generator.uniform(36, 42), generator.uniform(43, 47)
    high, wooden = generator.uniform(76, 88), generator.random() < 0.5
    size, sides = (generator.uniform(2.4, 3.4), 4) if wooden else (generator.uniform(1.8, 2.4), 10)
    x = width / 2
    long = _long_leg(depth, top, high, generator)
    short = np.array([[depth / 2 + generator.uniform(4, 9), 0], [-depth / 2 + 2, top - 2.5]])
    frame: list[Solid] = []
    for side in (-1, 1):
        frame.append(tube(_in_plane(side * x, long), size, sides=sides))
        frame.append(tube(_in_plane(side * (x - size - 0.3), short), size, sides=sides))
        ends = np.array([[-depth / 2 + 1, top - 1.5], [depth / 2 - 1, top - 1.5]])
        frame.append(tube(_in_plane(side * (x - 0.5 * size), ends), size * 0.8, sides=sides))

    def across(path: Floats, z: float, half: float, thickness: float) -> Solid:
        y = np.interp(z, path[:, 1], path[:, 0])
        return bar((-half, y, z), (half, y, z), thickness, sides=sides)

    low = generator.uniform(8, 14)
    frame.append(across(long, low, x, size * 0.8))
    frame.append(across(short, generator.uniform(6, 12), x - size, size * 0.8))
    if not wooden:
        frame.append(across(long, high - size / 2, x, size))
    return frame, [*_seat(width - 1, depth, top, generator), *_back(long, x, high, generator)]


def _long_leg(depth: float, top: float, high: float, generator: Generator) -> Floats:
    """(K, 2): y and z of the leg from the front foot, below the seat's rear, up to the top of the back."""
    foot, rear, lean = -depth / 2 - generator.uniform(2, 6), depth / 2 - 6, generator.uniform(5, 12)
    corners = [(0, foot, 0), (0, rear, top + 2), (0, rear + lean, high)]
    return rounded(corners, generator.uniform(6, 14), steps=6)[:, 1:]


def _in_plane(x: float, path: Floats) -> Floats:
    """(K, 3): points of y and z in the plane of that x."""
    return np.column_stack([np.full(len(path), x), path])


def _seat(width: float, depth: float, top: float, generator: Generator) -> list[Solid]:
    """A board, a thin cushion, or slats from side to side."""
    style = generator.choice(["board", "cushion", "slats"])
    if style == "slats":
        count = int(generator.integers(5, 9))
        step = depth / count
        at = -depth / 2 + step * (np.arange(count) + 0.5)
        return [bar((-width / 2, y, top - 0.6), (width / 2, y, top - 0.6), (0.75 * step, 1.4)) for y in at]
    shape = outline(width, depth, roundness=generator.uniform(0.05, 0.3))
    levels = [(top - 2, 0.97), (top - 1.4, 1), (top - 0.4, 1), (top, 0.98)]
    if style == "cushion":
        levels += [(top + 1.5, 0.93), (top + 2.4, 0.75)]
    return [slab(shape, levels)]


def _back(long: Floats, x: float, high: float, generator: Generator) -> list[Solid]:
    """One panel between the posts, or two or three slats."""
    count = int(generator.choice([1, 1, 2, 3]))
    reach = generator.uniform(12, 22) if count == 1 else generator.uniform(4, 6)
    step = reach + generator.uniform(2.5, 4)
    u, bulge = np.linspace(-1, 1, 9), generator.uniform(0, 3)
    parts = []
    for number in range(count):
        z = np.linspace(high - 1 - number * step - reach, high - 1 - number * step, 4)[:, None]
        y = np.interp(z, long[:, 1], long[:, 0]) + bulge * (1 - u**2)
        parts.append(sheet(np.stack(np.broadcast_arrays((x - 0.5) * u, y, z), axis=-1), 1.4))
    return parts


def _director(generator: Generator) -> Parts:
    """Legs that cross in front and behind, and canvas between them."""
    width, depth, top = generator.uniform(50, 58), generator.uniform(38, 44), generator.uniform(42, 47)
    arm, high = top + generator.uniform(17, 21), generator.uniform(80, 90)
    x, y, size = width / 2, depth / 2 - 3, generator.uniform(2.2, 3)
    frame: list[Solid] = []
    for side in (-x, x):
        frame.append(bar((side, -y - 4, 1.5), (side, y + 4, 1.5), (3, 3)))
        frame.append(bar((side, -y - 2, top), (side, y + 2, top), (3, 3)))
        frame.append(bar((side, -y - 5, arm), (side, y - 1, arm), (5.5, 1.8)))
        frame.append(bar((side, -y + 2, top), (side, -y + 2, arm), size))
        frame.append(bar((side, y, top), (side, y + 2, high), size))
    for k, depth_at in enumerate((-y, y)):
        for side in (-1, 1):
            shift = 0.7 * size * side * (-1) ** k  # one bar of a cross passes before the other
            frame.append(bar((-side * x, depth_at + shift, 2), (side * x, depth_at + shift, top), size * 0.9))
    u, v = np.linspace(-1, 1, 11), np.linspace(-1, 1, 5)[:, None]
    sag = generator.uniform(1.5, 4)
    seat = np.stack(np.broadcast_arrays(x * u, (y + 2) * v, top + 1.5 - sag * (1 - u**2)), axis=-1)
    middle = high - generator.uniform(8, 9)
    hollow = y + 1 + generator.uniform(2, 5) * (1 - u**2)
    back = np.stack(np.broadcast_arrays(x * u, hollow, middle + 8 * v), axis=-1)
    return frame, [sheet(seat, 0.8), sheet(back, 0.8)]
