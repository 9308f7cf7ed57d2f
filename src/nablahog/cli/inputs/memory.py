"""The option ``--memory``: files of a few bytes can stand for images that no machine has room for."""

from __future__ import annotations

import math

from ...hog import HOGSpec
from ...viz.pictures import CELL_PIXELS, STRIP_PIXELS, cell_width

GIGABYTE = 10**9
PER_PIXEL = 320  # bytes of an inversion, by measurement: 150 to 310
PER_NUMBER = 130  # and of each number of the descriptor
PER_GLYPH_PIXEL = 48  # of the picture of glyphs, and of that of each stroke
PER_STRIPED_PIXEL = 8  # of the picture, where it is drawn in strips, by measurement: 6, with the photograph


def check_inversion(path: str, image_size: tuple[int, int], numbers: int, gigabytes: int) -> None:
    """Raises ValueError if the inversion of a descriptor needs more than so many gigabytes.

    Args:
        path: of the file, for the message.
        image_size: (height, width) of the image.
        numbers: of the descriptor.
        gigabytes: the limit, of the option ``--memory``.
    """
    what = f"inverting a descriptor of an image of {image_size[0]}x{image_size[1]} pixels"
    _check(path, what, PER_PIXEL * math.prod(image_size) + PER_NUMBER * numbers, gigabytes)


def check_glyphs(path: str, shape: tuple[int, ...], spec: HOGSpec, gigabytes: int) -> None:
    """Raises ValueError if drawing a descriptor of this shape, (rows, cols, channels), needs more."""
    rows, cols, channels = shape
    pixels = (rows * cols + channels) * CELL_PIXELS * cell_width(spec, CELL_PIXELS)
    _check(path, _drawing(rows, cols, spec), PER_GLYPH_PIXEL * pixels, gigabytes)


def check_glyph_image(path: str, shape: tuple[int, ...], spec: HOGSpec, gigabytes: int) -> None:
    """As :func:`check_glyphs`, for a picture that is drawn in strips."""
    rows, cols, channels = shape
    cell = CELL_PIXELS * cell_width(spec, CELL_PIXELS)
    strip = min(rows * cols * cell, max(cols * cell, STRIP_PIXELS))
    needed = PER_STRIPED_PIXEL * rows * cols * cell + PER_GLYPH_PIXEL * (strip + channels * cell)
    _check(path, _drawing(rows, cols, spec), needed, gigabytes)


def _drawing(rows: int, cols: int, spec: HOGSpec) -> str:
    return f"drawing {rows}x{cols} cells, each for {spec.cell_size[0]}x{spec.cell_size[1]} pixels,"


def _check(path: str, what: str, needed: int, gigabytes: int) -> None:
    if needed > gigabytes * GIGABYTE:
        least = math.ceil(needed / GIGABYTE)
        raise ValueError(
            f"{path}: {what} needs about {least} GB of memory, and {gigabytes} GB are allowed: expected "
            f"--memory {least} where there is so much"
        )
