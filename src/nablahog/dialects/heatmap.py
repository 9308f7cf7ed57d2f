"""A heat map of distances, with numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..viz.svg import STRONG, Drawing
from .distances import SAME, UNRELATED

CELL, MARGIN, SWATCH, FOOT = 46, 8, 16, 72  # pixels
LETTER = 7  # at most, in the mean over a name
TICKS = (0.0, 0.03, 0.1, 0.3, 0.6, 1.0, UNRELATED)


def heat_map(distances: NDArray[np.float64], names: Sequence[str]) -> Drawing:
    """Draws a matrix of distances: the stronger the colour the larger, with the numbers, and a scale below.

    Args:
        distances: (n, n), symmetric, in 0…√2, n at least 2.
        names: of the rows and columns.
    """
    label = MARGIN + LETTER * max(map(len, names))
    left = top = label + MARGIN
    side = CELL * len(names)
    width = left + CELL * max(len(names), len(TICKS)) + 2 * MARGIN
    drawing = Drawing(width, top + side + FOOT, f"Distances of {len(names)} dialects", _description(distances, names))
    for i, name in enumerate(names):
        middle = (i + 0.5) * CELL + 4
        drawing.note((label, top + middle), name, anchor="end")
        drawing.note((left + middle, label), name, upwards=True)
        for j in range(len(names)):
            text = "" if i == j else _label(distances[i, j])
            _tile(drawing, (left + j * CELL, top + i * CELL), CELL, distances[i, j], text)
    for k, tick in enumerate(TICKS):
        corner = left + k * CELL, top + side + MARGIN
        _tile(drawing, corner, SWATCH, tick, "")
        middle, below = corner[0] + CELL / 2, corner[1] + SWATCH + 16
        drawing.note((middle, below), f"{tick:.3g}", anchor="middle")
        if tick in (0, UNRELATED):
            drawing.note((middle, below + 16), "unrelated" if tick else "equal", anchor="middle")
    return drawing


def _description(distances: NDArray[np.float64], names: Sequence[str]) -> str:
    pairs = [(float(distances[i, j]), f"{names[i]} and {names[j]}") for i in range(len(names)) for j in range(i)]
    (least, near), (most, far) = min(pairs), max(pairs)
    return f"Of {len(pairs)} pairs the closest are {near}, {least:.3f}, and the furthest apart {far}, {most:.3f}."


def _tile(drawing: Drawing, corner: tuple[float, float], height: float, distance: float, text: str) -> None:
    """By the square root, so that small distances can be distinguished."""
    (x, y), strength = corner, math.sqrt(min(distance / UNRELATED, 1.0))
    drawing.rectangle(corner, CELL, height, "heat", strength)
    drawing.line([(x, y), (x + CELL, y), (x + CELL, y + height), (x, y + height), (x, y)], "grid")
    if text:
        colour = "on-strong-heat" if strength > STRONG else "on-weak-heat"
        drawing.note((x + CELL / 2, y + height / 2 + 4), text, colour, "middle")


def _label(distance: float) -> str:
    if distance <= SAME:
        return "0"
    return f"{distance:.3f}" if distance >= 0.0005 else "< .001"
