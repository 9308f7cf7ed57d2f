"""Padded chairs: reclined lounge chairs, and armchairs upholstered all around.

Lengths in centimetres; z up, the front looks to -y, the floor is z = 0.
"""

from __future__ import annotations

from itertools import pairwise

import chair_legs
import numpy as np
from chair_backs import Back, across, padding
from numpy.typing import ArrayLike
from solids import Floats, Generator, Parts, Solid, bar, lathe, loft, moved, outline, rounded, sheet, slab, tube


def cushion(start: ArrayLike, end: ArrayLike, width: float, thickness: float, *, narrower: float = 0.0) -> Solid:
    """A pad across x, from y and z at ``start`` to those at ``end``, where it is narrower by that share."""
    s, t = across(15), (across(9)[:, None] + 1) / 2
    first, last = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    along = first + t[..., None] * (last - first)
    x = s * width / 2 * (1 - narrower * t)
    y, z = (np.broadcast_to(along[..., k], x.shape) for k in (0, 1))
    return sheet(np.stack([x, y, z], axis=-1), thickness * padding(9, 15))


def lounge(generator: Generator) -> Parts:
    """A low, wide, reclined chair: thick pads on a wooden frame, on bent tube, or on a shell above a star."""
    width, depth, top = generator.uniform(54, 72), generator.uniform(50, 58), generator.uniform(37, 43)
    slope, recline = generator.uniform(0.12, 0.24), generator.uniform(0.4, 0.62)
    length, thick = generator.uniform(52, 74), generator.uniform(9, 14)
    front = np.array([-depth / 2, top - thick / 2])
    rear = front + depth * np.array([np.cos(slope), -np.sin(slope)])
    foot = rear + thick * np.array([0.15, 0.45])
    way = np.array([np.sin(recline), np.cos(recline)])
    cover = [cushion(front, rear, width, thick)]
    cover += _reclined(foot, way, length, width, thick, generator)
    style = generator.choice(["frame", "tube", "star"], p=[0.4, 0.25, 0.35])
    if style == "star":
        return _on_star(front, rear, foot + length * way, width, thick, generator), cover
    return _on_sides(front, rear, foot, way * length, width, thick, generator, wooden=style == "frame"), cover


def _reclined(
    foot: Floats, way: Floats, length: float, width: float, thick: float, generator: Generator
) -> list[Solid]:
    """The back: one pad, two with a head rest, or a row of rolls."""
    style = generator.choice(["one", "two", "rolls"], p=[0.35, 0.4, 0.25])
    rolls = np.linspace(0, 1, int(generator.integers(5, 8)))
    edges = length * {"one": np.array([0, 1]), "two": np.array([0, 0.6, 1]), "rolls": rolls}[str(style)]
    narrower = generator.uniform(0, 0.12)
    parts = []
    for low, high in pairwise(edges):
        start, end = foot + (low + 0.4) * way, foot + (high - 0.4) * way
        less = narrower * (high - low) / length
        parts.append(cushion(start, end, width * (1 - narrower * low / length), thick, narrower=less))
    return parts


def _on_star(
    front: Floats, rear: Floats, high: Floats, width: float, thick: float, generator: Generator
) -> list[Solid]:
    """A bent shell behind the pads, padded arms on it, and a column on a star of four or five low arms."""
    path = rounded([(0, *front), (0, *rear), (0, *high)], 12, steps=6)[:, 1:]
    tangent = np.gradient(path, axis=0)
    normal = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    under = path + (0.5 * thick + 1.2) * normal  # below the seat and behind the back
    u = np.linspace(-1, 1, 11)
    curl = 3.5 * u**4
    y, z = (under[:, k : k + 1] - curl * normal[:, k : k + 1] for k in (0, 1))
    x = np.broadcast_to(width * 0.52 * u, y.shape)
    parts = [sheet(np.stack([x, y, z], axis=-1), 1.6)]
    if generator.random() < 0.75:
        above = generator.uniform(14, 18)
        for side in (-1, 1):
            at = side * (width / 2 + 3)
            level = front[1] + thick / 2 + above
            parts.append(_block((at, rear[0] - 38, level), (at, rear[0] + 6, level - 1), 8, 6))
            post = [(at, rear[0] - 8, level), (at, rear[0] - 8, rear[1] + 1), (at - side * 8, rear[0] - 8, rear[1] - 3)]
            parts.append(tube(rounded(post, 5), [(6, 1.5)], sides=4))
    height, middle = rear[1] - 0.6 * thick, (front[0] + rear[0]) / 2 + 4
    count, reach = int(generator.integers(4, 6)), generator.uniform(31, 37)
    turn = generator.uniform(0, 2 * np.pi)
    parts.append(lathe((0, middle, 3), (0, middle, height + 4), [(0, 8), (0.3, 6), (0.31, 4.5), (0.9, 4.5), (1, 14)]))
    for angle in turn + 2 * np.pi * np.arange(count) / count:
        end = (reach * np.cos(angle), middle + reach * np.sin(angle), 2.0)
        parts.append(bar((0, middle, 6), end, (4.5, 4), (3.5, 2)))
    return parts


def _block(start: tuple[float, ...], end: tuple[float, ...], wide: float, high: float) -> Solid:
    """A soft block along y, with round edges."""
    ring = outline(wide, high, roundness=0.35, corners=16)
    share = np.array([0.7, 0.95, 1, 1, 0.95, 0.7])[:, None]
    at = np.array(start) + np.array([0, 0.04, 0.12, 0.88, 0.96, 1])[:, None] * (np.array(end) - np.array(start))
    rings = [
        np.column_stack([x + k * ring[:, 0], np.full(len(ring), y), z + k * ring[:, 1]])
        for (x, y, z), k in zip(at, share[:, 0], strict=True)
    ]
    return loft(np.array(rings))


def _on_sides(
    front: Floats,
    rear: Floats,
    foot: Floats,
    back: Floats,
    width: float,
    thick: float,
    generator: Generator,
    *,
    wooden: bool,
) -> list[Solid]:
    """Two side frames with arms, and rails below the seat and behind the back."""
    x, arm = width / 2 + 2.5, front[1] + thick / 2 + generator.uniform(13, 18)
    behind = foot + 0.45 * back + (0.5 * thick, 0)
    ahead, lean = front[0] + generator.uniform(0, 6), generator.uniform(2, 8)
    far = behind[0] + generator.uniform(2, 8)
    parts: list[Solid] = []
    for side in (-x, x):
        if wooden:
            parts.append(bar((side, ahead - lean, 0), (side, ahead, arm), (3, 4), (3, 5)))
            parts.append(bar((side, far + lean, 0), (side, behind[0] - 6, arm - 2), (3, 4), (3, 5)))
            parts.append(bar((side, ahead - 5, arm), (side, behind[0] + 3, arm - 3), (7, 2.4), (5, 2.4)))
        else:
            corners = [(side, behind[0], arm), (side, ahead, arm), (side, ahead - lean, 1.2), (side, far + 4, 1.2)]
            parts.append(tube(rounded([*corners, (side, behind[0], arm)], 7), 2.4))
        below, high = 0.55 * thick, foot + 0.95 * back
        parts.append(bar((side, front[0] + 3, front[1] - below), (side, rear[0] + 5, rear[1] - below), (2.5, 5)))
        parts.append(bar((side, rear[0] + 4, rear[1] - 4), (side, high[0] + 0.5 * thick, high[1]), (2.5, 4)))
    for share in (0.12, 0.85):
        y, z = front + share * (rear - front) - (0, 0.55 * thick)
        parts.append(bar((-x, y, z), (x, y, z), (4, 3)))
    for share in np.linspace(0.25, 0.95, int(generator.integers(2, 5))):
        y, z = foot + share * back + (0.55 * thick, -0.1 * thick)
        parts.append(bar((-x, y, z), (x, y, z), (2, 4)))
    return parts


def armchair(generator: Generator) -> Parts:
    """Upholstered all around, on legs that show; with wings beside the head, rolled arms, or straight ones."""
    width, depth, top = generator.uniform(66, 84), generator.uniform(66, 80), generator.uniform(42, 48)
    floor = generator.uniform(11, 20)
    style = str(generator.choice(["wings", "rolls", "straight"]))
    arm, above = generator.uniform(9, 14), generator.uniform(14, 21)
    thick = generator.uniform(11, 15)
    inner = width - 2 * arm
    tops = chair_legs.corners(width - 4, depth - 6, 6, 0)
    legs = str(generator.choice(["tapered", "turned", "straight"]))
    frame = chair_legs.feet(tops, floor + 2, legs, generator)
    block = outline(width - 3, depth - 4, roundness=0.06)
    cover = [slab(block, [(floor, 0.98), (floor + 1, 1), (top - 10, 1)])]
    levels = [(-1, 0.93), (-0.8, 1), (-0.25, 1), (-0.06, 0.95), (0.06, 0.75), (0.1, 0.4)]
    seat = slab(outline(inner + 0.5, depth - 12, roundness=0.12), [(top + 11 * up, share) for up, share in levels])
    cover.append(moved(seat, (0, -6, 0)))
    high = generator.uniform(58, 74) if style == "wings" else generator.uniform(38, 56)
    back = Back(
        width - generator.choice([0.0, 1.2 * arm]),
        high,
        depth / 2 - 0.6 * thick,
        top - 10,
        generator.uniform(0.1, 0.24),
        generator.uniform(0, 4),
        generator.uniform(0, 3),
        generator.uniform(-0.1, 0.06),
    )
    crown = generator.uniform(0, 9)
    cover.append(back.padded((-1, 1), (floor - back.z, high + 10 - crown * np.abs(across(15)) ** 3), thick))
    for side in (-1, 1):
        cover += _upholstered_arm(side, width, depth, arm, (floor, top + above), style == "rolls", generator)
    if style == "wings":
        reach, start = generator.uniform(15, 24), top + above - back.z - 8
        cover += [_wing(back, side, start, high + 8 - crown, reach, 0.5 * thick) for side in (-1, 1)]
    return frame, cover


def _upholstered_arm(
    side: int, width: float, depth: float, arm: float, z: tuple[float, float], rolled: bool, generator: Generator
) -> list[Solid]:
    """An arm from floor to top, lower in front by some; perhaps with a roll along it that leans outwards."""
    (low, high), x = z, side * (width - arm) / 2
    fall = 0.0 if rolled else generator.choice([0.0, 4.0, 9.0])
    rings = []
    for share, size in ((0, 0.92), (0.03, 1), (0.3, 1), (0.97, 1), (1, 0.92)):
        top = high - fall * (1 - share) ** 2
        ring = outline(arm, top - low, roundness=0.15, corners=20)
        y = -depth / 2 + 2 + share * (depth - 6)
        rings.append(np.column_stack([x + size * ring[:, 0], np.full(20, y), (low + top) / 2 + size * ring[:, 1]]))
    parts = [loft(np.array(rings))]
    if rolled:
        size = 1.35 * arm
        at = (x + side * 0.12 * arm, high - 0.3 * size)
        ends = (-depth / 2 + 0.5, depth / 2 - 4)
        profile = [(0, 0.85 * size), (0.03, size), (0.97, size), (1, 0.85 * size)]
        parts.append(lathe((at[0], ends[0], at[1]), (at[0], ends[1], at[1]), profile, sides=18))
    return parts


def _wing(back: Back, side: int, low: float, high: float, reach: float, thick: float) -> Solid:
    """A pad from the edge of the back forwards, narrow where it begins above the arm, widest below its top."""
    t, ahead = np.linspace(0, 1, 9)[:, None], (across(7) + 1) / 2
    share = np.interp(t, [0, 0.3, 0.75, 1], [0.75, 0.85, 1, 0.55])
    edge = back.at(side * (1 - thick / back.width), low + t * (high - low))
    offset = np.stack([side * 0.18 * reach * share * ahead, -reach * share * ahead, 0 * share * ahead], axis=-1)
    return sheet(edge + offset, thick * padding(9, 7))
