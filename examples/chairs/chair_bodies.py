"""Seats and arms of procedural chairs, and chairs of one piece: shells, tubs, upholstered and panelled ones.

Lengths in centimetres; z up, the front looks to -y, the floor is z = 0.
"""

from __future__ import annotations

import numpy as np
from chair_backs import Back, across
from solids import Floats, Generator, Solid, bar, loft, outline, rounded, section, sheet, slab, tube


def seat(width: float, depth: float, top: float, roundness: float, taper: float, generator: Generator) -> list[Solid]:
    """A board, a cushion, or a cushion on a board; ``top`` is the height of its upper side."""
    shape = outline(width, depth, roundness=roundness, taper=taper)
    kind = generator.choice(["board", "cushion", "both"])
    thick = generator.uniform(4, 9)
    if kind == "board":
        thin = generator.uniform(1.8, 4.5)
        return [slab(shape, [(top - thin, 0.96), (top - 0.6 * thin, 1), (top - 0.4, 1), (top, 0.98)])]
    profile = [(0, 0.93), (0.25, 1), (0.6, 1), (0.85, 0.96), (0.98, 0.85), (1.06, 0.55), (1.1, 0.2)]
    cushion = slab(shape, [(top - thick + thick * up, share) for up, share in profile])
    if kind == "cushion":
        return [cushion]
    return [cushion, slab(shape, [(top - thick - 2, 1.0), (top - thick + 0.5, 1.0)])]


def apron(tops: Floats, height: float, generator: Generator) -> list[Solid]:
    """Boards on edge below the seat, from leg to leg."""
    high = generator.uniform(4, 8)
    ends = np.column_stack([tops, np.full(4, height - high / 2)])
    return [tube(ends[[a, b]], [(2, high)], sides=4) for a, b in ((0, 1), (1, 2), (2, 3), (3, 0))]


def arms(back: Back, width: float, depth: float, top: float, kind: str, generator: Generator) -> list[Solid]:
    """Two arms beside a seat of the given width, depth and height: posts with pads, bent loops, or T-shaped ones."""
    above, front = generator.uniform(17, 25), -depth / 2 + generator.uniform(3, 14)
    wide, thick = generator.uniform(3, 6), generator.uniform(1.8, 3.2)
    result = []
    for side in (-1, 1):
        behind = back.at(side * (1 - 2 / back.width), min(above, 0.9 * back.height))
        x = side * (width / 2 + generator.uniform(0, 2))
        if kind == "loop":
            path = [tuple(behind), (x, front, top + above), (x, front + 3, top - 3)]
            result.append(tube(rounded(path, 10), thick))
        elif kind == "posts":
            ahead = np.array([x, front - 3, top + above])
            result.append(bar(behind, ahead, (wide * 0.7, thick), (wide, thick)))
            result.append(bar((x, front, top - 3), (x, front, top + above), thick))
        else:
            x = side * (width / 2 + 3)
            under = [(0, 2, top - 7), (x, 2, top - 7), (x, 2, top + above)]
            result.append(tube(rounded(under, 5), [(4, 2)], sides=4))
            result.append(bar((x, -0.35 * depth, top + above), (x, 0.2 * depth, top + above), (6, 2.5)))
    return result


def shell(width: float, depth: float, top: float, generator: Generator) -> list[Solid]:
    """Seat and back of one bent sheet, its sides curled upwards and forwards."""
    height, tilt = generator.uniform(28, 48), generator.uniform(0.15, 0.4)
    seat_end, fillet = depth / 2 - 4, generator.uniform(8, 14)
    lip = generator.uniform(0, 3)
    corners = [(0, -depth / 2, top - lip), (0, -depth / 2 + 6, top), (0, seat_end, top - 2)]
    corners.append((0, seat_end + np.sin(tilt) * height, top - 2 + np.cos(tilt) * height))
    path = rounded(corners, fillet, steps=7)
    path = np.stack([np.interp(np.linspace(0, 1, 22), _share(path), path[:, k]) for k in range(3)], axis=1)
    t = np.linspace(0, 1, len(path))[:, None]
    waist, upper, ending = generator.uniform(0.8, 1), generator.uniform(0.75, 1.05), generator.uniform(0.3, 0.95)
    share = np.interp(t, [0, 0.05, 0.2, 0.5, 0.8, 0.95, 1], [0.85, 0.95, 1, waist, upper, (upper + ending) / 2, ending])
    u = np.linspace(-1, 1, 15)
    curl = generator.uniform(1, 5) + generator.choice([0, generator.uniform(6, 16)]) * np.exp(-(((t - 0.5) / 0.3) ** 2))
    tangent = np.gradient(path, axis=0)
    normal = np.stack([0 * tangent[:, 0], -tangent[:, 2], tangent[:, 1]], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    surface = path[:, None] + (curl * np.abs(u) ** 2.5)[..., None] * normal[:, None]
    surface[..., 0] = width / 2 * share * u
    return [sheet(surface, generator.uniform(0.8, 1.6))]


def _share(path: Floats) -> Floats:
    """How far along a path its points are, from 0 to 1."""
    steps = np.concatenate([[0], np.linalg.norm(np.diff(path, axis=0), axis=1)])
    far: Floats = np.cumsum(steps) / steps.sum()
    return far


def club(width: float, depth: float, top: float, floor: float, generator: Generator) -> list[Solid]:
    """Upholstery all around: a block, a thick cushion, thick arms, a thick back; it begins at the height ``floor``."""
    arm, above, roll = generator.uniform(8, 20), generator.uniform(10, 24), generator.random() < 0.5
    inner, cushion = width - 2 * arm, generator.uniform(10, 15)
    block = outline(width - 2, depth - 2, roundness=0.05)
    parts = [slab(block, [(floor, 1), (top - cushion, 1)])]
    shape = outline(inner + 1, depth - 4, roundness=0.2)
    levels = [(-1, 0.9), (-0.8, 1), (-0.25, 1), (-0.05, 0.93), (0.03, 0.6), (0.05, 0.2)]
    parts.append(slab(shape, [(top + cushion * up, share) for up, share in levels]))
    for side in (-1, 1):
        x = side * (width - arm) / 2
        ring = outline(arm, top + above - floor, roundness=generator.uniform(0.05, 0.35), corners=20)
        ends = np.array([(-depth / 2, 0.94), (-depth / 2 + 1.5, 1), (depth / 2 - 1.5, 1), (depth / 2, 0.94)])
        parts.append(_along_y(ring, x, (floor + top + above) / 2, ends))
        if roll:
            parts.append(_along_y(section(14) * arm * 1.25, x, top + above - arm * 0.4, ends))
    back = Back(
        width - generator.choice([0, 2 * arm]), generator.uniform(30, 55), depth / 2 - 7, top - 12, *_lean(generator)
    )
    rows, columns = 9, 15
    s, t = across(columns), np.linspace(0, 1, rows)
    edge = np.maximum(np.abs(s), 2 * t[:, None] - 1)
    thickness = generator.uniform(12, 18) * (1 - 0.35 * edge**12)
    high = back.height + 12 - generator.uniform(0, 8) * np.abs(s) ** 3
    return [*parts, back.board((-1, 1), (floor - back.z, high), thickness, rows=rows, columns=columns)]


def _lean(generator: Generator) -> tuple[float, float, float, float]:
    return generator.uniform(0.08, 0.25), generator.uniform(0, 4), generator.uniform(0, 4), 0.0


def _along_y(ring: Floats, x: float, z: float, ends: Floats) -> Solid:
    """A bar along y of the section ``ring`` (N, 2), given its share of that size at each y."""
    rings = [
        np.stack([x + share * ring[:, 0], np.full(len(ring), y), z + share * ring[:, 1]], axis=-1) for y, share in ends
    ]
    return loft(np.array(rings))


def panelled(width: float, depth: float, top: float, generator: Generator) -> list[Solid]:
    """Two boards from the floor up to the arms, which carry a seat and a back between them."""
    thick, above, x = generator.uniform(2, 4), generator.uniform(14, 24), width / 2
    hollow = generator.random() < 0.5
    parts = []
    for side in (-x, x):
        high, y = top + above, depth / 2
        if hollow:  # a frame instead of a board
            corners = np.array([(side, -y, thick / 2), (side, y, thick / 2), (side, y, high), (side, -y, high)])
            for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
                parts.append(bar(a, b, (thick, 5)))
        else:
            ring = np.array([(-y, 0), (y, 0), (y, high), (-y, high)])
            rings = [np.column_stack([np.full(4, side + shift), ring]) for shift in (-thick / 2, thick / 2)]
            parts.append(loft(np.array(rings)))
    under = bar((-x, 0, top - 5), (x, 0, top - 5), (depth * 0.8, 3))
    return [*parts, under]


def tub(width: float, depth: float, top: float, floor: float, generator: Generator) -> list[Solid]:
    """A wall around a round seat, from low arms in front to a high back."""
    thick, arm, high = generator.uniform(4, 9), generator.uniform(10, 20), generator.uniform(26, 42)
    angle = np.linspace(-0.72 * np.pi, 0.72 * np.pi, 33)  # 0 is behind
    power = generator.uniform(1, 3)
    rise = arm + (high - arm) * ((1 + np.cos(angle * np.clip(np.pi / angle[-1], 0, 2))) / 2) ** power
    square = generator.uniform(0.5, 1)
    x, y = (
        np.sign(f) * np.abs(f) ** square * half for f, half in ((np.sin(angle), width / 2), (np.cos(angle), depth / 2))
    )
    t = np.linspace(0, 1, 7)[:, None]
    flare = 1 + generator.uniform(0, 0.15) * t
    z = floor + t * (top + rise - floor)
    surface = np.stack([x * flare, y * flare, z], axis=-1)
    wall = sheet(surface, thick * (1 - 0.5 * t**8) * np.ones(len(angle)))
    shape = outline(width - thick, depth - thick, roundness=0.8)
    levels = [(floor, 0.95), (top - 10, 1), (top - 3, 1), (top, 0.93), (top + 1, 0.5)]
    return [wall, slab(shape, levels)]
