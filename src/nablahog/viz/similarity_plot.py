"""Pictures of poses: boxes, and the paper's figure of similarity and its derivative by azimuth."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import ImageDraw

from ..io.images import Picture, to_pil
from .html import Drawing
from .pictures import RED

Floats = NDArray[np.floating]

WIDTH, LEFT, RIGHT = 960, 64, 24
HEIGHTS = 240, 140  # of similarity and derivative
HEAD, FOOT, VIEW = 24, 20, 96
_MARK = (round(255 * RED[0]), round(255 * RED[1]), round(255 * RED[2]))


def boxed(picture: Picture, boxes: Sequence[Sequence[float]]) -> NDArray[np.float64]:
    """A picture in 0…1 as (3, H, W) with red boxes x0, y0, x1, y1 in pixels; what is beyond the picture is not seen."""
    drawn = to_pil(picture).convert("RGB")
    draw = ImageDraw.Draw(drawn)
    for x0, y0, x1, y1 in boxes:
        draw.rectangle((round(x0), round(y0), round(x1) - 1, round(y1) - 1), outline=_MARK, width=2)
    levels: NDArray[np.float64] = np.asarray(drawn).transpose(2, 0, 1) / 255
    return levels


def by_azimuth(
    similarities: Floats,
    derivatives: Floats,
    differences: Floats,
    *,
    what: str,
    how: str,
    azimuth: float,
    traces: Sequence[tuple[Sequence[float], Sequence[float]]] = (),
    views: Sequence[Picture] = (),
) -> Drawing:
    """Similarity and, below it, its derivative over all azimuths.

    Args:
        similarities, derivatives: (N,), at N equidistant azimuths from 0°, the latter per degree.
        differences: (N,), what the derivatives are compared with, drawn in gray behind them.
        what: the kind of similarity.
        how: says what the differences are, and how well they agree with the derivatives.
        azimuth: to mark, degrees.
        traces: of searches: azimuths in degrees, of any turn, and similarities, drawn into the upper part.
        views: equidistant from 0°, drawn below, square.
    """
    strip = VIEW + 8 if views else 0
    height, middle = 2 * HEAD + sum(HEIGHTS) + 3 * FOOT + strip, (LEFT + WIDTH - RIGHT) / 2
    best = 360 * int(np.argmax(similarities)) / len(similarities)
    seen = f"The similarity, {what}, is largest at an azimuth of {best:g}°; the pose found has {azimuth:.1f}°."
    drawing = Drawing(WIDTH, height, "Similarity and its derivative by azimuth", seen)
    of_traces = [np.asarray(values) for _, values in traces]
    top = _Axes(drawing, HEAD, HEIGHTS[0], np.concatenate([similarities, *of_traces]))
    low = _Axes(drawing, 2 * HEAD + HEIGHTS[0] + FOOT, HEIGHTS[1], np.concatenate([derivatives, differences, [0.0]]))
    top.frame(f"similarity, {what}")
    low.frame("its derivative, per degree")
    drawing.note((WIDTH - RIGHT, low.top - 6), how, "faint", "end")
    for axes in (top, low):
        axes.line([azimuth, azimuth], [axes.low, axes.high], "mark", 2)
    low.line([0.0, 360.0], [0.0, 0.0], "text", 1)
    if traces:
        drawing.note((middle, HEAD - 6), "paths of the search; rings: starts", "path", "middle")
    for azimuths, values in traces:
        top.line(azimuths, values, "path", 1.5)
    around = np.linspace(0, 360, len(similarities) + 1)
    top.line(around, np.append(similarities, similarities[0]), "curve", 2)
    low.line(around, np.append(differences, differences[0]), "faint", 3)
    low.line(around, np.append(derivatives, derivatives[0]), "curve", 1.5)
    for azimuths, values in traces:
        drawing.dot((top.x(azimuths[0] % 360), top.y(values[0])), "path", 5, ringed=True)
    drawing.note((WIDTH - RIGHT, HEAD - 6), f"found: {azimuth:.1f}°", "mark", "end")
    drawing.note((middle, height - strip - 10), "azimuth of the camera", anchor="middle")
    for k, view in enumerate(views):
        drawing.image((top.x(360 * k / len(views)) - VIEW / 2, height - strip), VIEW, view)
    return drawing


class _Axes:
    """A part of the figure: 0 … 360° across, and upwards from the least of ``values`` to the largest."""

    def __init__(self, drawing: Drawing, top: int, height: int, values: Floats) -> None:
        self.drawing, self.top, self.height = drawing, top, height
        low, high = float(values.min()), float(values.max())
        margin = 0.05 * (high - low) or 1.0
        self.low, self.high = low - margin, high + margin

    def x(self, azimuth: float) -> float:
        return LEFT + azimuth / 360 * (WIDTH - LEFT - RIGHT)

    def y(self, value: float) -> float:
        return self.top + (self.high - value) / (self.high - self.low) * self.height

    def frame(self, title: str) -> None:
        bottom = self.top + self.height
        for azimuth in range(0, 361, 45):
            self.drawing.line([(self.x(azimuth), self.top), (self.x(azimuth), bottom)], "grid")
            self.drawing.note((self.x(azimuth), bottom + 16), f"{azimuth}°", anchor="middle")
        step = _step((self.high - self.low) / 3)
        for k in range(math.ceil(self.low / step), math.floor(self.high / step) + 1):
            self.drawing.line([(LEFT, self.y(k * step)), (WIDTH - RIGHT, self.y(k * step))], "grid")
            self.drawing.note((LEFT - 6, self.y(k * step) + 4), f"{k * step:.6g}", anchor="end")
        self.drawing.note((LEFT, self.top - 6), title, "curve")

    def line(
        self, azimuths: Sequence[float] | Floats, values: Sequence[float] | Floats, colour: str, width: float
    ) -> None:
        """A line through azimuths of any turn: it leaves on one side and comes back on the other."""
        along, upwards = np.asarray(azimuths, dtype=np.float64), np.asarray(values, dtype=np.float64)
        number = np.arange(len(along))
        # with points where the line leaves and comes back
        at = np.concatenate([number, *(_crossings(along, 360 * turn) for turn in _turns(along))])
        along, upwards = (np.interp(np.sort(at), number, of) for of in (along, upwards))
        for turn in _turns(along):
            here = along - 360 * turn
            inside = (here > -1e-6) & (here < 360 + 1e-6)
            for part in np.split(np.arange(len(here)), np.flatnonzero(np.diff(inside)) + 1):
                if inside[part[0]]:
                    points = [(self.x(float(here[k])), self.y(float(upwards[k]))) for k in part]
                    self.drawing.line(points, colour, width)


def _turns(azimuths: Floats) -> range:
    return range(math.floor(azimuths.min() / 360), math.floor(azimuths.max() / 360) + 1)


def _crossings(azimuths: Floats, at: float) -> Floats:
    """The positions along a line, in points, at which it passes an azimuth."""
    before = azimuths[:-1] - at
    (k,) = np.nonzero(before * (azimuths[1:] - at) < 0)
    crossings: Floats = k - before[k] / np.diff(azimuths)[k]
    return crossings


def _step(about: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is at most ``about``."""
    power = 10.0 ** math.floor(math.log10(about))
    return max(power * factor for factor in (1, 2, 5) if power * factor <= about)
