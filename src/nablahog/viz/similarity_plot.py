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
TANGENT_REACH = 15.0  # degrees of azimuth, on each side
LEAST_LABEL_WIDTH = 40.0  # pixels between labels of azimuths


def draw_boxes(
    picture: Picture, boxes: Sequence[Sequence[float]], colour: tuple[float, float, float] = RED
) -> NDArray[np.float64]:
    """A picture in 0…1 as (3, H, W) with boxes x0, y0, x1, y1 in pixels; what is beyond the picture is not seen."""
    red, green, blue = (round(255 * part) for part in colour)
    drawn = to_pil(picture).convert("RGB")
    draw = ImageDraw.Draw(drawn)
    for x0, y0, x1, y1 in boxes:
        draw.rectangle((round(x0), round(y0), round(x1) - 1, round(y1) - 1), outline=(red, green, blue), width=2)
    picture_with_boxes: NDArray[np.float64] = np.asarray(drawn).transpose(2, 0, 1) / 255
    return picture_with_boxes


def draw_by_azimuth(
    similarities: Floats,
    derivatives: Floats,
    *,
    kind: str,
    azimuth: float,
    traces: Sequence[tuple[Sequence[float], Sequence[float]]] = (),
    views: Sequence[Picture] = (),
) -> Drawing:
    """The paper's figure: similarity and, below it, its derivative over all azimuths.

    Args:
        similarities, derivatives: (N,), at N equidistant azimuths from 0°, the latter per degree.
        kind: the kind of similarity.
        azimuth: to mark, degrees.
        traces: of searches: azimuths in degrees, of any turn, and similarities, drawn into the upper part.
        views: equidistant from 0°, drawn below, square.
    """
    best = 360 * int(np.argmax(similarities)) / len(similarities)
    description = f"The similarity, {kind}, is largest at an azimuth of {best:g}°; the pose found has {azimuth:.1f}°."
    plot = SimilarityPlot(
        np.concatenate([similarities, *(np.asarray(values) for _, values in traces)]),
        derivatives,
        description,
        title=f"similarity, {kind}",
        foot=VIEW + 8 if views else 0,
    )
    drawing, top = plot.drawing, plot.top
    plot.mark(azimuth, "found")
    if traces:
        middle = (LEFT + drawing.width - RIGHT) / 2
        drawing.note((middle, HEAD - 6), "paths of the search; rings: starts", "path", "middle")
    for azimuths, values in traces:
        top.line(azimuths, values, "path", 1.5)
    plot.curve(similarities, derivatives)
    for azimuths, values in traces:
        drawing.dot((top.x(azimuths[0] % 360), top.y(values[0])), "path", 5, ringed=True)
    for k, view in enumerate(views):
        drawing.image((top.x(360 * k / len(views)) - VIEW / 2, plot.bottom), VIEW, view)
    return drawing


class SimilarityPlot:
    """A drawing of similarity and, below it, of its derivative over all azimuths; parts are added from the back.

    Attributes:
        drawing: with the axes, labelled.
        top, low: the axes of the similarity and of its derivative.
        bottom: the height above the ``foot`` pixels that are left free.
    """

    def __init__(
        self,
        similarities: Floats,
        derivatives: Floats,
        description: str,
        *,
        title: str = "similarity",
        width: int = WIDTH,
        heights: tuple[int, int] = HEIGHTS,
        foot: int = 0,
    ) -> None:
        self.bottom = 2 * HEAD + sum(heights) + 3 * FOOT
        self.drawing = Drawing(width, self.bottom + foot, "Similarity and its derivative by azimuth", description)
        self.top = _Axes(self.drawing, HEAD, heights[0], similarities)
        self.low = _Axes(self.drawing, 2 * HEAD + heights[0] + FOOT, heights[1], np.append(derivatives, 0.0))
        self.top.frame(title)
        self.low.frame("its derivative, per degree")
        self.drawing.note(((LEFT + width - RIGHT) / 2, self.bottom - 10), "azimuth of the camera", anchor="middle")

    def mark(self, azimuth: float, label: str) -> None:
        """Marks an azimuth in both parts, and the derivative's zero."""
        for axes in (self.top, self.low):
            axes.line([azimuth, azimuth], [axes.least, axes.largest], "mark", 2)
        self.low.line([0.0, 360.0], [0.0, 0.0], "text", 1)
        corner = (self.drawing.width - RIGHT, HEAD - 6)
        self.drawing.note(corner, f"{label}: {azimuth:.1f}°", "mark", "end")

    def curve(self, similarities: Floats, derivatives: Floats, colour: str = "curve") -> None:
        """Draws similarities and derivatives at N equidistant azimuths from 0°; NaN where they are not yet known."""
        self.top.closed_line(similarities, colour, 2)
        self.low.closed_line(derivatives, colour, 1.5)

    def tangent(self, azimuth: float, similarity: float, derivative: float) -> None:
        """Draws a point in both parts, with its tangent in the upper one, which ends where that part does."""
        room = min(self.top.largest - similarity, similarity - self.top.least)
        reach = min(TANGENT_REACH, room / max(abs(derivative), 1e-12))
        azimuths = [azimuth - reach, azimuth + reach]
        self.top.line(azimuths, [similarity - reach * derivative, similarity + reach * derivative], "path", 2)
        for axes, value in ((self.top, similarity), (self.low, derivative)):
            self.drawing.dot((axes.x(azimuth), axes.y(value)), "path", 5)


class _Axes:
    """A part of the figure: 0 … 360° across, and upwards from the least of ``values`` to the largest."""

    def __init__(self, drawing: Drawing, top: int, height: int, values: Floats) -> None:
        self.drawing, self.top, self.height = drawing, top, height
        least, largest = float(np.nanmin(values)), float(np.nanmax(values))
        margin = 0.05 * (largest - least) or 1.0
        self.least, self.largest = least - margin, largest + margin
        self.right = drawing.width - RIGHT

    def x(self, azimuth: float) -> float:
        return LEFT + azimuth / 360 * (self.right - LEFT)

    def y(self, value: float) -> float:
        return self.top + (self.largest - value) / (self.largest - self.least) * self.height

    def frame(self, title: str) -> None:
        bottom = self.top + self.height
        for azimuth in range(0, 361, 45 if self.x(45) - self.x(0) >= LEAST_LABEL_WIDTH else 90):
            self.drawing.line([(self.x(azimuth), self.top), (self.x(azimuth), bottom)], "grid")
            self.drawing.note((self.x(azimuth), bottom + 16), f"{azimuth}°", anchor="middle")
        step = _choose_step((self.largest - self.least) / 3)
        for k in range(math.ceil(self.least / step), math.floor(self.largest / step) + 1):
            self.drawing.line([(LEFT, self.y(k * step)), (self.right, self.y(k * step))], "grid")
            self.drawing.note((LEFT - 6, self.y(k * step) + 4), f"{k * step:.6g}", anchor="end")
        self.drawing.note((LEFT, self.top - 6), title, "curve")

    def line(
        self, azimuths: Sequence[float] | Floats, values: Sequence[float] | Floats, colour: str, width: float
    ) -> None:
        """A line through azimuths of any turn: it leaves on one side and comes back on the other."""
        along, upwards = np.asarray(azimuths, dtype=np.float64), np.asarray(values, dtype=np.float64)
        number = np.arange(len(along))
        # with points where the line leaves and comes back
        positions = np.concatenate([number, *(_crossings(along, 360 * turn) for turn in _turns(along))])
        along, upwards = (np.interp(np.sort(positions), number, values) for values in (along, upwards))
        for turn in _turns(along):
            here = along - 360 * turn
            inside = (here > -1e-6) & (here < 360 + 1e-6) & np.isfinite(upwards)
            for part in np.split(np.arange(len(here)), np.flatnonzero(np.diff(inside)) + 1):
                if inside[part[0]] and len(part) > 1:
                    points = [(self.x(float(here[k])), self.y(float(upwards[k]))) for k in part]
                    self.drawing.line(points, colour, width)

    def closed_line(self, values: Floats, colour: str, width: float) -> None:
        """A line through values at equidistant azimuths from 0°, once around."""
        self.line(np.linspace(0, 360, len(values) + 1), np.append(values, values[0]), colour, width)


def _turns(azimuths: Floats) -> range:
    return range(math.floor(azimuths.min() / 360), math.floor(azimuths.max() / 360) + 1)


def _crossings(azimuths: Floats, azimuth: float) -> Floats:
    """The positions along a line, in points, at which it passes an azimuth."""
    before = azimuths[:-1] - azimuth
    (k,) = np.nonzero(before * (azimuths[1:] - azimuth) < 0)
    crossings: Floats = k - before[k] / np.diff(azimuths)[k]
    return crossings


def _choose_step(about: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is at most ``about``."""
    power = 10.0 ** math.floor(math.log10(about))
    return max(power * factor for factor in (1, 2, 5) if power * factor <= about)
