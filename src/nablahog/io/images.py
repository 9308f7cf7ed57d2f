"""Pictures: files to tensors and back, sample photographs, and the focal length that a file names (EXIF)."""

from __future__ import annotations

import io
import math
import os
import warnings
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import ExifTags, Image, ImageOps, UnidentifiedImageError
from PIL.TiffImagePlugin import BITSPERSAMPLE, PHOTOMETRIC_INTERPRETATION, SAMPLEFORMAT
from torch import Tensor
from torch.nn import functional

from ..runtime.text import one_line
from .files import check_file, replacing

Picture: TypeAlias = Tensor | NDArray[np.floating]

MAX_BYTES = 2**30  # of a file; the largest images that are read have fewer
STRIP = 256  # rows that are converted at once

SAMPLE_NAMES = ("astronaut", "brick", "camera", "chelsea", "clock", "coffee", "coins", "rocket")
"""Names of the photographs in the wheel of scikit-image."""

_GRAY_MODES = ("1", "L", "LA", "La")
_WHITE_IS_ZERO = 0  # as TIFF's tag has it
_OVERSHOOT = 0.1  # of filters, that is clipped, as a part of the largest level
_BRIGHTEST_OF_255 = 16.0  # at least; a smaller highest level would be a black image, or one of high dynamic range
_JPEG, _JPEG_END = b"\xff\xd8", b"\xff\xd9"
_FILM = math.hypot(36, 24)  # millimetres: the diagonal that equivalent focal lengths refer to (CIPA DCG-001)
_MILLIMETRES = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}  # by the unit of the focal plane's resolution
_CUT = 0.01  # relative difference of proportions above which a photograph counts as cropped
_SHORTEST, _LONGEST = 0.1, 100.0  # focal lengths of real lenses, in diagonals of the photograph


def as_array(picture: Picture) -> NDArray[np.float64]:
    """``picture``, a tensor on any device or an array, as a float64 array of the same shape."""
    if isinstance(picture, Tensor):
        picture = picture.detach().cpu().numpy()
    return np.asarray(picture, dtype=np.float64)


@cache
def register_heif() -> None:
    """Lets Pillow read HEIC and AVIF as pillow-heif does, where it is installed."""
    with suppress(ImportError):
        import pillow_heif

        pillow_heif.register_heif_opener()


def image_endings() -> set[str]:
    """The endings, as ".png", of files that :func:`read_image` reads as images."""
    register_heif()
    return {ending for ending, kind in Image.registered_extensions().items() if kind in Image.OPEN}


def read_image(path: str | os.PathLike[str]) -> Tensor:
    """The picture in a file, of any format that Pillow decodes by itself, or with pillow-heif where that is installed.

    It comes upright (EXIF orientation), over white where it is transparent, and of several frames the first.  Gray
    files (1, 8 or 16 bit, or float) have one channel, all others R, G, B.  A level k of 8 or 16 bits becomes k/255 or
    k/65535, and its negative where the file says that 0 is white.  Float files hold 0…1 or 0…255, which is divided by
    255; what lies outside by less than a tenth, as filters leave it, is clipped.  Colour profiles are not applied.  A
    JPEG file may lack its end marker, if it has all pixels.

    Args:
        path: the file.

    Returns:
        (C, H, W) with C 1 or 3, float32 in 0…1, on the CPU.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is no regular file, no picture, truncated or otherwise damaged, has no pixels or more than
            ``PIL.Image.MAX_IMAGE_PIXELS``, or its levels are none of the above.
    """
    path = Path(path)
    check_file(path, "an image file")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about odd metadata
        warnings.simplefilter("error", Image.DecompressionBombWarning)
        try:
            levels = _levels(_decoded(path))
        except (Image.DecompressionBombError, Image.DecompressionBombWarning):
            limit = Image.MAX_IMAGE_PIXELS
            raise ValueError(f"{path}: an image of more than {limit:,} pixels is refused, it may be a bomb") from None
        except UnidentifiedImageError:
            raise ValueError(f"{path}: expected an image, got a file of no format that Pillow reads") from None
        except MemoryError:
            raise
        except Exception as error:  # decoders of damaged files raise nearly anything
            raise ValueError(f"{path}: the image cannot be read: {one_line(error)}") from None
    if levels.ndim == 2:
        levels = levels[..., None]
    if levels.size == 0:
        raise ValueError(f"{path}: the image has no pixels ({levels.shape[0]}x{levels.shape[1]})")
    return torch.from_numpy(np.ascontiguousarray(levels.transpose(2, 0, 1)))


def _decoded(path: Path) -> Image.Image:
    image: Image.Image
    register_heif()
    if path.stat().st_size > MAX_BYTES:
        raise ValueError(f"it has more than {MAX_BYTES:,} bytes")
    # from memory: some decoders allocate as many bytes as a damaged file promises
    data = path.read_bytes()
    try:
        return _opened(data)
    except OSError:
        # what follows the pixels of a JPEG file changes none of them, unless some are missing
        if not data.startswith(_JPEG):
            raise
        data = data.removesuffix(b"\xff")
        image, same = (_opened(data + other + _JPEG_END) for other in (b"", b"\x55" * 64))
        if "progressive" in image.info or image.tobytes() != same.tobytes():
            raise
        return image


def _opened(data: bytes) -> Image.Image:
    image: Image.Image
    with Image.open(io.BytesIO(data)) as image:
        if image.format == "EPS":
            raise ValueError("PostScript is a program, which is never run; convert it to PNG first")
        image.load()
        with suppress(Exception):  # damaged EXIF data says nothing about the pixels
            ImageOps.exif_transpose(image, in_place=True)  # without a copy, which may be large
    return image


def _levels(image: Image.Image) -> NDArray[np.float32]:
    """(H, W) or (H, W, channels), float32 in 0…1."""
    if image.mode in ("I", "F") or image.mode.startswith("I;16"):  # which a 16-bit PNG is, depends on Pillow
        numbers = _numbers(image)
        scaled = _scaled_floats(numbers) if image.mode == "F" else _scaled(numbers, 65535)
        # Pillow itself inverts levels of 8 bits
        return 1 - scaled if _tiff_tag(image, PHOTOMETRIC_INTERPRETATION) == _WHITE_IS_ZERO else scaled
    gray = image.mode in _GRAY_MODES
    if image.has_transparency_data:
        rgba = _scaled(np.asarray(image.convert("LA" if image.mode == "La" else "RGBA")), 255)
        alpha = rgba[..., -1:]
        over_white = rgba[..., :-1] * alpha + (1 - alpha)
        return over_white[..., :1] if gray else over_white
    return _scaled(np.asarray(image.convert("L" if gray else "RGB")), 255)


def _numbers(image: Image.Image) -> NDArray[Any]:
    """The pixels of one channel, (H, W), in strips: NumPy copies an image of Pillow twice."""
    values = np.empty((image.height, image.width), np.asarray(image.crop((0, 0, 1, 1))).dtype)
    for y in range(0, image.height, STRIP):
        values[y : y + STRIP] = np.asarray(image.crop((0, y, image.width, min(y + STRIP, image.height))))
    # Pillow reads unsigned numbers of 32 bits as signed ones
    unsigned = _tiff_tag(image, SAMPLEFORMAT, (1,)) == (1,) and values.dtype == np.int32
    return values.view(np.uint32) if unsigned and _tiff_tag(image, BITSPERSAMPLE) == (32,) else values


def _tiff_tag(image: Image.Image, tag: int, default: object = None) -> object:
    """A tag of a TIFF file; ``default`` where it, or the whole file, has none."""
    return getattr(image, "tag_v2", {}).get(tag, default)


def _scaled(values: NDArray[np.generic], largest: int) -> NDArray[np.float32]:
    if values.size and not (values.min() >= 0 and values.max() <= largest):
        raise ValueError(f"expected levels in 0…{largest}, got {values.min()} … {values.max()}")
    scaled = values.astype(np.float32)
    scaled /= np.float32(largest)
    return scaled


def _scaled_floats(values: NDArray[np.floating]) -> NDArray[np.float32]:
    lowest, highest = float(values.min()), float(values.max())
    for largest, least in ((1, -math.inf), (255, _BRIGHTEST_OF_255)):
        if highest >= least and -_OVERSHOOT * largest <= lowest and highest <= (1 + _OVERSHOOT) * largest:
            return _scaled(values.clip(0, largest), largest)
    got = "NaN" if math.isnan(lowest) else f"{lowest:g} … {highest:g}"
    raise ValueError(f"expected levels in 0…1 or 0…255, got {got}")


def limit_size(image: Tensor, size: int) -> Tensor:
    """``image`` shrunk, antialiased, so that its longer side has at most ``size`` pixels; never enlarged.

    Args:
        image: (C, H, W), floating point in 0…1.
        size: pixels, at least 1.

    Returns:
        (C, h, w) of nearly the same proportions, in 0…1, each side at least 1.

    Raises:
        ValueError: ``size`` is below 1.
    """
    if size < 1:
        raise ValueError(f"size must be at least 1 pixel, got {size}")
    height, width = image.shape[-2:]
    longer = max(height, width)
    if longer <= size:
        return image
    target = [max(1, round(side * size / longer)) for side in (height, width)]
    small = functional.interpolate(image[None], target, mode="bicubic", antialias=True, align_corners=False)
    return small[0].clamp(0, 1)  # bicubic overshoots at edges


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


def write_image(path: str | os.PathLike[str], picture: Picture | Image.Image) -> None:
    """Writes ``picture``, as :func:`to_pil` takes it or made by it, as a PNG; ``path`` is replaced whole or not at all.

    Raises:
        ValueError: as :func:`to_pil`.
        OSError: the file cannot be written.
    """
    image = picture if isinstance(picture, Image.Image) else to_pil(picture)
    with replacing(path) as file:
        image.save(file, format="PNG")


def sample_photograph(name: str) -> Tensor:
    """One of :data:`SAMPLE_NAMES`, (C, H, W) with C 1 or 3, float32 in 0…1."""
    from skimage import data  # slow to import

    photograph = torch.from_numpy(getattr(data, name)())
    return (photograph.permute(2, 0, 1) if photograph.dim() == 3 else photograph[None]) / 255


def exif_focal(image: Image.Image) -> float | None:
    """As :func:`read_exif_focal`, for an image opened by Pillow, in either orientation."""
    with warnings.catch_warnings(), suppress(Exception):  # damaged EXIF data raises nearly anything
        warnings.simplefilter("ignore")
        tags = image.getexif().get_ifd(ExifTags.IFD.Exif)
        diagonal, shrunk = math.hypot(*image.size), 1.0
        stored = [_number(tags.get(tag)) for tag in (ExifTags.Base.ExifImageWidth, ExifTags.Base.ExifImageHeight)]
        if all(stored):
            (short, long), (stored_short, stored_long) = sorted(image.size), sorted(stored)
            if abs(short * stored_long / (long * stored_short) - 1) > _CUT:
                return None
            shrunk = long / stored_long
        focal = _number(tags.get(ExifTags.Base.FocalLengthIn35mmFilm)) / _FILM * diagonal
        if not focal:
            unit = _MILLIMETRES[int(tags.get(ExifTags.Base.FocalPlaneResolutionUnit, 2))]
            resolution = _number(tags.get(ExifTags.Base.FocalPlaneXResolution)) / unit
            focal = _number(tags.get(ExifTags.Base.FocalLength)) * resolution * shrunk
        return focal if _SHORTEST * diagonal <= focal <= _LONGEST * diagonal else None
    return None


def read_exif_focal(path: str | os.PathLike[str]) -> float | None:
    """The focal length in pixels that the file of a photograph says its camera had; None if it says nothing of use.

    That is FocalLengthIn35mmFilm, or else FocalLength at FocalPlaneXResolution.  A photograph may have been made
    smaller; if its proportions are not the camera's, it was cropped, and nothing is known of it.

    Args:
        path: of any format that Pillow reads.

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
    register_heif()
    with warnings.catch_warnings(), suppress(Exception):
        warnings.simplefilter("ignore")
        with Image.open(path) as image:
            return exif_focal(image)
    return None


def _number(value: object) -> float:
    """A number above 0; 0 for anything else."""
    number = float(value) if value is not None else 0.0  # type: ignore[arg-type]
    return number if 0 < number < math.inf else 0.0
