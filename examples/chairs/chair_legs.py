"""Legs and feet of procedural chairs.  Lengths in centimetres; z up, the front looks to -y, the floor is z = 0."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from solids import Floats, Generator, Solid, bar, lathe, outline, rounded, slab, tube

TURNED = {
    "baluster": (
        *((0, 1.0), (0.08, 1.0), (0.1, 0.6), (0.14, 1.05), (0.18, 0.6), (0.4, 1.1), (0.55, 0.75), (0.7, 0.6)),
        *((0.73, 0.95), (0.76, 0.6), (0.95, 0.5), (1, 0.55)),
    ),
    "bamboo": (
        *((0, 0.8), (0.2, 0.9), (0.3, 0.75), (0.32, 0.95), (0.34, 0.75), (0.6, 0.9), (0.68, 0.7), (0.7, 0.9)),
        *((0.72, 0.7), (1, 0.5)),
    ),
    "vase": ((0, 0.7), (0.1, 0.8), (0.15, 0.5), (0.45, 1.2), (0.6, 0.5), (0.64, 0.8), (0.68, 0.5), (1, 0.7)),
}
"""Diameters by the share of the way down, in units of the leg's size."""


def corners(width: float, depth: float, inset: float, narrower: float) -> Floats:
    """(4, 2): the tops of four legs, front left, front right, back right, back left; the back ones closer together."""
    x, y = width / 2 - inset, depth / 2 - inset
    behind = x - narrower / 2
    return np.array([[-x, -y], [x, -y], [behind, y], [-behind, y]])


def four(tops: Floats, height: float, kind: str, generator: Generator) -> list[Solid]:
    """Four legs, with stretchers between them.

    Args:
        tops: (4, 2), as :func:`corners`.
        height: of the tops.
        kind: straight, tapered, splayed, turned, sabre or hairpin.
        generator: of sizes, splay and stretchers.
    """
    legs, tops3, feet3, size = _legs(tops, height, kind, generator)
    if kind in ("sabre", "hairpin"):
        return legs
    return legs + _stretchers(tops3, feet3, size, generator)


def feet(tops: Floats, height: float, kind: str, generator: Generator) -> list[Solid]:
    """Four legs as :func:`four`, without stretchers, as below an armchair."""
    return _legs(tops, height, kind, generator)[0]


def _legs(tops: Floats, height: float, kind: str, generator: Generator) -> tuple[list[Solid], Floats, Floats, float]:
    """Four legs, their upper and lower ends (4, 3), and their size."""
    splay = {"splayed": (4, 9), "turned": (0, 5), "sabre": (3, 7), "hairpin": (2, 6), "tapered": (0, 3)}
    outwards = generator.uniform(*splay.get(kind, (0, 0.1)))
    ends = tops * (1 + outwards / np.abs(tops).max())
    if kind in ("straight", "tapered"):
        ends[2:, 1] += generator.uniform(0, 5)  # the back legs lean back
    top3, foot3 = np.column_stack([tops, [height] * 4]), np.column_stack([ends, [0.0] * 4])
    size = generator.uniform(2.6, 4.4)
    legs = [_leg(top, foot, kind, size) for top, foot in zip(top3, foot3, strict=True)]
    if kind == "turned":
        profile = [(t, size * d) for t, d in TURNED[str(generator.choice(list(TURNED)))]]
        legs = [lathe(top, foot, profile) for top, foot in zip(top3, foot3, strict=True)]
    return legs, top3, foot3, size


def _leg(top: Floats, foot: Floats, kind: str, size: float) -> Solid:
    if kind == "straight":
        return bar(top, foot, size)
    if kind == "tapered":
        return bar(top, foot, size * 1.15, size * 0.6)
    if kind == "sabre":
        t = np.linspace(0, 1, 7)[:, None]
        down = top + t * (foot - top)
        down[:, :2] = top[:2] + t**2.5 * (foot - top)[:2]
        return tube(down, np.linspace(size * 1.2, size * 0.7, 7), sides=4)
    if kind == "hairpin":
        aside = np.array([-np.sign(top[0]), 0, 0]) * 7
        return tube(rounded([top, foot, top + aside], 2.0), 1.1, sides=6)
    return bar(top, foot, size, size * 0.65, sides=10)


def _stretchers(tops: Floats, feet: Floats, size: float, generator: Generator) -> list[Solid]:
    """Bars between legs: none, a box around, or an H; round ones of half the legs' size."""
    kind = generator.choice(["none", "box", "h"], p=[0.45, 0.25, 0.3])
    if kind == "none":
        return []

    def at(leg: int, height: float) -> Floats:
        share = height / tops[leg, 2]
        point: Floats = share * tops[leg] + (1 - share) * feet[leg]
        return point

    low = generator.uniform(8, 20)
    sides = [bar(at(a, low), at(b, low), size * 0.55, sides=8) for a, b in ((0, 3), (1, 2))]
    if kind == "box":
        high = low + generator.uniform(0, 6)
        return sides + [bar(at(a, high), at(b, high), size * 0.55, sides=8) for a, b in ((0, 1), (2, 3))]
    middle = [(at(a, low) + at(b, low)) / 2 for a, b in ((0, 3), (1, 2))]
    return [*sides, bar(middle[0], middle[1], size * 0.55, sides=8)]


def sled(width: float, depth: float, height: float, generator: Generator) -> list[Solid]:
    """Two frames of bent tube that stand on runners."""
    x, y, size = width / 2 - 2, depth / 2 - 3, generator.uniform(1.6, 2.8)
    lean = generator.uniform(-2, 5)
    frames = []
    for side in (-x, x):
        path = [(side, -y, height), (side, -y - lean, size / 2), (side, y + lean, size / 2), (side, y, height)]
        frames.append(tube(rounded(path, 8), size))
    across = [bar((-x, at, height - 1), (x, at, height - 1), size, sides=8) for at in (-y, y)]
    return frames + across


def cantilever(
    width: float, depth: float, height: float, behind: Sequence[Floats], generator: Generator
) -> list[Solid]:
    """A bent tube that carries the seat from the front only, and continues to the points ``behind`` of the back."""
    x, y, size = width / 2 - 1, depth / 2, generator.uniform(2.2, 3.0)
    floor = size / 2
    sides = []
    for side, upper in zip((-x, x), behind, strict=True):
        lower = [(side, y - 1, height), (side, -y + 1, height), (side, -y + 1, floor), (side, y + 2, floor)]
        sides.append(tube(rounded([tuple(upper), *lower], 9), size))
    return [*sides, bar((-x, y + 2, floor), (x, y + 2, floor), size, sides=8)]


def swivel(height: float, generator: Generator) -> list[Solid]:
    """A column on a star foot, with castors or without."""
    arms = int(generator.choice([4, 5, 5, 5]))
    reach, castors = generator.uniform(26, 34), generator.random() < 0.7
    foot = 6.0 if castors else 1.5
    hub = foot + generator.uniform(3, 7)
    turn = generator.uniform(0, 2 * np.pi)
    parts = [lathe((0, 0, hub - 3), (0, 0, height), [(0, 7), (0.25, 7), (0.27, 5), (0.6, 5), (0.62, 3), (1, 3)])]
    parts.append(slab(outline(20, 20, roundness=0.3, corners=16), [(height - 2, 1), (height, 1)]))
    for angle in turn + 2 * np.pi * np.arange(arms) / arms:
        way = np.array([np.cos(angle), np.sin(angle), 0])
        end = reach * way + (0, 0, foot)
        parts.append(bar(3 * way + (0, 0, hub), end, (4.5, 4.5), (2.5, 2.5), sides=8))
        if castors:
            axle = np.array([-way[1], way[0], 0])
            wheel = reach * way + (0, 0, 2.8)
            parts.append(lathe(wheel - 2 * axle, wheel + 2 * axle, [(0, 4), (0.2, 5.6), (0.8, 5.6), (1, 4)]))
            parts.append(bar(wheel, end, 2, sides=6))
    return parts


def pedestal(height: float, generator: Generator) -> list[Solid]:
    """One turned column on a round foot."""
    foot, waist, top = generator.uniform(40, 54), generator.uniform(4, 7), generator.uniform(10, 22)
    share = generator.uniform(0.04, 0.3)  # of the height where the foot has become the column: a disc or a tulip
    way = np.linspace(0, 1, 7)
    profile = [(0.0, foot), (0.02, foot)]
    profile += [(0.02 + share * t, waist + (foot - waist) * (1 - t) ** 2.5) for t in way[1:]]
    profile += [(0.7 + 0.3 * t, waist + (top - waist) * t**2) for t in way]
    return [lathe((0, 0, 0), (0, 0, height), profile, sides=24)]


SINGLE: dict[str, Callable[[float, Generator], list[Solid]]] = {"swivel": swivel, "pedestal": pedestal}
