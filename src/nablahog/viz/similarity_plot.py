"""Pictures of poses for people: boxes, and the paper's figure of similarity and its derivative by azimuth."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from ..io.images import Picture, to_pil
from .pictures import RED

Colour = tuple[int, int, int]
Floats = NDArray[np.floating]

FINER = 3  # drawn so much larger, then shrunk, since Pillow's lines are jagged
WIDTH, LEFT, RIGHT = 960, 64, 24
HEIGHTS = 240, 140  # of similarity and derivative
HEAD, FOOT, VIEW = 24, 20, 96
_CURVE, _DIFFERENCE, _PATH, _GRID, _TEXT = (24, 74, 150), (150, 150, 150), (222, 130, 20), (225, 225, 225), (40, 40, 40)
_MARK: Colour = (round(255 * RED[0]), round(255 * RED[1]), round(255 * RED[2]))


def boxed(picture: Picture, boxes: Sequence[Sequence[float]]) -> NDArray[np.float64]:
    """A picture with red boxes drawn on it.

    Args:
        picture: (H, W), (1, H, W) or (3, H, W) in 0…1.
        boxes: x0, y0, x1, y1 in pixels, see :class:`~nablahog.hog.box.Box`; what is beyond the picture is not seen.

    Returns:
        (3, H, W) in 0…1.
    """
    drawn = to_pil(picture).convert("RGB")
    draw = ImageDraw.Draw(drawn)
    for x0, y0, x1, y1 in boxes:
        draw.rectangle((round(x0), round(y0), round(x1) - 1, round(y1) - 1), outline=_MARK, width=2)
    return _picture(drawn)


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
) -> NDArray[np.float64]:
    """Similarity and, below it, its derivative over all azimuths.

    Args:
        similarities, derivatives: (N,), at N equidistant azimuths from 0°, the latter per degree.
        differences: (N,), what the derivatives are compared with, drawn in gray behind them.
        what: kind of similarity.
        how: what the differences are, and how well they agree.
        azimuth: to mark, degrees.
        traces: of searches: azimuths in degrees, of any turn, and similarities, drawn into the upper part.
        views: equidistant from 0°, drawn below, square.

    Returns:
        (3, H, W) in 0…1.
    """
    strip = VIEW + 8 if views else 0
    height, middle = 2 * HEAD + sum(HEIGHTS) + 3 * FOOT + strip, (LEFT + WIDTH - RIGHT) / 2
    picture = Image.new("RGB", (WIDTH * FINER, height * FINER), "white")
    draw = ImageDraw.Draw(picture)
    of_traces = [np.asarray(values) for _, values in traces]
    top = _Axes(draw, HEAD, HEIGHTS[0], np.concatenate([similarities, *of_traces]))
    low = _Axes(draw, 2 * HEAD + HEIGHTS[0] + FOOT, HEIGHTS[1], np.concatenate([derivatives, differences, [0.0]]))
    top.frame(f"similarity, {what}")
    low.frame("its derivative, per degree")
    _note(draw, WIDTH - RIGHT, low.top - 4, how, _DIFFERENCE, "rb")
    for axes in (top, low):
        axes.line([azimuth, azimuth], [axes.low, axes.high], _MARK, 2)
    low.line([0.0, 360.0], [0.0, 0.0], _TEXT, 1)
    if traces:
        _note(draw, middle, HEAD - 4, "paths of the search; rings: starts", _PATH, "mb")
    for azimuths, values in traces:
        top.line(azimuths, values, _PATH, 1.5)
    around = np.linspace(0, 360, len(similarities) + 1)
    top.line(around, np.append(similarities, similarities[0]), _CURVE, 2)
    low.line(around, np.append(differences, differences[0]), _DIFFERENCE, 3)
    low.line(around, np.append(derivatives, derivatives[0]), _CURVE, 1.5)
    for azimuths, values in traces:
        top.ring(azimuths[0], values[0], _PATH)
    _note(draw, WIDTH - RIGHT, HEAD - 4, f"found: {azimuth:.1f}°", _MARK, "rb")
    _note(draw, middle, height - strip - 8, "azimuth of the camera", _TEXT, "mb")
    for k, view in enumerate(views):
        shown = to_pil(view).convert("RGB").resize((VIEW * FINER, VIEW * FINER), Image.Resampling.LANCZOS)
        left = top.x(360 * k / len(views)) - VIEW / 2
        picture.paste(shown, (round(left * FINER), (height - strip) * FINER))
    return _picture(picture.resize((WIDTH, height), Image.Resampling.LANCZOS))


class _Axes:
    """A part of the figure: 0 … 360° across, and upwards from the least of ``values`` to the largest."""

    def __init__(self, draw: ImageDraw.ImageDraw, top: int, height: int, values: Floats) -> None:
        self.draw, self.top, self.height = draw, top, height
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
            _stroke(self.draw, [(self.x(azimuth), self.top), (self.x(azimuth), bottom)], _GRID, 1)
            _note(self.draw, self.x(azimuth), bottom + 4, f"{azimuth}°", _TEXT, "mt")
        step = _step((self.high - self.low) / 3)
        for k in range(math.ceil(self.low / step), math.floor(self.high / step) + 1):
            _stroke(self.draw, [(LEFT, self.y(k * step)), (WIDTH - RIGHT, self.y(k * step))], _GRID, 1)
            _note(self.draw, LEFT - 6, self.y(k * step), f"{k * step:.6g}", _TEXT, "rm")
        _note(self.draw, LEFT, self.top - 4, title, _CURVE, "lb")

    def line(
        self, azimuths: Sequence[float] | Floats, values: Sequence[float] | Floats, fill: Colour, width: float
    ) -> None:
        """Of azimuths of any turn: it leaves on one side and comes back on the other."""
        along, upwards = np.asarray(azimuths, dtype=np.float64), np.asarray(values, dtype=np.float64)
        number = np.arange(len(along))
        # one point more where it leaves and comes back
        at = np.concatenate([number, *(_crossings(along, 360 * turn) for turn in _turns(along))])
        along, upwards = (np.interp(np.sort(at), number, of) for of in (along, upwards))
        for turn in _turns(along):
            here = along - 360 * turn
            inside = (here > -1e-6) & (here < 360 + 1e-6)
            for part in np.split(np.arange(len(here)), np.flatnonzero(np.diff(inside)) + 1):
                if inside[part[0]]:
                    _stroke(self.draw, [(self.x(here[k]), self.y(upwards[k])) for k in part], fill, width)

    def ring(self, azimuth: float, value: float, colour: Colour) -> None:
        x, y = self.x(azimuth % 360), self.y(value)
        corners = tuple(FINER * side for side in (x - 5, y - 5, x + 5, y + 5))
        self.draw.ellipse(corners, fill=(255, 255, 255), outline=colour, width=2 * FINER)


def _turns(azimuths: Floats) -> range:
    return range(math.floor(azimuths.min() / 360), math.floor(azimuths.max() / 360) + 1)


def _crossings(azimuths: Floats, at: float) -> Floats:
    """Where, in numbers of points, a line passes an azimuth."""
    before = azimuths[:-1] - at
    (k,) = np.nonzero(before * (azimuths[1:] - at) < 0)
    crossings: Floats = k - before[k] / np.diff(azimuths)[k]
    return crossings


def _step(about: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is at most ``about``."""
    power = 10.0 ** math.floor(math.log10(about))
    return max(power * factor for factor in (1, 2, 5) if power * factor <= about)


def _stroke(draw: ImageDraw.ImageDraw, points: Sequence[tuple[float, float]], fill: Colour, width: float) -> None:
    draw.line([(x * FINER, y * FINER) for x, y in points], fill=fill, width=round(width * FINER), joint="curve")


def _note(draw: ImageDraw.ImageDraw, x: float, y: float, text: str, fill: Colour, anchor: str) -> None:
    font = ImageFont.load_default(12 * FINER)
    draw.text((x * FINER, y * FINER), text, fill=fill, font=font, anchor=anchor)


def _picture(image: Image.Image) -> NDArray[np.float64]:
    levels: NDArray[np.float64] = np.asarray(image).transpose(2, 0, 1) / 255
    return levels
