"""Focal lengths of EXIF data."""

from __future__ import annotations

import math
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
from PIL import ExifTags, Image
from PIL.TiffImagePlugin import IFDRational

from nablahog.io.exif import read_exif_focal

TAGS = ExifTags.Base


@pytest.fixture
def written(tmp_path: Path) -> Any:
    def write(size: tuple[int, int] = (400, 300), orientation: int = 1, **tags: Any) -> Path:
        exif = Image.Exif()
        exif[TAGS.Orientation] = orientation
        exif[ExifTags.IFD.Exif] = {getattr(TAGS, name): value for name, value in tags.items()}
        path = tmp_path / "photo.jpg"
        Image.new("RGB", size).save(path, exif=exif)
        return path

    return write


def rational(value: float) -> IFDRational:
    fraction = Fraction(value).limit_denominator(10_000)
    return IFDRational(fraction.numerator, fraction.denominator)


@pytest.mark.parametrize("orientation", [1, 6])
def test_of_35_mm_film(written: Any, orientation: int) -> None:
    """A lens as long as the film's diagonal sees the photograph's diagonal from its own length."""
    path = written(orientation=orientation, FocalLengthIn35mmFilm=43)
    assert read_exif_focal(path) == pytest.approx(500 * 43 / math.hypot(36, 24))


@pytest.mark.parametrize(("unit", "resolution"), [(2, 2540.0), (3, 1000.0), (4, 100.0), (None, 2540.0)])
def test_of_the_focal_plane(written: Any, unit: int | None, resolution: float) -> None:
    """5.2 mm at 100 pixels a millimetre."""
    units = {} if unit is None else {"FocalPlaneResolutionUnit": unit}
    path = written(FocalLength=rational(5.2), FocalPlaneXResolution=rational(resolution), **units)
    assert read_exif_focal(path) == pytest.approx(520)


def test_of_a_photograph_that_was_made_smaller(written: Any) -> None:
    tags = {"FocalLength": rational(5.2), "FocalPlaneXResolution": rational(2540)}
    assert read_exif_focal(written(ExifImageWidth=800, ExifImageHeight=600, **tags)) == pytest.approx(260)
    assert read_exif_focal(written(ExifImageWidth=600, ExifImageHeight=800, **tags)) == pytest.approx(260)  # turned


@pytest.mark.parametrize(
    "tags",
    [
        {},
        {"FocalLengthIn35mmFilm": 60_000},
        {"FocalLengthIn35mmFilm": 26, "ExifImageWidth": 800, "ExifImageHeight": 800},  # cut
        {"FocalLength": IFDRational(5, 0), "FocalPlaneXResolution": rational(2540)},
    ],
)
def test_nothing_is_said(written: Any, tags: dict[str, Any]) -> None:
    assert read_exif_focal(written(**tags)) is None
