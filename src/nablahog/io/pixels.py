"""The pixels of image files as floats in 0…1, a strip of rows at a time: the whole is never copied as floats."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps
from PIL.TiffImagePlugin import BITSPERSAMPLE, PHOTOMETRIC_INTERPRETATION, PLANAR_CONFIGURATION, SAMPLEFORMAT

from .input_file import InputFile

MAX_IMAGE_BYTES = 2**30  # of a file; the largest images that are read have fewer
CONVERTED_PIXELS = 2**19  # pixels that are converted at once

_GRAY_MODES = ("1", "L", "LA", "La")
_WHITE_IS_ZERO = 0  # as TIFF's tag has it
_FILTER_OVERSHOOT = 0.1  # of filters, as a fraction of the largest level: it is clipped
_BRIGHTEST_OF_255 = 16.0  # least highest level in 0…255: else the image would be black, or of high dynamic range
_PLANES = 2  # as TIFF's tag has it
_JPEG, _JPEG_END = b"\xff\xd8", b"\xff\xd9"
_JPEG_2000 = (b"\0\0\0\x0cjP  ", b"\xff\x4f\xff\x51")  # alone or in boxes; its end is that of JPEG


@cache
def register_heif() -> None:
    """Lets Pillow read HEIC and AVIF as pillow-heif does, where it is installed."""
    with suppress(ImportError):
        import pillow_heif

        pillow_heif.register_heif_opener()


def decode_image(file: InputFile) -> Image.Image:
    """The image in a file, upright; raises whatever Pillow does if it is damaged."""
    register_heif()
    if file.size > MAX_IMAGE_BYTES:
        raise ValueError(f"it has more than {MAX_IMAGE_BYTES:,} bytes")
    # from memory: some decoders allocate as many bytes as a damaged file promises
    data = file.read()
    try:
        return _open(data)
    except OSError:
        if not data.startswith((_JPEG, *_JPEG_2000)):
            raise
        data = data.removesuffix(b"\xff")
        if not data.startswith(_JPEG):
            return _open(data + _JPEG_END)
        # what follows the pixels of a JPEG file changes none of them, unless some are missing
        image, same = (_open(data + other + _JPEG_END) for other in (b"", b"\x55" * 64))
        if "progressive" in image.info or image.tobytes() != same.tobytes():
            raise
        return image


def _open(data: bytes) -> Image.Image:
    image: Image.Image
    with Image.open(io.BytesIO(data)) as image:
        if image.format == "EPS":
            raise ValueError("PostScript is a program, which is never run; convert it to PNG first")
        tags: dict[int, Any] = getattr(image, "tag_v2", {})
        if tags.get(PLANAR_CONFIGURATION) == _PLANES and set(tags.get(BITSPERSAMPLE, ())) == {16}:
            _read_16_bits(image)
        image.load()
        with suppress(Exception):  # damaged EXIF data says nothing about the pixels
            ImageOps.exif_transpose(image, in_place=True)  # without a copy, which may be large
    return image


def _read_16_bits(image: Any) -> None:
    """Lets Pillow read planes of 16 bits, which it takes for planes of 8 unless they are compressed."""
    order = "16B" if image.tag_v2.prefix == b"MM" else "16L"
    image.tile = [
        getattr(type(tile), "_make", tuple)(
            [*tile[:3], (f"{tile[3][0]};{order}", *tile[3][1:])]
        )  # tiles of old Pillow are tuples
        if tile[0] == "raw"
        else tile
        for tile in image.tile
    ]


def has_8_bits(image: Image.Image) -> bool:
    """Whether no channel has more than 8 bits."""
    # a 16-bit PNG has the mode I or I;16, depending on Pillow
    return image.mode not in ("I", "F") and not image.mode.startswith("I;16")


def pixel_values(image: Image.Image) -> Iterator[NDArray[np.float32]]:
    """Strips (rows, W, C) of some rows, in 0…1, from the top; C is 1 for gray images, or 3.

    Raises:
        ValueError: the levels are none of those that :func:`nablahog.io.images.read_image` takes.
    """
    if has_8_bits(image):
        yield from map(_scale_8_bits, _cut_strips(image))
        return
    tags: dict[int, Any] = getattr(image, "tag_v2", {})
    # Pillow reads unsigned numbers of 32 bits as signed ones
    unsigned = tags.get(BITSPERSAMPLE) == (32,) and tags.get(SAMPLEFORMAT, (1,)) == (1,)
    kind = np.uint32 if image.mode == "I" and unsigned else None
    # strip by strip, as their numbers are copied
    bounds = [(float(numbers.min()), float(numbers.max())) for numbers in _strip_numbers(image, kind)]
    lowest, highest = min(low for low, _ in bounds), max(high for _, high in bounds)
    if any(math.isnan(high) for _, high in bounds):
        raise ValueError("expected levels in 0…1 or 0…255, got NaN")
    largest = _find_white(lowest, highest) if image.mode == "F" else 65535
    if image.mode != "F" and not 0 <= lowest <= highest <= largest:
        raise ValueError(f"expected levels in 0…{largest}, got {lowest:.0f} … {highest:.0f}")
    for numbers in _strip_numbers(image, kind):
        scaled = numbers.clip(0, largest).astype(np.float32)[..., np.newaxis]
        scaled /= np.float32(largest)
        # Pillow itself inverts levels of 8 bits
        yield 1 - scaled if tags.get(PHOTOMETRIC_INTERPRETATION) == _WHITE_IS_ZERO else scaled


def _find_white(lowest: float, highest: float) -> int:
    """The level of white, 1 or 255, of floats from the lowest to the highest."""
    for largest, least in ((1, -math.inf), (255, _BRIGHTEST_OF_255)):
        if highest >= least and -_FILTER_OVERSHOOT * largest <= lowest and highest <= (1 + _FILTER_OVERSHOOT) * largest:
            return largest
    raise ValueError(f"expected levels in 0…1 or 0…255, got {lowest:g} … {highest:g}")


def _cut_strips(image: Image.Image) -> Iterator[Image.Image]:
    rows = max(1, CONVERTED_PIXELS // image.width)
    for y in range(0, image.height, rows):
        yield image.crop((0, y, image.width, min(y + rows, image.height)))


def _strip_numbers(image: Image.Image, kind: type[np.generic] | None) -> Iterator[NDArray[Any]]:
    for strip in _cut_strips(image):
        yield np.asarray(strip) if kind is None else np.asarray(strip).view(kind)


def _scale_8_bits(image: Image.Image) -> NDArray[np.float32]:
    """(rows, W, C) of an image of 1 or 8 bits a channel."""
    gray = image.mode in _GRAY_MODES
    if image.has_transparency_data:
        rgba = _scale(image.convert("LA" if image.mode == "La" else "RGBA"))
        alpha = rgba[..., -1:]
        over_white = rgba[..., :-1] * alpha + (1 - alpha)
        return over_white[..., :1] if gray else over_white
    scaled = _scale(image.convert("L" if gray else "RGB"))
    return scaled[..., np.newaxis] if gray else scaled


def _scale(image: Image.Image) -> NDArray[np.float32]:
    scaled = np.asarray(image).astype(np.float32)
    scaled /= np.float32(255)
    return scaled
