"""The pixels of PIL images, a strip of rows at a time, so that a file can be shrunk without the whole as floats.

All that reads photographs goes through here, files and images that people have opened themselves, so that both give the
same numbers: upright (EXIF orientation), over white where they are transparent, of 8 or 16 bits or floats.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..runtime.text import one_line

if TYPE_CHECKING:
    from PIL.Image import Image

CONVERTED_PIXELS = 2**19  # pixels that are converted at once
_GRAY_MODES = ("1", "L", "LA", "La")
_WHITE_IS_ZERO = 0  # as TIFF's tag has it
_FILTER_OVERSHOOT = 0.1  # of filters, as a fraction of the largest level: it is clipped
_BRIGHTEST_OF_255 = 16.0  # least highest level in 0…255: else the image would be black, or of high dynamic range
_SMALLER = 1  # of an image that stands for a larger one, as TIFF's tag has it
_KIND_OF_IMAGE, _BITS_PER_SAMPLE, _PHOTOMETRIC_INTERPRETATION, _SAMPLE_FORMAT = 254, 258, 262, 339  # tags of TIFF
_SMALLER_IMAGES = 330  # the tag SubIFDs
PREVIEW = "its first image is a preview, as in raw photographs; develop or convert it first, and save it as PNG"


def is_pil(image: object) -> bool:
    """True for a PIL image.  Does not import PIL."""
    pil = sys.modules.get("PIL.Image")
    return pil is not None and isinstance(image, pil.Image)


def tiff_tags(image: Image) -> dict[int, Any]:
    """The tags of an image from a TIFF file; none of others, or of what Pillow has made of one."""
    return getattr(image, "tag_v2", {})


def is_preview(image: Image) -> bool:
    """Whether the image, the first of a TIFF file, stands for a larger one in the file, as that of a raw photograph."""
    tags = tiff_tags(image)
    return tags.get(_KIND_OF_IMAGE) == _SMALLER and (_SMALLER_IMAGES in tags or getattr(image, "n_frames", 1) > 1)


def upright(image: Image) -> Image:
    """The image as its EXIF orientation says that it is seen; itself where it has none."""
    from PIL import ImageOps

    with suppress(Exception):  # damaged EXIF data says nothing about the pixels
        if image.getexif().get(0x0112, 1) != 1:
            return ImageOps.exif_transpose(image)
    return image


def load_pixels(name: str, image: Image) -> None:
    """Reads the file of a PIL image that was opened, as Pillow does only when its pixels are asked for.

    Raises:
        ValueError: the file is damaged, or was closed before it was read.
    """
    try:
        image.load()
    except (OSError, ValueError, SyntaxError, AssertionError, AttributeError) as error:
        came = f"a damaged file, {one_line(error)}" if isinstance(error, OSError) else "one whose file is closed"
        raise ValueError(
            f"{name} must be a PIL image whose pixels can be read, got {came}: write image.load() before the file is "
            "closed, or open a whole file"
        ) from None


def pil_pixels(name: str, image: Image) -> NDArray[Any]:
    """The pixels of a PIL image, upright and over white, (H, W) if it is gray, or (H, W, 3).

    They are uint8 where the image has 8 bits a channel and nothing transparent, else float32 in 0…1.

    Raises:
        ValueError: its levels are none of a photograph; it is the preview of a raw one; its file is damaged or was
            closed before it was read; or it has integers of 32 bits (mode I) and comes from no file, so that nothing
            says which of them is white.
    """
    load_pixels(name, image)
    if is_preview(image):
        raise ValueError(f"{name} as a PIL image: {PREVIEW}")
    if image.mode == "I" and image.format is None:
        raise ValueError(
            f"{name} as a PIL image of mode I says nothing about white: write np.asarray(image, np.float32) / 65535, "
            "or / 255 if white is 255"
        )
    image, tags = upright(image), tiff_tags(image)
    if has_8_bits(image) and not image.has_transparency_data:
        return np.array(image.convert("L" if image.mode in _GRAY_MODES else "RGB"))
    try:
        pixels = np.concatenate(list(pixel_values(image, tags)))
    except ValueError as error:
        raise ValueError(f"{name} as a PIL image of mode {image.mode}: {error}") from None
    return pixels[..., 0] if pixels.shape[-1] == 1 else pixels


def has_8_bits(image: Image) -> bool:
    """Whether no channel has more than 8 bits."""
    # a 16-bit PNG has the mode I or I;16, depending on Pillow
    return image.mode not in ("I", "F") and not image.mode.startswith("I;16")


def pixel_values(image: Image, tags: dict[int, Any]) -> Iterator[NDArray[np.float32]]:
    """Strips (rows, W, C) of some rows, in 0…1, from the top; C is 1 for gray images, or 3.

    Args:
        image: upright.
        tags: those of its TIFF file, :func:`tiff_tags`, which a turned image has lost.

    Raises:
        ValueError: the levels are none of those that :func:`nablahog.io.images.read_image` takes.
    """
    if has_8_bits(image):
        yield from map(_scale_8_bits, _cut_strips(image))
        return
    # Pillow reads unsigned numbers of 32 bits as signed ones
    unsigned = tags.get(_BITS_PER_SAMPLE) == (32,) and tags.get(_SAMPLE_FORMAT, (1,)) == (1,)
    kind = np.uint32 if image.mode == "I" and unsigned else None
    # strip by strip, as their numbers are copied
    bounds = [(float(numbers.min()), float(numbers.max())) for numbers in _strip_numbers(image, kind)]
    lowest, highest = min(low for low, _ in bounds), max(high for _, high in bounds)
    if any(math.isnan(high) for _, high in bounds):
        raise ValueError("expected levels in 0…1 or 0…255, got NaN")
    largest = _find_white(lowest, highest) if image.mode == "F" else 65535
    if image.mode != "F" and not 0 <= lowest <= highest <= largest:
        raise ValueError(f"expected levels in 0…{largest}, got {lowest:.0f} … {highest:.0f}")
    transparent = image.info.get("transparency")
    for numbers in _strip_numbers(image, kind):
        scaled = numbers.clip(0, largest).astype(np.float32)[..., np.newaxis]
        scaled /= np.float32(largest)
        if tags.get(_PHOTOMETRIC_INTERPRETATION) == _WHITE_IS_ZERO:  # Pillow itself inverts levels of 8 bits
            scaled = 1 - scaled
        if isinstance(transparent, int):  # of a PNG file
            scaled[numbers == transparent] = 1
        yield scaled


def _find_white(lowest: float, highest: float) -> int:
    """The level of white, 1 or 255, of floats from the lowest to the highest."""
    for largest, least in ((1, -math.inf), (255, _BRIGHTEST_OF_255)):
        if highest >= least and -_FILTER_OVERSHOOT * largest <= lowest and highest <= (1 + _FILTER_OVERSHOOT) * largest:
            return largest
    raise ValueError(f"expected levels in 0…1 or 0…255, got {lowest:g} … {highest:g}")


def _cut_strips(image: Image) -> Iterator[Image]:
    rows = max(1, CONVERTED_PIXELS // image.width)
    for y in range(0, image.height, rows):
        yield image.crop((0, y, image.width, min(y + rows, image.height)))


def _strip_numbers(image: Image, kind: type[np.generic] | None) -> Iterator[NDArray[Any]]:
    for strip in _cut_strips(image):
        yield np.asarray(strip) if kind is None else np.asarray(strip).view(kind)


def _scale_8_bits(image: Image) -> NDArray[np.float32]:
    """(rows, W, C) of an image of 1 or 8 bits a channel."""
    gray = image.mode in _GRAY_MODES
    if image.has_transparency_data:
        rgba = _scale(image.convert("LA" if image.mode == "La" else "RGBA"))
        alpha = rgba[..., -1:]
        over_white = rgba[..., :-1] * alpha + (1 - alpha)
        return over_white[..., :1] if gray else over_white
    scaled = _scale(image.convert("L" if gray else "RGB"))
    return scaled[..., np.newaxis] if gray else scaled


def _scale(image: Image) -> NDArray[np.float32]:
    scaled = np.asarray(image).astype(np.float32)
    scaled /= np.float32(255)
    return scaled
