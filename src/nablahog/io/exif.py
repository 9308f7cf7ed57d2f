"""The focal length that a camera writes into a photograph's file (EXIF)."""

from __future__ import annotations

import math
import os
import warnings
from contextlib import suppress

from PIL import ExifTags, Image

from .images import register_heif

DIAGONAL = math.hypot(36, 24)  # millimetres of 35 mm film, to which equivalent focal lengths refer (CIPA DCG-001)
_MILLIMETRES = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}  # by the unit of the focal plane's resolution
_CUT = 0.01  # relative difference of proportions above which a photograph counts as cropped
_SHORTEST, _LONGEST = 0.1, 100.0  # focal lengths of real lenses, in diagonals of the photograph


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
        focal = _number(tags.get(ExifTags.Base.FocalLengthIn35mmFilm)) / DIAGONAL * diagonal
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
    >>> from nablahog.io.exif import read_exif_focal
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
