"""Curves on logarithmic axes, as SVG."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from nablahog.viz.svg import SERIES, Drawing

Points = Sequence[tuple[float, float]]

WIDTH, HEIGHT = 1000, 480
LEFT, TOP, BOTTOM = 72, 40, 48
KEY, LINE, LETTER = 52, 17, 6.6  # pixels that a line of the legend has before its name, from line to line, and a letter


@dataclass(frozen=True)
class Curve:
    """A line of a chart.

    Attributes:
        name: in the legend.
        points: from left to right, all positive.
        colour: its number among the :data:`~nablahog.viz.svg.SERIES` colours; None for gray.
        dashed: as limits and peers are.
        ringed: whether its points are rings, as those of peers, and not dots.
    """

    name: str
    points: Points
    colour: int | None = None
    dashed: bool = False
    ringed: bool = False

    @property
    def stroke(self) -> str:
        """The name of its colour."""
        return "faint" if self.colour is None else f"series{self.colour % SERIES}"


def chart(path: Path, title: str, across: str, ticks: Sequence[tuple[float, str]], curves: Sequence[Curve]) -> None:
    """Write a picture of curves.

    Args:
        path: of an SVG.
        title: what is measured upwards.
        across: what is changed.
        ticks: where to mark that, and what to write there.
        curves: that have any points are drawn.
    """
    drawn = [curve for curve in curves if curve.points]
    right = WIDTH - KEY - math.ceil(LETTER * max(len(curve.name) for curve in drawn)) - 12
    upwards = [y for curve in drawn for _, y in curve.points]
    last = "; ".join(f"{curve.name}: {curve.points[-1][1]:.3g}" for curve in drawn)
    drawing = Drawing(WIDTH, HEIGHT, f"{title}, by {across}", f"At the right end, {last}.")
    axes = _Axes(drawing, right, [x for x, _ in ticks], upwards)
    axes.frame(title, across, ticks)
    for curve in drawn:
        axes.curve(curve)
    axes.legend(sorted(drawn, key=lambda curve: -curve.points[-1][1]))
    path.write_text(drawing.svg(), encoding="utf-8")


class _Axes:
    """Both logarithmic, the frame ``right`` pixels from the left at most."""

    def __init__(self, drawing: Drawing, right: int, across: Sequence[float], upwards: Sequence[float]) -> None:
        self.drawing, self.right = drawing, right
        self.first, self.last = math.log10(min(across)), math.log10(max(across))
        self.low, self.high = math.log10(min(upwards)) - 0.05, math.log10(max(upwards)) + 0.05

    def x(self, value: float) -> float:
        share = (math.log10(value) - self.first) / ((self.last - self.first) or 1)
        return LEFT + 12 + share * (self.right - LEFT - 24)

    def y(self, value: float) -> float:
        return TOP + (self.high - math.log10(value)) / (self.high - self.low) * (HEIGHT - TOP - BOTTOM)

    def frame(self, title: str, across: str, ticks: Sequence[tuple[float, str]]) -> None:
        for value, label in ticks:
            self.drawing.line([(self.x(value), TOP), (self.x(value), HEIGHT - BOTTOM)], "grid")
            self.drawing.note((self.x(value), HEIGHT - BOTTOM + 17), label, anchor="middle")
        for value in _marks(self.low, self.high):
            self.drawing.line([(LEFT, self.y(value)), (self.right, self.y(value))], "grid")
            self.drawing.note((LEFT - 6, self.y(value) + 4), f"{value:g}", anchor="end")
        self.drawing.note((LEFT, TOP - 12), title)
        self.drawing.note(((LEFT + self.right) / 2, HEIGHT - 8), across, anchor="middle")

    def curve(self, curve: Curve) -> None:
        places = [(self.x(x), self.y(y)) for x, y in curve.points]
        self.drawing.line(places, curve.stroke, 2, dashed=curve.dashed)
        if curve.colour is not None:
            for place in places:
                self.drawing.dot(place, curve.stroke, 3.5, ringed=curve.ringed)

    def legend(self, curves: Sequence[Curve]) -> None:
        left = self.right + 16
        for k, curve in enumerate(curves):
            y = TOP + 8 + k * LINE
            self.drawing.line([(left, y), (left + 28, y)], curve.stroke, 2, dashed=curve.dashed)
            if curve.colour is not None:
                self.drawing.dot((left + 14, y), curve.stroke, 3.5, ringed=curve.ringed)
            self.drawing.note((left + KEY - 16, y + 4), curve.name)


def _marks(low: float, high: float) -> list[float]:
    """Values to mark on an axis from 10^low to 10^high: powers of ten, and if these are few, 2 and 5 times them."""
    factors = (1.0,) if high - low > 3 else (1.0, 2.0, 5.0)
    values = [factor * 10.0**power for power in range(math.floor(low), math.ceil(high) + 1) for factor in factors]
    return [value for value in values if low <= math.log10(value) <= high]
