"""Image files decoded, upright; their pixels are read in :mod:`nablahog.inputs.pil_images`."""

from __future__ import annotations

import io
import os
from contextlib import suppress
from functools import cache
from typing import Any

from PIL import Image, ImageOps
from PIL.TiffImagePlugin import BITSPERSAMPLE, PLANAR_CONFIGURATION

from ..inputs.pil_images import PREVIEW, is_preview, tiff_tags
from ..runtime.text import one_line
from .input_file import InputFile

MAX_IMAGE_BYTES = 2**30  # of a file; the largest images that are read have fewer
PIXELS_VARIABLE = "NABLAHOG_MAX_PIXELS"
_PLANES = 2  # as TIFF's tag has it
_JPEG, _JPEG_END = b"\xff\xd8", b"\xff\xd9"
_JPEG_2000 = (b"\0\0\0\x0cjP  ", b"\xff\x4f\xff\x51")  # alone or in boxes; its end is that of JPEG
_CANON = slice(8, 10), b"CR"  # in the head of a CR2 file, whose first image is a JPEG preview


@cache
def prepare_pillow() -> None:
    """Lets Pillow read HEIC and AVIF by pillow-heif, where it is installed, and as many pixels as the user allows.

    Raises:
        ValueError: the environment variable :data:`PIXELS_VARIABLE` is not a number of pixels.
    """
    allowed = os.environ.get(PIXELS_VARIABLE)
    if allowed:
        if not allowed.isdecimal() or int(allowed) < 1:
            raise ValueError(f"{PIXELS_VARIABLE} must be a number of pixels, got {one_line(allowed)!r}")
        Image.MAX_IMAGE_PIXELS = (int(allowed) + 1) // 2  # Pillow refuses twice as many
    with suppress(ImportError):
        import pillow_heif

        pillow_heif.register_heif_opener()


def decode_image(file: InputFile) -> Image.Image:
    """The image in a file, upright; raises whatever Pillow does if it is damaged."""
    prepare_pillow()
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
        tags = tiff_tags(image)
        if is_preview(image) or (tags and data[_CANON[0]] == _CANON[1]):
            raise ValueError(PREVIEW)
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
