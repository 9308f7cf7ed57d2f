"""Images of PIL: every mode, transparency, 16 bits, and photographs that a camera has turned."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..table import Row
from .arrays import AS_SKIMAGE, levels

ORIENTATION = 0x0112  # EXIF's tag
NO_FILE = dict.fromkeys(("command", "page"), "read files themselves")
TURNED_BACK = {3: 2, 6: 3, 8: 1}  # quarters of a turn, counter-clockwise, that make it upright


def gray(x: NDArray[Any]) -> Image.Image:
    return Image.fromarray(levels(x).astype(np.uint8))


def colours(x: NDArray[Any]) -> NDArray[Any]:
    """(H, W, 3) of three different channels, in 0…1."""
    return np.stack([x, x[::-1], x[:, ::-1]], axis=-1)


def coloured(x: NDArray[Any]) -> Image.Image:
    return Image.fromarray(levels(colours(x)).astype(np.uint8))


def half_a_file(x: NDArray[Any]) -> Image.Image:
    file = io.BytesIO()
    gray(x).save(file, "PNG")
    return Image.open(io.BytesIO(file.getvalue()[: len(file.getvalue()) // 2]))


def closed(x: NDArray[Any]) -> Image.Image:
    """Opened in a ``with`` that has ended, and not read there."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "a.png")
        gray(x).save(path)
        with Image.open(path) as image:
            return image


def with_alpha(mode: str) -> Callable[[NDArray[Any]], Image.Image]:
    """An image of which the upper half is transparent."""

    def make(x: NDArray[Any]) -> Image.Image:
        image = (gray(x) if mode == "LA" else coloured(x)).convert(mode)
        image.putalpha(
            Image.fromarray(np.where(np.arange(len(x))[:, None] < len(x) // 2, 0, 255 + 0 * levels(x)).astype("u1"))
        )
        return image

    return make


def over_white(x: NDArray[Any]) -> NDArray[Any]:
    """What is seen where the upper half is transparent."""
    x = x.copy()
    x[: len(x) // 2] = 1
    return x


def opaque(mode: str) -> Callable[[NDArray[Any]], Image.Image]:
    return lambda x: coloured(x).convert(mode)


def as_rgb(make: Callable[[NDArray[Any]], Image.Image]) -> Callable[[NDArray[Any]], NDArray[Any]]:
    """What Pillow itself makes of an image: (H, W, 3) in 0…1."""
    return lambda x: np.asarray(make(x).convert("RGB")).astype(np.float32) / np.float32(255)


def reopened(image: Image.Image, form: str = "PNG", **more: Any) -> Image.Image:
    """As Pillow opens it: a subclass for the format, read when its pixels are asked for."""
    file = io.BytesIO()
    image.save(file, format=form, **more)
    return Image.open(io.BytesIO(file.getvalue()))


def turned(orientation: int, make: Callable[[Any], Image.Image]) -> Callable[[Any], Image.Image]:
    """A photograph that is stored turned, with the tag that says how."""

    def opened(x: NDArray[Any]) -> Image.Image:
        exif = Image.Exif()
        exif[ORIENTATION] = orientation
        stored = Image.fromarray(np.rot90(np.asarray(make(x)), -TURNED_BACK[orientation]).copy())
        return reopened(stored, exif=exif)

    return opened


def palette_with_transparency(x: NDArray[Any]) -> Image.Image:
    """A palette of gray levels, of which white is transparent, and shows white."""
    image = gray(x).convert("P")
    image.info["transparency"] = 255
    return reopened(image, transparency=255)


def sixteen(x: NDArray[Any]) -> NDArray[Any]:
    return levels(x, 65535).astype(np.uint16)


def frames(x: NDArray[Any]) -> Image.Image:
    return reopened(gray(x), "TIFF", save_all=True, append_images=[gray(1 - x)])


def lab(x: NDArray[Any]) -> Image.Image:
    return Image.merge("LAB", coloured(x).split())


def quantized(x: NDArray[Any]) -> Image.Image:
    return coloured(x).quantize(64)


MODES = {
    "L": (gray, None),
    "1": (lambda x: gray(x).convert("1", dither=Image.Dither.NONE), lambda x: (levels(x) > 127).astype(np.float32)),
    "P": (lambda x: gray(x).convert("P"), None),
    "P of colours": (quantized, as_rgb(quantized)),
    "RGB": (coloured, colours),
    "RGBA opaque": (opaque("RGBA"), colours),
    "RGBX": (opaque("RGBX"), colours),
    "RGBA half transparent": (with_alpha("RGBA"), lambda x: over_white(colours(x))),
    "LA half transparent": (with_alpha("LA"), over_white),
    "RGBa half transparent": (lambda x: with_alpha("RGBA")(x).convert("RGBa"), lambda x: over_white(colours(x))),
    "P with transparency": (palette_with_transparency, None),
    **{mode: (opaque(mode), as_rgb(opaque(mode))) for mode in ("CMYK", "YCbCr", "HSV")},
    "LAB": (lab, as_rgb(lab)),
    "I;16": (lambda x: Image.fromarray(sixteen(x)), None),
    "I;16B": (lambda x: reopened(Image.fromarray(sixteen(x)), "TIFF", big_endian=True), None),
    "I": (lambda x: Image.fromarray(sixteen(x).astype(np.int32)), None),
    "F": (lambda x: Image.fromarray(np.asarray(x, np.float32)), None),
    "F in 0…255": (lambda x: Image.fromarray(np.asarray(levels(x), np.float32)), None),
}
TAKEN = ("L", "I;16")
FILES = {
    "PNG not read yet": (lambda x: reopened(gray(x)), None),
    "TIFF of two frames": (frames, None),
    "16-bit PNG with a transparent level": (
        lambda x: reopened(Image.fromarray(sixteen(x)), transparency=int(sixteen(x).flat[0])),
        lambda x: np.where(sixteen(x) == sixteen(x).flat[0], 1, x).astype(np.float32),
    ),
}


def row(name: str, make: Callable[[Any], Any], means: Callable[[Any], Any] | None, must: Any = "either") -> Row:
    more = {} if means is None else {"means": means}
    return Row(f"PIL {name}", "image", make, must=must, tolerance=1e-5, leaves_out=AS_SKIMAGE, **more)


ROWS = [
    *[row(name, *pair, "be taken" if name in TAKEN else "either") for name, pair in MODES.items()],
    *[row(name, *pair) for name, pair in FILES.items()],
    *[row(f"L turned, EXIF {tag}", turned(tag, gray), None) for tag in TURNED_BACK],
    row("RGB turned, EXIF 6", turned(6, coloured), colours),
    row("I;16 turned, EXIF 6", turned(6, lambda x: Image.fromarray(sixteen(x))), None),
    Row("PIL of half a file", "image", half_a_file, must="be refused"),
    Row("PIL whose file is closed", "image", closed, must="be refused", leaves_out=NO_FILE),
    Row("PIL in a list", "image", lambda x: [gray(x)]),
    Row("PIL without pixels", "image", lambda x: Image.new("L", (0, 0)), must="be refused"),
]
