"""Stools, round or square, and benches.

Lengths in centimetres; z up, the front looks to -y, the floor is z = 0.
"""

from __future__ import annotations

import chair_legs
import numpy as np
from chair_backs import Back, ladder, slats, solid
from solids import Generator, Parts, Solid, bar, loft, outline, slab, tube


def stool(generator: Generator) -> Parts:
    """A seat without a back, from 42 cm to the 78 cm of a bar stool: on legs with a ring or rails, or on one column."""
    top = generator.choice([generator.uniform(42, 50), generator.uniform(60, 68), generator.uniform(72, 78)])
    round_ = generator.random() < 0.55
    side = generator.uniform(30, 38)
    depth = side if round_ else side * generator.uniform(0.85, 1)
    cover = _seat(side, depth, top, 1.0 if round_ else generator.uniform(0.05, 0.25), generator)
    if generator.random() < 0.25:
        return [*chair_legs.pedestal(top - 3, generator), *_foot_ring(top, generator)], cover
    count = 3 if round_ and generator.random() < 0.3 else 4
    size, spread = generator.uniform(2.4, 3.6), generator.uniform(0, 0.09) * top
    sides = 10 if round_ or generator.random() < 0.3 else 4
    inner = 0.5 * side - (5 if round_ else 2.5)
    angles = 2 * np.pi * (np.arange(count) + 0.5) / count - (0 if count == 4 else np.pi / 2)
    ways = np.column_stack([np.cos(angles), np.sin(angles)]) * (1 if round_ else np.sqrt(2))
    tops = np.column_stack([inner * ways, np.full(count, top - 2)])
    feet = np.column_stack([(inner + spread) * ways, np.zeros(count)])
    frame = [bar(a, b, size, size * 0.8, sides=sides) for a, b in zip(tops, feet, strict=True)]
    for low in [0.25, 0.55][: int(generator.integers(1, 3))]:
        at = (1 - low) * feet + low * tops
        if round_ and generator.random() < 0.5:
            frame.append(_ring(float(np.linalg.norm(at[0, :2])), at[0, 2], 1.6))
        else:
            frame += [bar(a, b, size * 0.6, sides=sides) for a, b in zip(at, np.roll(at, -1, axis=0), strict=True)]
    return frame, cover


def _seat(width: float, depth: float, top: float, roundness: float, generator: Generator) -> list[Solid]:
    """A board or a thick cushion on one."""
    shape = outline(width, depth, roundness=roundness)
    if generator.random() < 0.5:
        return [slab(shape, [(top - 3.5, 0.94), (top - 2.5, 1), (top - 0.6, 1), (top, 0.96)])]
    thick = generator.uniform(5, 9)
    profile = [(0, 0.95), (0.2, 1), (0.65, 1), (0.88, 0.95), (1, 0.8), (1.04, 0.5)]
    board = slab(shape, [(top - thick - 2, 0.9), (top - thick + 0.3, 0.9)])
    return [board, slab(shape, [(top - thick + thick * up, share) for up, share in profile])]


def _ring(radius: float, z: float, size: float) -> Solid:
    angle = 2 * np.pi * np.arange(28) / 28
    return tube(
        np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(28, z)]), size, sides=8, closed=True
    )


def _foot_ring(top: float, generator: Generator) -> list[Solid]:
    """The ring around a high column on which feet rest, and its spokes."""
    if top < 55:
        return []
    z, radius = generator.uniform(0.35, 0.45) * top, generator.uniform(15, 19)
    spokes = [bar((0, 0, z), (radius * np.cos(a), radius * np.sin(a), z), 1.5, sides=6) for a in np.arange(3) * 2.1]
    return [_ring(radius, z, 1.9), *spokes]


def bench(generator: Generator) -> Parts:
    """A seat for two or three, with a back and arms, a back alone, or neither."""
    width, depth, top = generator.uniform(105, 175), generator.uniform(36, 48), generator.uniform(42, 47)
    style = generator.choice(["plain", "back", "arms"], p=[0.35, 0.3, 0.35])
    cover = _bench_seat(width, depth, top, generator)
    frame = _bench_legs(width, depth, top, generator, plain=style == "plain")
    if style == "plain":
        return frame, cover
    back = Back(width - 4, generator.uniform(36, 48), depth / 2 - 2, top - 1, generator.uniform(0.08, 0.28), 0, 2, 0)
    kind = (slats, ladder, solid)[int(generator.choice(3, p=[0.4, 0.35, 0.25]))]
    frame += _middle_slats(back, generator) if kind is slats else kind(back, generator)
    if style == "arms":
        for side in (-1, 1):
            x, z = side * (width / 2 - 2.5), top + generator.uniform(17, 22)
            behind = back.at(side * (1 - 5 / back.width), z - top)
            front = np.array([x, -depth / 2 - 1, z])
            frame.append(bar(behind, front, (6, 2.5), (6.5, 2.5)))
            frame.append(bar((x, -depth / 2 + 3, top - 4), (x, -depth / 2 + 3, z), 4))
    return frame, cover


def _bench_seat(width: float, depth: float, top: float, generator: Generator) -> list[Solid]:
    """A plank, slats along the bench, or a cushion."""
    style = generator.choice(["plank", "slats", "cushion"], p=[0.35, 0.4, 0.25])
    if style == "slats":
        count = int(generator.integers(4, 8))
        step = depth / count
        at = -depth / 2 + step * (np.arange(count) + 0.5)
        return [bar((-width / 2, y, top - 1), (width / 2, y, top - 1), (0.8 * step, 2)) for y in at]
    shape = outline(width, depth, roundness=0.02)
    if style == "plank":
        thick = generator.uniform(2.5, 6)
        return [slab(shape, [(top - thick, 1), (top - 0.5, 1), (top, 0.99)])]
    thick = generator.uniform(6, 11)
    levels = [(0, 0.97), (0.2, 1), (0.7, 1), (0.92, 0.97), (1.02, 0.88)]
    cushion = slab(shape, [(top - thick + thick * up, share) for up, share in levels])
    return [slab(shape, [(top - thick - 4, 0.98), (top - thick + 0.5, 0.98)]), cushion]


def _bench_legs(width: float, depth: float, top: float, generator: Generator, *, plain: bool) -> list[Solid]:
    """Four legs with rails, or, below a plain bench, two boards or trestles."""
    x, y = width / 2 - generator.uniform(3, 0.12 * width), depth / 2 - 3
    rail = bar((-x, 0, 0.35 * top), (x, 0, 0.35 * top), (3, 6))
    style = generator.choice(["legs", "boards", "trestles"]) if plain else "legs"
    if style == "boards":
        ring = np.array([[-y, 0], [y, 0], [y, top - 2], [-y, top - 2]])
        thick = generator.uniform(3, 5)
        faces = [[np.column_stack([np.full(4, s * x + t), ring]) for t in (-thick / 2, thick / 2)] for s in (-1, 1)]
        return [*(loft(np.array(rings)) for rings in faces), rail]
    if style == "trestles":
        ways = [(side, way) for side in (-x, x) for way in (-1, 1)]
        return [rail, *(bar((x, w * (y + 3), 0), (x, -w * (y - 4), top - 2), (4, 4.5)) for x, w in ways)]
    size = generator.uniform(4, 6)
    x = width / 2 - size / 2 - 0.5
    corners = np.array([[-x, -y], [x, -y], [x, y], [-x, y]])
    parts = [bar((*at, 0), (*at, top - 1.5), size) for at in corners]
    ends = np.column_stack([corners, np.full(4, top - 5)])
    parts += [tube(ends[[a, b]], [(2.2, 6)], sides=4) for a, b in ((0, 1), (1, 2), (2, 3), (3, 0))]
    if width > 140:
        parts += [bar((0, s * y, 0), (0, s * y, top - 1.5), size) for s in (-1, 1)]
    return parts


def _middle_slats(back: Back, generator: Generator) -> list[Solid]:
    """A garden bench's back: rails above and below and many upright slats."""
    count, half = int(back.width / generator.uniform(8, 13)), 2.0 / back.width * 2
    parts = back.posts(back.height, 4.5, round_=False)
    parts += [back.rail(back.height - 6, back.height, 3), back.rail(6, 10, 3)]
    for u in np.linspace(-1, 1, count + 2)[1:-1]:
        parts.append(back.board((u - half, u + half), (8, back.height - 4), 1.2, rows=3, columns=2))
    return parts
