"""Curves on logarithmic axes, drawn with Pillow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

Colour = tuple[int, int, int]
Points = Sequence[tuple[float, float]]

FINER = 3  # drawn so much larger, then shrunk, since Pillow's lines are jagged
WIDTH, HEIGHT = 1000, 480
LEFT, TOP, BOTTOM = 72, 40, 48
KEY, LINE = 52, 17  # pixels that a line of the legend has before its name, and from line to line
GRID, TEXT, FAINT = (225, 225, 225), (40, 40, 40), (140, 140, 140)
COLOURS: tuple[Colour, ...] = (  # that people of any colour vision tell apart (Okabe and Ito), and darker ones of these
    (0, 114, 178),
    (213, 94, 0),
    (0, 158, 115),
    (204, 121, 167),
    (86, 180, 233),
    (230, 159, 0),
    (120, 60, 0),
    (0, 80, 60),
)


@dataclass(frozen=True)
class Curve:
    """A line of a chart.

    Attributes:
        name: in the legend.
        points: from left to right, all positive.
        colour: its number in :data:`COLOURS`; None for gray.
        dashed: as limits and peers are.
        ringed: whether its points are rings, as those of peers, and not dots.
    """

    name: str
    points: Points
    colour: int | None = None
    dashed: bool = False
    ringed: bool = False


def chart(path: Path, title: str, across: str, ticks: Sequence[tuple[float, str]], curves: Sequence[Curve]) -> None:
    """Write a picture of curves.

    Args:
        path: of a PNG.
        title: what is measured upwards.
        across: what is changed.
        ticks: where to mark that, and what to write there, in ASCII as Pillow's own font has little else.
        curves: that have any points are drawn.
    """
    drawn = [curve for curve in curves if curve.points]
    picture = Image.new("RGB", (WIDTH * FINER, HEIGHT * FINER), "white")
    longest = max(_font().getlength(curve.name) / FINER for curve in drawn)
    right = WIDTH - KEY - math.ceil(longest) - 12
    upwards = [y for curve in drawn for _, y in curve.points]
    axes = _Axes(ImageDraw.Draw(picture), right, [x for x, _ in ticks], upwards)
    axes.frame(title, across, ticks)
    for curve in drawn:
        axes.curve(curve)
    axes.legend(sorted(drawn, key=lambda curve: -curve.points[-1][1]))
    picture.resize((WIDTH, HEIGHT), Image.Resampling.LANCZOS).save(path, optimize=True)


class _Axes:
    """Both logarithmic, the frame ``right`` pixels from the left at most."""

    def __init__(
        self, draw: ImageDraw.ImageDraw, right: int, across: Sequence[float], upwards: Sequence[float]
    ) -> None:
        self.draw, self.right = draw, right
        self.first, self.last = math.log10(min(across)), math.log10(max(across))
        self.low, self.high = math.log10(min(upwards)) - 0.05, math.log10(max(upwards)) + 0.05

    def x(self, value: float) -> float:
        share = (math.log10(value) - self.first) / ((self.last - self.first) or 1)
        return LEFT + 12 + share * (self.right - LEFT - 24)

    def y(self, value: float) -> float:
        return TOP + (self.high - math.log10(value)) / (self.high - self.low) * (HEIGHT - TOP - BOTTOM)

    def frame(self, title: str, across: str, ticks: Sequence[tuple[float, str]]) -> None:
        for value, label in ticks:
            self._line([(self.x(value), TOP), (self.x(value), HEIGHT - BOTTOM)], GRID, 1)
            self._text(self.x(value), HEIGHT - BOTTOM + 5, label, TEXT, "mt")
        for value in _marks(self.low, self.high):
            self._line([(LEFT, self.y(value)), (self.right, self.y(value))], GRID, 1)
            self._text(LEFT - 6, self.y(value), f"{value:g}", TEXT, "rm")
        self._text(LEFT, TOP - 10, title, TEXT, "lb")
        self._text((LEFT + self.right) / 2, HEIGHT - 8, across, TEXT, "mb")

    def curve(self, curve: Curve) -> None:
        colour = FAINT if curve.colour is None else COLOURS[curve.colour % len(COLOURS)]
        places = [(self.x(x), self.y(y)) for x, y in curve.points]
        for start, end in pairwise(places):
            self._stroke(start, end, colour, curve.dashed)
        if curve.colour is not None:
            for place in places:
                self._dot(place, colour, curve.ringed)

    def legend(self, curves: Sequence[Curve]) -> None:
        left = self.right + 16
        for k, curve in enumerate(curves):
            colour = FAINT if curve.colour is None else COLOURS[curve.colour % len(COLOURS)]
            y = TOP + 8 + k * LINE
            self._stroke((left, y), (left + 28, y), colour, curve.dashed)
            if curve.colour is not None:
                self._dot((left + 14, y), colour, curve.ringed)
            self._text(left + KEY - 16, y, curve.name, TEXT, "lm")

    def _stroke(self, start: tuple[float, float], end: tuple[float, float], colour: Colour, dashed: bool) -> None:
        if not dashed:
            self._line([start, end], colour, 2)
            return
        pieces = max(1, round(math.dist(start, end) / 10))
        for k in range(pieces):
            self._line([_between(start, end, k / pieces), _between(start, end, (k + 0.6) / pieces)], colour, 1.5)

    def _line(self, points: Points, colour: Colour, width: float) -> None:
        self.draw.line([(x * FINER, y * FINER) for x, y in points], fill=colour, width=round(width * FINER))

    def _dot(self, place: tuple[float, float], colour: Colour, ringed: bool) -> None:
        corners = [FINER * (place[k % 2] + shift) for k, shift in enumerate((-3.5, -3.5, 3.5, 3.5))]
        self.draw.ellipse(corners, fill=(255, 255, 255) if ringed else colour, outline=colour, width=round(1.5 * FINER))

    def _text(self, x: float, y: float, text: str, colour: Colour, anchor: str) -> None:
        self.draw.text((x * FINER, y * FINER), text, colour, _font(), anchor)


@cache
def _font() -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(12 * FINER)


def _between(start: tuple[float, float], end: tuple[float, float], share: float) -> tuple[float, float]:
    return start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1])


def _marks(low: float, high: float) -> list[float]:
    """Values to mark on an axis from 10^low to 10^high: powers of ten, and if these are few, 2 and 5 times them."""
    factors = (1.0,) if high - low > 3 else (1.0, 2.0, 5.0)
    values = [factor * 10.0**power for power in range(math.floor(low), math.ceil(high) + 1) for factor in factors]
    return [value for value in values if low <= math.log10(value) <= high]
