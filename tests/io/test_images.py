"""Reading pictures of every kind, refusing what is none, writing; focal lengths of EXIF data."""

from __future__ import annotations

import io
import math
import os
import struct
import zlib
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
import torch
from PIL import ExifTags, Image
from PIL.TiffImagePlugin import IFDRational

from nablahog.inputs.arrays import as_images
from nablahog.io.images import draw_polygons, image_endings, limit_size, read_exif_focal, read_image, write_image
from nablahog.io.pixels import prepare_pillow

RAMP = np.arange(256, dtype=np.uint8).reshape(16, 16)
COLOURS = np.random.default_rng(0).integers(0, 256, (6, 5, 3), dtype=np.uint8)


def _png_of_size(width: int, height: int) -> bytes:
    """A PNG that only claims its size."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    pixels = zlib.compress(b"\0" * 100)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")


def test_gray_levels_are_exact(tmp_path: Path) -> None:
    Image.fromarray(RAMP).save(tmp_path / "ramp.png")
    image = read_image(tmp_path / "ramp.png")
    assert image.shape == (1, 16, 16)
    assert image.dtype == torch.float32
    assert torch.equal(image[0], torch.from_numpy(RAMP) / 255)


@pytest.mark.parametrize("ending", ["png", "pgm"])
def test_sixteen_bits(tmp_path: Path, ending: str) -> None:
    levels = np.array([[0, 1, 256], [32768, 65534, 65535]], dtype=np.uint16)
    path = tmp_path / f"deep.{ending}"
    if ending == "pgm":  # which Pillow cannot always write
        path.write_bytes(b"P5\n3 2\n65535\n" + levels.astype(">u2").tobytes())
    else:
        Image.fromarray(levels).save(path)
    torch.testing.assert_close(read_image(path)[0], torch.from_numpy(levels / 65535).float(), rtol=1e-6, atol=0)


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([0.0, 0.25, 1.0], [0, 0.25, 1]),
        ([0.0, 51.0, 255.0], [0, 0.2, 1]),
        ([-1e-6, 0.5, 1.02], [0, 0.5, 1]),  # as filters leave it
        ([-3.0, 51.0, 256.0], [0, 0.2, 1]),
    ],
)
def test_float_levels(tmp_path: Path, values: list[float], expected: list[float]) -> None:
    Image.fromarray(np.array([values], dtype=np.float32)).save(tmp_path / "f.tiff")
    torch.testing.assert_close(read_image(tmp_path / "f.tiff")[0, 0], torch.tensor(expected).float())


@pytest.mark.parametrize("bad", [np.nan, -1.0, 7.3, 300.0, np.inf])
def test_float_levels_out_of_range(tmp_path: Path, bad: float) -> None:
    Image.fromarray(np.array([[0.0, bad]], dtype=np.float32)).save(tmp_path / "f.tiff")
    with pytest.raises(
        ValueError, match=f"expected levels in 0…1 or 0…255, got .*{'NaN' if np.isnan(bad) else f'{bad:g}'}"
    ):
        read_image(tmp_path / "f.tiff")


@pytest.mark.parametrize("dtype", ["u1", "u2", "f4"])
def test_a_tiff_file_in_which_zero_is_white(tmp_path: Path, dtype: str) -> None:
    levels = RAMP.astype(dtype) * (257 if dtype == "u2" else 1)
    tifffile.imwrite(tmp_path / "w.tif", levels, photometric="miniswhite")
    torch.testing.assert_close(read_image(tmp_path / "w.tif")[0], 1 - torch.from_numpy(RAMP) / 255)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("options", [{}, {"compression": "deflate"}, {"tile": (16, 16)}])
def test_planes_of_sixteen_bits(tmp_path: Path, order: Any, options: dict[str, Any]) -> None:
    planes = np.moveaxis(COLOURS, -1, 0).astype(np.uint16) * 257
    tifffile.imwrite(tmp_path / "a.tif", planes, photometric="rgb", planarconfig="separate", byteorder=order, **options)
    torch.testing.assert_close(read_image(tmp_path / "a.tif"), torch.from_numpy(planes.astype(np.float32)) / 65535)


def test_unsigned_numbers_of_32_bits_are_told_as_they_are(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "u.tif", np.full((16, 16), 3_000_000_000, np.uint32))
    with pytest.raises(ValueError, match=r"0…65535, got 3000000000 "):
        read_image(tmp_path / "u.tif")


def test_gray_with_alpha_lies_over_white(tmp_path: Path) -> None:
    Image.fromarray(np.array([[[0, 255], [0, 0], [0, 51]]], dtype=np.uint8)).save(tmp_path / "la.png")
    torch.testing.assert_close(read_image(tmp_path / "la.png"), torch.tensor([[[0, 1, 0.8]]]))


@pytest.mark.parametrize("ending", ["png", "jpg"])
def test_truncated_files(tmp_path: Path, ending: str) -> None:
    whole = io.BytesIO()
    Image.fromarray(np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8)).save(
        whole, {"jpg": "JPEG"}.get(ending, ending.upper())
    )
    path = tmp_path / f"half.{ending}"
    for part in (0, 1, 10, 40, len(whole.getvalue()) // 2):
        path.write_bytes(whole.getvalue()[:part])
        with pytest.raises(ValueError, match=f"^{path}: "):
            read_image(path)


@pytest.mark.parametrize("kind", ["JPEG", "JPEG2000"])
@pytest.mark.parametrize("mode", ["L", "RGB"])
def test_a_jpeg_file_without_its_end_marker(tmp_path: Path, mode: str, kind: str) -> None:
    whole, path = io.BytesIO(), tmp_path / "camera.jpg"
    Image.fromarray(np.random.default_rng(0).integers(0, 256, (45, 67, 3), dtype=np.uint8)).convert(mode).save(
        whole, kind
    )
    path.write_bytes(whole.getvalue())
    expected = read_image(path)
    for missing in (1, 2):
        path.write_bytes(whole.getvalue()[:-missing])
        assert torch.equal(read_image(path), expected)
    for missing in (4, 5, 30):  # pixels, too
        path.write_bytes(whole.getvalue()[:-missing])
        with pytest.raises(ValueError, match=r"truncated|broken") as caught:
            read_image(path)
        assert "bytes not" not in str(caught.value)


def test_decompression_bombs(tmp_path: Path) -> None:
    (tmp_path / "bomb.png").write_bytes(_png_of_size(400_000, 1000))
    with pytest.raises(ValueError, match=r"bomb\.png: an image of more than 178,956,970 pixels is refused"):
        read_image(tmp_path / "bomb.png")


def test_more_pixels_are_read_where_the_user_allows_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 50)
    Image.fromarray(RAMP).save(tmp_path / "ramp.png")
    with pytest.raises(ValueError, match="NABLAHOG_MAX_PIXELS allows more"):
        read_image(tmp_path / "ramp.png")
    for allowed in ("256", "many"):
        monkeypatch.setenv("NABLAHOG_MAX_PIXELS", allowed)
        prepare_pillow.cache_clear()
        if allowed == "256":
            assert read_image(tmp_path / "ramp.png").shape == (1, 16, 16)
        else:
            with pytest.raises(ValueError, match="must be a number of pixels, got 'many'"):
                read_image(tmp_path / "ramp.png")


@pytest.mark.parametrize("with_parts", [True, False])
def test_previews_of_raw_photographs_are_refused(tmp_path: Path, with_parts: bool) -> None:
    path = tmp_path / "raw.dng"
    with tifffile.TiffWriter(path) as tiff:
        tiff.write(COLOURS, photometric="rgb", subfiletype=1, subifds=int(with_parts))
        tiff.write(np.zeros((64, 64), np.uint16), photometric="cfa" if with_parts else "minisblack", subfiletype=0)
    with pytest.raises(ValueError, match="its first image is a preview, as in raw photographs"):
        read_image(path)
    with Image.open(path) as image, pytest.raises(ValueError, match="its first image is a preview"):
        as_images("images", image)


@pytest.mark.parametrize("orientation", [1, 3])
@pytest.mark.parametrize("photometric", ["miniswhite", "minisblack"])
def test_images_that_people_have_opened_are_those_of_the_file(
    tmp_path: Path, photometric: Any, orientation: int
) -> None:
    tags = [(0x0112, "H", 1, orientation, True)]
    levels = RAMP.astype(np.uint16) * 257
    tifffile.imwrite(tmp_path / "a.tif", levels, photometric=photometric, extratags=tags)
    with Image.open(tmp_path / "a.tif") as image:
        opened, _ = as_images("images", image)
    torch.testing.assert_close(opened[0], read_image(tmp_path / "a.tif"), rtol=0, atol=0)


def test_postscript_is_not_run(tmp_path: Path) -> None:
    Image.fromarray(RAMP).save(tmp_path / "program.eps")
    with pytest.raises(ValueError, match="PostScript"):
        read_image(tmp_path / "program.eps")


@pytest.mark.parametrize(("shape", "size", "expected"), [((100, 50), 20, (20, 10)), ((1000, 1), 10, (10, 1))])
def test_limit_size(shape: tuple[int, int], size: int, expected: tuple[int, int]) -> None:
    image = torch.rand(3, *shape)
    small = limit_size(image, size)
    assert small.shape == (3, *expected)
    assert small.min() >= 0
    assert small.max() <= 1
    assert torch.equal(limit_size(image, 2000), image)


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "L", "F"])
def test_reading_a_smaller_picture(tmp_path: Path, mode: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("nablahog.inputs.pil_images.CONVERTED_PIXELS", 256 * 310)
    levels = np.random.default_rng(0).integers(0, 256, (700, 310, 4), dtype=np.uint8)  # strips of 256, 256 and 188 rows
    Image.fromarray(levels).convert(mode).save(tmp_path / "a.tif")
    whole = read_image(tmp_path / "a.tif")
    for size in (100, 699, 700, 2000):
        assert torch.equal(read_image(tmp_path / "a.tif", size), limit_size(whole, size))


def test_writing_and_reading_again(tmp_path: Path) -> None:
    path = tmp_path / "w.png"
    for picture in (torch.rand(3, 4, 5), torch.rand(1, 4, 5), torch.rand(4, 5, requires_grad=True)):
        write_image(path, picture)
        torch.testing.assert_close(read_image(path), picture.detach().reshape(-1, 4, 5), atol=0.5 / 255 + 1e-6, rtol=0)
    write_image(path, np.array([[-1.0, 0.5, 2.0]]))
    assert np.asarray(Image.open(path)).tolist() == [[0, 128, 255]]
    assert os.listdir(tmp_path) == ["w.png"]


@pytest.mark.skipif(find_spec("pillow_heif") is None, reason="needs pillow-heif")
def test_heic(tmp_path: Path) -> None:
    prepare_pillow()
    colour = (200, 100, 50)
    Image.new("RGB", (48, 32), colour).save(tmp_path / "a.heic", quality=100)
    assert {".heic", ".heif"} <= image_endings()
    image = read_image(tmp_path / "a.heic")
    assert image.shape == (3, 32, 48)
    torch.testing.assert_close(image.mean((1, 2)), torch.tensor(colour) / 255, atol=0.02, rtol=0)


# --- focal lengths of EXIF data

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


def test_polygons_are_drawn_as_a_mask() -> None:
    mask = draw_polygons([(2, 1, 6, 1, 6, 4, 2, 4), (0, 0, 0, 0, 0, 0)], 8, 10)
    assert (mask.dtype, mask.shape) == (torch.bool, (8, 10))
    assert bool(mask[1:5, 2:7].all())
    assert bool(mask[0, 0])
    assert int(mask.sum()) == 21
