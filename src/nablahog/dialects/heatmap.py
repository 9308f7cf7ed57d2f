"""A heat map of distances in shades of gray, with numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from .distances import SAME, UNRELATED

CELL, MARGIN, HEAD, FOOT = 64, 14, 14, 76  # pixels
TEXT = 16
DARKEST = 0.92  # of black, for √2
TICKS = (0.0, 0.03, 0.1, 0.3, 0.6, 1.0, UNRELATED)


def heat_map(distances: NDArray[np.float64], names: Sequence[str]) -> NDArray[np.float64]:
    """Draws a matrix of distances: dark is large; with the numbers, and a scale below.

    Args:
        distances: (n, n), symmetric, in 0…√2.
        names: of the rows and columns.

    Returns:
        (H, W) in 0…1.
    """
    font, small = ImageFont.load_default(TEXT), ImageFont.load_default(TEXT - 2)
    longest = math.ceil(max(font.getlength(name) for name in names))
    left, top, side = 2 * MARGIN + longest, HEAD + MARGIN + longest, CELL * len(names)
    width = max(left + side + MARGIN, left + 5 * CELL)
    picture = Image.new("L", (width, top + side + FOOT), 255)
    draw = ImageDraw.Draw(picture)
    for i, name in enumerate(names):
        middle = top + round((i + 0.5) * CELL)
        draw.text((left - MARGIN, middle), name, fill=0, font=font, anchor="rm")
        title = _rotated(name, font)
        picture.paste(title, (left + round((i + 0.5) * CELL) - TEXT, top - MARGIN - title.height))
        for j in range(len(names)):
            box = (left + j * CELL, top + i * CELL, left + (j + 1) * CELL - 2, top + (i + 1) * CELL - 2)
            shade = _shade(distances[i, j])
            draw.rectangle(box, fill=round(255 * shade), outline=170)
            if i != j:
                at = ((box[0] + box[2]) / 2, (box[1] + box[3]) / 2)
                draw.text(at, _label(distances[i, j]), fill=0 if shade > 0.5 else 255, font=small, anchor="mm")
    _scale(draw, left, top + side + 24, max(side, 5 * CELL - MARGIN) - 2, small)
    levels: NDArray[np.float64] = np.asarray(picture, dtype=np.float64) / 255
    return levels


def _shade(distance: float) -> float:
    """1 is white; by the square root, so that small distances can be distinguished."""
    return 1 - DARKEST * math.sqrt(min(distance / UNRELATED, 1.0))


def _label(distance: float) -> str:
    if distance <= SAME:
        return "0"
    return f"{distance:.3f}" if distance >= 0.0005 else "< .001"


def _rotated(text: str, font: ImageFont.FreeTypeFont | ImageFont.ImageFont) -> Image.Image:
    """Text rotated by 90°, from bottom to top."""
    line = Image.new("L", (math.ceil(font.getlength(text)), 2 * TEXT), 255)
    ImageDraw.Draw(line).text((0, TEXT), text, fill=0, font=font, anchor="lm")
    return line.transpose(Image.Transpose.ROTATE_90)


def _scale(
    draw: ImageDraw.ImageDraw, left: int, top: int, width: int, font: ImageFont.FreeTypeFont | ImageFont.ImageFont
) -> None:
    for column in range(width):
        shade = 1 - DARKEST * column / (width - 1)
        draw.line((left + column, top, left + column, top + 16), fill=round(255 * shade))
    draw.rectangle((left, top, left + width - 1, top + 16), outline=0)
    for tick in TICKS:
        x = left + (width - 1) * math.sqrt(tick / UNRELATED)
        draw.line((x, top + 16, x, top + 21), fill=0)
        anchor = "la" if tick == 0 else "ra" if tick == UNRELATED else "ma"
        label = {0.0: "0 equal", UNRELATED: f"{UNRELATED:.2f} unrelated"}.get(tick, f"{tick:g}")
        draw.text((x, top + 24), label, fill=0, font=font, anchor=anchor)
