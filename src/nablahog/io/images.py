"""Pictures: files to tensors and back, sample photographs, and the focal length that a file names (EXIF)."""

from __future__ import annotations

import math
import os
import re
import warnings
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import ExifTags, Image, ImageDraw, UnidentifiedImageError
from torch import Tensor
from torch.nn import functional

from ..inputs.cameras import LONGEST, SHORTEST
from ..inputs.pil_images import has_8_bits, pixel_values, tiff_tags
from ..runtime.errors import explain
from ..runtime.extras import extra
from ..runtime.text import one_line
from .files import Writable, replacing
from .input_file import InputFile, Readable, input_file
from .pixels import PIXELS_VARIABLE, decode_image, prepare_pillow

Picture: TypeAlias = Tensor | NDArray[np.floating]

SAMPLE_NAMES = ("astronaut", "brick", "camera", "chelsea", "clock", "coffee", "coins", "rocket")
"""Names of the photographs in the wheel of scikit-image."""

_FILM = math.hypot(36, 24)  # millimetres: the diagonal that equivalent focal lengths refer to (CIPA DCG-001)
_MILLIMETRES = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}  # by the unit of the focal plane's resolution
_CUT = 0.01  # relative difference of proportions above which a photograph counts as cropped
_START = 2**16  # bytes that tell whether a file is text of numbers
_UNPROCESSED = re.compile(r" \(\d+ bytes not processed\)")  # Pillow's buffer, not what is missing


def as_array(picture: Picture) -> NDArray[np.float64]:
    """``picture``, a tensor on any device or an array, as a float64 array of the same shape."""
    if isinstance(picture, Tensor):
        picture = picture.detach().cpu().numpy()
    return np.asarray(picture, dtype=np.float64)


def image_endings() -> set[str]:
    """The endings, as ".png", of files that :func:`read_image` reads as images."""
    prepare_pillow()
    return {ending for ending, kind in Image.registered_extensions().items() if kind in Image.OPEN}


def read_image(path: Readable, size: int = 0, *, as_bytes: bool = False) -> Tensor:
    """The picture in a file, of any format that Pillow decodes by itself, or with pillow-heif where that is installed.

    It comes upright (EXIF orientation), over white where it is transparent, and of several frames the first.  Gray
    files (1, 8 or 16 bit, or float) have one channel, all others R, G, B.  A level k of 8 or 16 bits becomes k/255 or
    k/65535, and its negative where the file says that 0 is white.  Float files hold 0…1 or 0…255, which is divided by
    255; what lies outside by less than a tenth, as filters leave it, is clipped.  Colour profiles are not applied.  A
    JPEG or JPEG 2000 file may lack its end marker, if it has all pixels.  The preview in a raw photograph (DNG, NEF,
    CR2) is refused.

    Args:
        path: the file, or an :class:`~nablahog.io.input_file.InputFile` of its bytes.
        size: pixels; a picture whose longer side has more is shrunk as :func:`limit_size` does, with less memory than
            the whole takes; 0 for never.
        as_bytes: whether to keep 8 bits a channel as they are, if the file has no more and is not shrunk.

    Returns:
        (C, H, W) with C 1 or 3, float32 in 0…1, on the CPU; or uint8, a quarter of it, if that was asked for.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is not a regular file or picture, is damaged, has more pixels than twice
            ``PIL.Image.MAX_IMAGE_PIXELS``, or than the environment variable ``NABLAHOG_MAX_PIXELS`` says, or its levels
            are none of the above.
    """
    file = input_file(path)
    file.check("an image file")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about odd metadata, and about many pixels
        try:
            return _assemble(decode_image(file), size, as_bytes)
        except Image.DecompressionBombError:
            limit = 2 * (Image.MAX_IMAGE_PIXELS or 0)
            raise ValueError(
                f"{file}: an image of more than {limit:,} pixels is refused; it may be a bomb, and if it is none, the "
                f"environment variable {PIXELS_VARIABLE} allows more"
            ) from None
        except UnidentifiedImageError:
            raise ValueError(f"{file}: expected an image, got {_describe_other(file)}") from None
        except MemoryError:
            raise
        except Exception as error:  # decoders of damaged files raise nearly anything
            reason = _UNPROCESSED.sub("", one_line(explain(error).removeprefix(f"{file}: ")))
            raise ValueError(f"{file}: the image cannot be read: {reason}; save or copy it again") from None


def _describe_other(file: InputFile) -> str:
    """What a file is that is no image, and what to write in its place."""
    if not file.size:
        return "an empty file"
    text = file.read(_START + 1)
    if len(text) > _START:
        text = text[: max(text.rfind(b"\n"), text.rfind(b","), text.rfind(b" "))]  # before a number that is cut
    separator = next((mark for mark in ",;" if mark.encode() in text), "")
    try:
        numbers = np.array(text.decode("utf-8-sig").replace(separator or " ", " ").split(), float)
    except ValueError:
        numbers = np.empty(0)
    if not numbers.size:
        return "a file that is none, or of an unknown format: save it as PNG or JPEG"
    name, delimiter = one_line(repr(os.path.basename(file.name))), f", delimiter={separator!r}" if separator else ""
    return f"numbers as text: write numpy.save('w.npy', numpy.loadtxt({name}{delimiter}))"


def longer_side(path: Readable) -> int:
    """Pixels of the longer side of a picture that :func:`read_image` reads."""
    image: Image.Image
    with input_file(path).open() as stream, Image.open(stream) as image:
        return max(image.size)


def _assemble(image: Image.Image, size: int, as_bytes: bool) -> Tensor:
    """(C, H, W) of an image; each strip is as narrow as the result before the next one is converted."""
    height, width = _limit(image.height, image.width, size)
    keeps_bytes = as_bytes and has_8_bits(image) and (height, width) == (image.height, image.width)
    narrow, row, dtype = torch.empty(0, device="cpu"), 0, torch.uint8 if keeps_bytes else torch.float32
    for values in pixel_values(image, tiff_tags(image)):
        strip = torch.from_numpy(values).movedim(-1, 0)
        if not row:
            narrow = torch.empty(len(strip), image.height, width, dtype=dtype, device="cpu")
        narrow[:, row : row + len(values)] = (
            (strip * 255).round() if keeps_bytes else _resize(strip, len(values), width)
        )
        row += len(values)
    return narrow if keeps_bytes else _resize(narrow, height, width).clamp_(0, 1)


def limit_size(image: Tensor, size: int) -> Tensor:
    """An image (C, H, W) in 0…1 with at most ``size`` pixels, at least 1, on its longer side: shrunk, antialiased."""
    if size < 1:
        raise ValueError(f"size must be at least 1 pixel, got {size}")
    small = _resize(image, *_limit(image.shape[1], image.shape[2], size))
    return image if small is image else small.clamp(0, 1)  # bicubic overshoots at edges


def _limit(height: int, width: int, size: int) -> tuple[int, int]:
    longer = max(height, width)
    if not 0 < size < longer:
        return height, width
    return max(1, round(height * size / longer)), max(1, round(width * size / longer))


def _resize(image: Tensor, height: int, width: int) -> Tensor:
    if image.shape[1:] == (height, width):
        return image
    return functional.interpolate(image[None], (height, width), mode="bicubic", antialias=True, align_corners=False)[0]


def draw_polygons(polygons: Sequence[Sequence[float]], height: int, width: int) -> Tensor:
    """A mask (height, width), bool, true inside any of some polygons x, y, x, y, … in pixels."""
    image = Image.new("1", (width, height))
    for polygon in polygons:
        ImageDraw.Draw(image).polygon([*polygon], fill=1)
    return torch.from_numpy(np.array(image))


def to_pil(picture: Picture) -> Image.Image:
    """``picture``, (H, W), (1, H, W) or (3, H, W) in 0…1 (clipped), as an 8-bit Pillow image, gray or RGB.

    Raises:
        ValueError: another shape, or NaN.
    """
    values = as_array(picture)
    if values.ndim == 3 and values.shape[0] in (1, 3):
        values = values[0] if values.shape[0] == 1 else values.transpose(1, 2, 0)
    elif values.ndim != 2:
        raise ValueError(f"expected a picture of shape (H, W), (1, H, W) or (3, H, W), got {values.shape}")
    if np.isnan(values).any():
        raise ValueError("expected a picture in 0…1, got NaN")
    return Image.fromarray(np.rint(values.clip(0, 1) * 255).astype(np.uint8))


def write_image(path: Writable, picture: Picture | Image.Image) -> None:
    """Writes ``picture``, as :func:`to_pil` takes or makes it, in the format of the name's ending, to a stream as PNG.

    ``path`` is replaced whole or not at all.

    Raises:
        ValueError: Pillow writes no images with such an ending.
    """
    ending = Path(path).suffix if isinstance(path, str | os.PathLike) else ".png"
    kind = Image.registered_extensions().get(ending.lower())
    if kind not in Image.SAVE:
        raise ValueError(f"{path}: expected the ending of an image file, such as .png, got {ending!r}")
    image = picture if isinstance(picture, Image.Image) else to_pil(picture)
    with replacing(path) as file:
        image.save(file, format=kind)


def sample_photograph(name: str) -> Tensor:
    """One of :data:`SAMPLE_NAMES`, (C, H, W) with C 1 or 3, float32 in 0…1.

    Raises:
        ModuleNotFoundError: scikit-image is not installed.
    """
    with extra("skimage", "a sample photograph"):
        from skimage import data  # slow to import

    photograph = torch.from_numpy(getattr(data, name)())
    return (photograph.permute(2, 0, 1) if photograph.dim() == 3 else photograph[None]) / 255


def exif_focal(image: Image.Image) -> float | None:
    """As :func:`read_exif_focal`, for an image opened by Pillow, in either orientation."""
    with warnings.catch_warnings(), suppress(Exception):  # damaged EXIF data raises nearly anything
        warnings.simplefilter("ignore")
        tags = image.getexif().get_ifd(ExifTags.IFD.Exif)
        diagonal, shrunk = math.hypot(*image.size), 1.0
        stored = [
            _positive_number(tags.get(tag)) for tag in (ExifTags.Base.ExifImageWidth, ExifTags.Base.ExifImageHeight)
        ]
        if all(stored):
            (short, long), (stored_short, stored_long) = sorted(image.size), sorted(stored)
            if abs(short * stored_long / (long * stored_short) - 1) > _CUT:
                return None
            shrunk = long / stored_long
        focal = _positive_number(tags.get(ExifTags.Base.FocalLengthIn35mmFilm)) / _FILM * diagonal
        if not focal:
            unit = _MILLIMETRES[int(tags.get(ExifTags.Base.FocalPlaneResolutionUnit, 2))]
            resolution = _positive_number(tags.get(ExifTags.Base.FocalPlaneXResolution)) / unit
            focal = _positive_number(tags.get(ExifTags.Base.FocalLength)) * resolution * shrunk
        return focal if SHORTEST * diagonal <= focal <= LONGEST * diagonal else None
    return None


def read_exif_focal(path: Readable) -> float | None:
    """The focal length in pixels that the file of a photograph says its camera had; None if it says nothing of use.

    That is FocalLengthIn35mmFilm, or else FocalLength at FocalPlaneXResolution.  A photograph may have been made
    smaller; if its proportions are not the camera's, it was cropped, and nothing is known of it.

    Args:
        path: a file of any format that Pillow reads.

    >>> import tempfile
    >>> from pathlib import Path
    >>> from PIL import ExifTags, Image
    >>> from nablahog.io.images import read_exif_focal
    >>> exif = Image.Exif()
    >>> exif[ExifTags.IFD.Exif] = {ExifTags.Base.FocalLengthIn35mmFilm: 26}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     Image.new("RGB", (400, 300)).save(Path(folder, "phone.jpg"), exif=exif)
    ...     round(read_exif_focal(Path(folder, "phone.jpg")), 1)  # 26 / 43.27 of the diagonal, 500 pixels
    300.5
    """
    prepare_pillow()
    with warnings.catch_warnings(), suppress(Exception):
        warnings.simplefilter("ignore")
        with input_file(path).open() as stream, Image.open(stream) as image:
            return exif_focal(image)
    return None


def _positive_number(value: object) -> float:
    """A number above 0; 0 for anything else."""
    number = float(value) if value is not None else 0.0  # type: ignore[arg-type]
    return number if 0 < number < math.inf else 0.0
