"""Backs of procedural chairs.  Lengths in centimetres; z up, the front looks to -y."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from solids import Floats, Generator, Solid, sheet, tube


def across(columns: int) -> Floats:
    """Positions of a board's columns, from -1 to 1: closer together at the edges, where corners are round."""
    positions: Floats = np.sin(np.linspace(-np.pi / 2, np.pi / 2, columns))
    return positions


def padding(rows: int, columns: int) -> Floats:
    """(rows, columns): thickness of a pad by its greatest, less towards its edges; columns as :func:`across`."""
    s, t = np.abs(across(columns)), np.abs(across(rows))[:, None]
    share: Floats = 1 - 0.75 * np.maximum(s, t) ** 6
    return share


@dataclass(frozen=True)
class Back:
    """The surface of a back: u from left to right, v from the seat upwards.

    Attributes:
        width: at the seat.
        height: above the seat.
        y, z: of its foot.
        tilt: backwards, in radians.
        curve: by how much its sides are in front of its middle.
        bend: by how much its top is bent further back.
        spread: relative difference of width between top and foot.
    """

    width: float
    height: float
    y: float
    z: float
    tilt: float
    curve: float
    bend: float
    spread: float

    def at(self, u: ArrayLike, v: ArrayLike) -> Floats:
        """(..., 3): points; u in -1…1 from edge to edge, v in centimetres."""
        u, v = np.broadcast_arrays(np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64))
        up = v / self.height
        x = u * self.width / 2 * (1 + self.spread * up)
        y = self.y + np.sin(self.tilt) * v + self.bend * np.maximum(up, 0) ** 2 - self.curve * u**2
        return np.stack([x, y, self.z + np.cos(self.tilt) * v], axis=-1)

    def board(
        self,
        u: tuple[ArrayLike, ArrayLike],
        v: tuple[ArrayLike, ArrayLike],
        thickness: ArrayLike,
        *,
        rows: int = 2,
        columns: int = 9,
    ) -> Solid:
        """A board between two u, numbers or (rows,) from below, and two v, numbers or (columns,) at :func:`across`."""
        s, t = (across(columns) + 1) / 2, np.linspace(0, 1, rows)[:, None]
        left, right = (np.reshape(np.broadcast_to(edge, rows), (rows, 1)) for edge in u)
        low, high = (np.broadcast_to(edge, columns) for edge in v)
        return sheet(self.at(left + s * (right - left), low + t * (high - low)), thickness)

    def padded(self, u: tuple[ArrayLike, ArrayLike], v: tuple[ArrayLike, ArrayLike], thickness: float) -> Solid:
        """A pad between two u and two v, as :meth:`board`; v may be (15,)."""
        return self.board(u, v, thickness * padding(9, 15), rows=9, columns=15)

    def rail(self, low: float, high: float, thickness: float, crown: float = 0.0, edge: float = 1.0) -> Solid:
        """A board from edge to edge, whose upper side is higher in the middle by ``crown``."""
        s = across(13)
        return self.board((-edge, edge), (low, high - crown * s**2), thickness, columns=13)

    def posts(self, top: float, size: float, *, round_: bool) -> list[Solid]:
        """The two bars at its edges, from 4 cm below the seat up to ``top``."""
        v = np.linspace(-4.0, top, 6)
        edge = 1 - size / self.width
        return [tube(self.at(side * edge, v), size, sides=10 if round_ else 4) for side in (-1, 1)]


def solid(back: Back, generator: Generator) -> list[Solid]:
    """One board or pad, down to the seat or above a gap on two posts; its corners may be round."""
    gap = generator.choice([0.0, generator.uniform(0.15, 0.4) * back.height])
    padded = generator.random() < 0.5
    rows, columns = 9, 15
    s, t = across(columns), np.linspace(0, 1, rows)
    thickness = np.full((rows, columns), generator.uniform(1.5, 3))
    if padded:
        thickness = generator.uniform(4, 8) * (1 - 0.75 * np.maximum(np.abs(s), np.abs(2 * t - 1)[:, None]) ** 4)
    power, corner = generator.uniform(3, 12), generator.uniform(0, 0.35) * (back.height - gap)
    high = back.height - corner * np.abs(s) ** power
    low = gap + (generator.uniform(0, 0.5) * corner if gap else 0) * np.abs(s) ** power
    parts = [back.board((-1, 1), (low, high), thickness, rows=rows, columns=columns)]
    if gap:
        parts += back.posts(gap + 0.3 * (back.height - gap), generator.uniform(2, 3.5), round_=generator.random() < 0.5)
    return parts


def slats(back: Back, generator: Generator) -> list[Solid]:
    """Two posts, rails above and below, and upright slats between them."""
    size, rail = generator.uniform(2.5, 4), generator.uniform(4, 10)
    gap = generator.uniform(3, 12)
    count = int(generator.integers(3, 9))
    half = min(generator.uniform(0.7, 2.2), 0.4 * back.width / count) / back.width * 2
    parts = back.posts(back.height - 0.3 * rail, size, round_=False)
    parts.append(back.rail(back.height - rail, back.height, size * 0.7, crown=generator.uniform(0, 4)))
    parts.append(back.rail(gap, gap + 3, size * 0.6, edge=0.95))
    for u in np.linspace(-0.8, 0.8, count + 2)[1:-1]:
        parts.append(back.board((u - half, u + half), (gap + 1, back.height - rail + 1), 1.0, rows=4, columns=2))
    return parts


def ladder(back: Back, generator: Generator) -> list[Solid]:
    """Two posts with rails across."""
    size = generator.uniform(2.5, 4)
    count = int(generator.integers(2, 6))
    first = generator.uniform(0.2, 0.35) * back.height
    step = (back.height - first) / count
    high = step * generator.uniform(0.35, 0.7)
    crown = generator.choice([0.0, generator.uniform(1, 3)])
    parts = back.posts(back.height, size, round_=generator.random() < 0.5)
    for number in range(count):
        top = first + (number + 1) * step - 1
        parts.append(back.rail(top - high, top, size * 0.5, crown=crown, edge=1 - size / back.width))
    return parts


def bow(back: Back, generator: Generator) -> list[Solid]:
    """A Windsor chair's: an arch of bent wood with spindles below it."""
    power = generator.uniform(2, 4)
    angle = np.linspace(0, np.pi, 25)
    arch_u = np.sign(np.cos(angle)) * np.abs(np.cos(angle)) ** (2 / power)
    arch_v = back.height * np.abs(np.sin(angle)) ** (2 / power) - 3
    parts = [tube(back.at(arch_u, arch_v), generator.uniform(1.8, 3))]
    count, foot = int(generator.integers(5, 10)), generator.uniform(0.7, 0.95)
    for u in np.linspace(-0.82, 0.82, count):
        top = back.height * (1 - abs(u) ** power) ** (1 / power) - 3
        share = np.array([0, 0.3, 1])[:, None]
        path = back.at(foot * u, -2) * (1 - share) + back.at(u, top) * share
        parts.append(tube(path, [1.2, 1.7, 1.0], sides=6))
    return parts


def comb(back: Back, generator: Generator) -> list[Solid]:
    """Spindles that carry a rail."""
    rail, count = generator.uniform(5, 11), int(generator.integers(5, 10))
    parts = [back.rail(back.height - rail, back.height, 2, crown=generator.uniform(0, 4))]
    for number, u in enumerate(np.linspace(-0.95, 0.95, count)):
        thick = 1.6 if number in (0, count - 1) else 1.0
        v = np.linspace(-2, back.height - rail + 2, 5)
        parts.append(
            tube(back.at(u * (0.9 + 0.1 * v / back.height), v), thick * np.array([1.2, 1.8, 1.5, 1.2, 1]), sides=6)
        )
    return parts


def frame(back: Back, generator: Generator) -> list[Solid]:
    """A closed frame around a hole, which is empty or holds a splat, a cross or a panel that leaves a gap."""
    low = generator.uniform(0.05, 0.4) * back.height
    power, size = generator.uniform(2, 7), generator.uniform(2.5, 5)
    angle = 2 * np.pi * np.arange(40) / 40
    u, v = (np.sign(f) * np.abs(f) ** (2 / power) for f in (np.cos(angle), np.sin(angle)))
    middle, half = (low + back.height - size / 2) / 2, (back.height - size / 2 - low) / 2
    parts = [tube(back.at(0.95 * u, middle + half * v), size, sides=generator.choice([4, 8]), closed=True)]
    parts += back.posts(middle, size * 0.9, round_=True)
    inside = generator.choice(["empty", "splat", "cross", "panel"])
    if inside == "splat":
        t = np.linspace(0, 1, 9)
        wide = generator.uniform(0.12, 0.25) * (1 + 0.5 * np.sin(2 * np.pi * t * generator.uniform(0.8, 1.6)))
        parts.append(back.board((-wide, wide), (low, back.height - size), 1.2, rows=9, columns=5))
    if inside == "cross":
        reach = np.linspace(-0.7, 0.7, 7)
        parts += [tube(back.at(sign * 0.95 * reach, middle + half * reach), 1.6, sides=6) for sign in (-1, 1)]
    if inside == "panel":
        parts.append(back.board((-0.72, 0.72), (middle - 0.68 * half, middle + 0.68 * half), 1.5, rows=5))
        parts += [back.board((a, b), (middle - 3, middle + 3), 1.2, columns=3) for a, b in ((-0.93, -0.7), (0.7, 0.93))]
    return parts


def spine(back: Back, generator: Generator) -> list[Solid]:
    """A pad on one bar, as of office chairs."""
    low = generator.uniform(0.12, 0.45) * back.height
    rows, columns = 9, 15
    s, t = across(columns), np.linspace(0, 1, rows)
    thickness = generator.uniform(3, 7) * (1 - 0.75 * np.maximum(np.abs(s), np.abs(2 * t - 1)[:, None]) ** 4)
    corner = generator.uniform(0.05, 0.4) * (back.height - low)
    bulge = corner * np.abs(s) ** generator.uniform(2.5, 6)
    narrow = 1 - generator.uniform(0, 0.25) * (2 * t - 1) ** 2
    parts = [back.board((-narrow, narrow), (low + bulge, back.height - bulge), thickness, rows=rows, columns=columns)]
    stem = back.at(0, np.linspace(-8, (low + back.height) / 2, 6)) + np.array([0, 2.5, 0])
    under = np.array([[0, -5, back.z - 8]])
    parts.append(tube(np.concatenate([under, stem]), [(6.0, 2.0)], sides=4))
    return parts


STYLES = {"solid": solid, "slats": slats, "ladder": ladder, "bow": bow, "comb": comb, "frame": frame, "spine": spine}
