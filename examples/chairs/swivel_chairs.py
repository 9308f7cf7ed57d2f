"""Swivel chairs: a star of five arms with castors, a gas column, and a back on a spine, in one pad or in a frame.

Lengths in centimetres; z up, the front looks to -y, the floor is z = 0.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import chair_bodies
import numpy as np
from chair_backs import Back, across, spine
from solids import Generator, Parts, Solid, bar, lathe, moved, rounded, tube

ARMS = 5
WHEEL = 5.4  # diameter of a castor


def swivel(generator: Generator) -> Parts:
    """A swivel chair, of the kinds for typing, with a net in a frame, and with a high padded back."""
    width, depth, top = generator.uniform(45, 53), generator.uniform(43, 50), generator.uniform(44, 54)
    style = generator.choice(["task", "net", "high"])
    base = star(top - 6, generator)
    if style == "high":
        thick = generator.uniform(7, 11)
        cover = chair_bodies.seat(width, depth, top, generator.uniform(0.15, 0.4), 0, generator)
        back = _back(width * generator.uniform(0.9, 1), depth, top, generator.uniform(62, 78), generator)
        back = replace(back, curve=0.4 * back.curve, spread=generator.uniform(-0.15, -0.05))
        cover += _high_back(back, thick, generator)
        frame_, kind = base, generator.choice(["loop", "tee"])
    else:
        cover = chair_bodies.seat(width, depth, top, generator.uniform(0.25, 0.6), generator.uniform(0, 0.1), generator)
        back = _back(width * generator.uniform(0.8, 0.95), depth, top, generator.uniform(42, 58), generator)
        if style == "task":
            cover += spine(back, generator)
            frame_ = base
        else:
            ring, net = _net(back, generator)
            cover.append(net)
            frame_ = [*base, ring, *_bracket(back)]
        kind = generator.choice(["tee", "none"], p=[0.7, 0.3])
    if kind != "none":
        frame_ += chair_bodies.arms(back, width, depth, top, str(kind), generator)
    return frame_, cover


def star(height: float, generator: Generator) -> list[Solid]:
    """Five arms with twin castors, a gas column in its sleeve, and the mechanism below a seat at that height."""
    reach, hub, turn = generator.uniform(28, 34), generator.uniform(9, 12), generator.uniform(0, 2 * np.pi)
    column = [(0, 6.5), (0.45, 6.5), (0.46, 5), (0.7, 5), (0.71, 2.8), (1, 2.8)]
    parts = [
        lathe((0, 0, hub - 3), (0, 0, height), column),
        lathe((0, 0, hub - 4), (0, 0, hub + 3), [(0, 9), (1, 8)]),
        bar((0, -9, height + 1), (0, 11, height + 1), (16, 4)),
    ]
    for angle in turn + 2 * np.pi * np.arange(ARMS) / ARMS:
        way = np.array([np.cos(angle), np.sin(angle), 0])
        axle = np.array([-way[1], way[0], 0])
        end, wheel = reach * way + (0, 0, WHEEL + 2.2), reach * way + (0, 0, WHEEL / 2)
        parts.append(bar(2.5 * way + (0, 0, hub), end, (5, 4.5), (3, 2.8)))
        parts.append(bar(wheel, end, 1.6, sides=6))
        for side in (-1.7, 1.7):
            first, last = wheel + (side - 1.1) * axle, wheel + (side + 1.1) * axle
            parts.append(lathe(first, last, [(0, 0.8 * WHEEL), (0.2, WHEEL), (0.8, WHEEL), (1, 0.8 * WHEEL)]))
    return parts


def _back(width: float, depth: float, top: float, height: float, generator: Generator) -> Back:
    return Back(
        width=width,
        height=height,
        y=depth / 2 - 1,
        z=top - 1,
        tilt=generator.uniform(0.1, 0.25),
        curve=generator.uniform(3, 8),
        bend=generator.uniform(0, 4),
        spread=generator.uniform(-0.15, 0.05),
    )


def _net(back: Back, generator: Generator) -> tuple[Solid, Solid]:
    """A ring with round corners, and the net in it."""
    low, power = generator.uniform(0.06, 0.25) * back.height, generator.uniform(3.5, 7)
    middle, half = (low + back.height) / 2, (back.height - low) / 2
    angle = 2 * np.pi * np.arange(40) / 40
    u, v = (np.sign(f) * np.abs(f) ** (2 / power) for f in (np.cos(angle), np.sin(angle)))
    ring = tube(back.at(u, middle + half * v), generator.uniform(2.2, 3.4), sides=8, closed=True)
    high = half * (1 - np.abs(0.96 * across(13)) ** power) ** (1 / power)
    return ring, back.board((-0.96, 0.96), (middle - high, middle + high), 0.6, rows=9, columns=13)


def _high_back(back: Back, thick: float, generator: Generator) -> list[Solid]:
    """Two to four pads above each other, the highest with round corners, before a shell."""
    count, corner = int(generator.integers(2, 5)), generator.uniform(2, 7) * np.abs(across(15)) ** 4
    edges = np.linspace(1, back.height, count + 1)
    parts = [back.padded((-1, 1), (low - 1, high + 1), thick) for low, high in pairwise(edges[:-1])]
    parts.append(back.padded((-1, 1), (edges[-2] - 1, back.height - corner), thick))
    shell = back.board((-0.9, 0.9), (0.5, back.height - 5), 2.0, rows=9)
    return [*parts, moved(shell, (0, 0.45 * thick, 0)), *_bracket(back)]


def _bracket(back: Back) -> list[Solid]:
    """The bar that carries the back, from below the seat."""
    behind = back.at(0, 0.35 * back.height) + np.array([0, 2.5, 0])
    path = [(0, 2, back.z - 6), (0, back.y + 4, back.z - 6), tuple(behind)]
    return [tube(rounded(path, 7), [(7.0, 2.2)], sides=4)]
