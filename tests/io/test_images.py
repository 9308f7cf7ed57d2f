"""Reading pictures of every kind, refusing what is none, writing; focal lengths of EXIF data."""

from __future__ import annotations

import math
import os
import struct
import zlib
from collections.abc import Callable
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
import tifffile
import torch
from PIL import ExifTags, Image, ImageFile
from PIL.TiffImagePlugin import IFDRational

from nablahog.inputs.arrays import as_images
from nablahog.io import pixels
from nablahog.io.images import draw_polygons, image_endings, limit_size, read_exif_focal, read_image, write_image
from nablahog.io.pixels import prepare_pillow

RAMP = np.arange(256, dtype=np.uint8).reshape(16, 16)
DEEP = np.array([[0, 1, 256], [32768, 65534, 65535]], dtype=np.uint16)
COLOURS = np.random.default_rng(0).integers(0, 256, (45, 67, 3), dtype=np.uint8)
PLANES = np.moveaxis(COLOURS, -1, 0).astype(np.uint16) * 257


def pillow(levels: Any, kind: str = "PNG") -> Callable[[Path], None]:
    return lambda path: Image.fromarray(levels).save(path, kind)


def tiff(levels: Any, **tags: Any) -> Callable[[Path], None]:
    return lambda path: tifffile.imwrite(path, levels, **tags)


@pytest.mark.parametrize(
    ("write", "expected"),
    [
        (pillow(RAMP), RAMP / 255),
        (pillow(DEEP), DEEP / 65535),
        (lambda path: path.write_bytes(b"P5\n3 2\n65535\n" + DEEP.astype(">u2").tobytes()), DEEP / 65535),
        (pillow(np.array([[[0, 255], [0, 0], [0, 51]]], np.uint8)), [[0, 1, 0.8]]),  # gray with alpha, over white
        (tiff(np.array([[0, 0.25, 1]], np.float32)), [[0, 0.25, 1]]),
        (tiff(np.array([[0, 51, 255]], np.float32)), [[0, 0.2, 1]]),
        (tiff(np.array([[-1e-6, 0.5, 1.02]], np.float32)), [[0, 0.5, 1]]),  # as filters leave it
        (tiff(np.array([[-3, 51, 256]], np.float32)), [[0, 0.2, 1]]),
        (tiff(RAMP, photometric="miniswhite"), 1 - RAMP / 255),
        (tiff(RAMP.astype(np.uint16) * 257, photometric="miniswhite"), 1 - RAMP / np.float32(255)),
        (tiff(RAMP.astype(np.float32), photometric="miniswhite"), 1 - RAMP / np.float32(255)),
        *(
            (tiff(PLANES, photometric="rgb", planarconfig="separate", byteorder=order, **options), PLANES / 65535)
            for order in "<>"
            for options in ({}, {"compression": "deflate"}, {"tile": (16, 16)})
        ),
    ],
)
def test_levels(tmp_path: Path, write: Callable[[Path], None], expected: Any) -> None:
    write(tmp_path / "a")
    expected = torch.as_tensor(expected).float()
    image = read_image(tmp_path / "a")
    torch.testing.assert_close(image, expected.reshape(-1, *expected.shape[-2:]), rtol=0, atol=0)


@pytest.mark.parametrize("kind", ["PNG", "JPEG"])
def test_truncated_files(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "half"
    pillow(COLOURS, kind)(path)
    whole = path.read_bytes()
    for part in (0, 1, 10, 40, len(whole) // 2):
        path.write_bytes(whole[:part])
        with pytest.raises(ValueError, match=f"^{path}: "):
            read_image(path)


@pytest.mark.parametrize("kind", ["JPEG", "JPEG2000"])
@pytest.mark.parametrize("levels", [COLOURS, COLOURS[..., 0]], ids=["RGB", "L"])
def test_a_jpeg_file_without_its_end_marker(tmp_path: Path, levels: Any, kind: str) -> None:
    path = tmp_path / "camera.jpg"
    pillow(levels, kind)(path)
    whole, expected = path.read_bytes(), read_image(path)
    for missing in (1, 2):
        path.write_bytes(whole[:-missing])
        assert torch.equal(read_image(path), expected)
    for missing in (4, 5, 30):  # pixels, too
        path.write_bytes(whole[:-missing])
        with pytest.raises(ValueError, match=r"truncated|broken") as caught:
            read_image(path)
        assert "bytes not" not in str(caught.value)


def write_bomb(path: Path) -> None:
    """A PNG that only claims its size."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 400_000, 1000, 8, 0, 0, 0, 0))
    pixels = chunk(b"IDAT", zlib.compress(b"\0" * 100))
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + header + pixels + chunk(b"IEND", b""))


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (write_bomb, "an image of more than 178,956,970 pixels is refused"),
        (tiff(np.full((16, 16), 3_000_000_000, np.uint32)), "0…65535, got 3000000000 "),
        (pillow(RAMP, "EPS"), "PostScript"),
        *(
            (lambda path, size=size: path.write_bytes(b"P5\n%d %d\n255\n" % size), "is none")
            for size in ((0, 4), (4, 0))
        ),
        (lambda path: path.write_text("hello"), "expected an image, got a file that is none"),
        (lambda path: path.write_bytes(b""), "expected an image, got an empty file"),
        (lambda path: path.write_text("1,-2e-3\n" * 20_000), r"numpy.loadtxt\('a', delimiter=','\)\)"),
        (lambda path: path.write_text("0.5\n"), r"numpy.loadtxt\('a'\)\)"),
    ],
)
def test_what_is_refused(tmp_path: Path, write: Callable[[Path], None], message: str) -> None:
    write(tmp_path / "a")
    with pytest.raises(ValueError, match=f"a: .*{message}"):
        read_image(tmp_path / "a")


def test_the_largest_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pillow(RAMP)(tmp_path / "ramp.png")
    size = os.path.getsize(tmp_path / "ramp.png")
    monkeypatch.setattr(pixels, "MAX_IMAGE_BYTES", size)
    assert read_image(tmp_path / "ramp.png").shape == (1, 16, 16)
    monkeypatch.setattr(pixels, "MAX_IMAGE_BYTES", size - 1)
    with pytest.raises(ValueError, match=f"it has more than {size - 1} bytes"):
        read_image(tmp_path / "ramp.png")


def test_a_lack_of_memory_is_not_the_files_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Image.new("L", (4, 4)).save(tmp_path / "a.png")
    monkeypatch.setattr(Image.Image, "convert", Mock(side_effect=MemoryError))
    monkeypatch.setattr(ImageFile.ImageFile, "load", Mock(side_effect=MemoryError))
    with pytest.raises(MemoryError):
        read_image(tmp_path / "a.png")


def test_more_pixels_are_read_where_the_user_allows_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 50)
    pillow(RAMP)(tmp_path / "ramp.png")
    with pytest.raises(ValueError, match="NABLAHOG_MAX_PIXELS allows more"):
        read_image(tmp_path / "ramp.png")
    for allowed, refusal in (
        ("256", None),
        ("254", "NABLAHOG_MAX_PIXELS allows more"),
        ("1", "NABLAHOG_MAX_PIXELS allows more"),
        ("0", "must be a number of pixels, got '0'"),
        ("many", "must be a number of pixels, got 'many'"),
    ):
        monkeypatch.setenv("NABLAHOG_MAX_PIXELS", allowed)
        prepare_pillow.cache_clear()
        if refusal is None:
            assert read_image(tmp_path / "ramp.png").shape == (1, 16, 16)
        else:
            with pytest.raises(ValueError, match=refusal):
                read_image(tmp_path / "ramp.png")


@pytest.mark.parametrize("with_parts", [True, False])
def test_previews_of_raw_photographs_are_refused(tmp_path: Path, with_parts: bool) -> None:
    path = tmp_path / "raw.dng"
    with tifffile.TiffWriter(path) as file:
        file.write(COLOURS, photometric="rgb", subfiletype=1, subifds=int(with_parts))
        file.write(np.zeros((64, 64), np.uint16), photometric="cfa" if with_parts else "minisblack", subfiletype=0)
    with pytest.raises(ValueError, match="its first image is a preview, as in raw photographs"):
        read_image(path)
    with Image.open(path) as image, pytest.raises(ValueError, match="its first image is a preview"):
        as_images("images", image)


@pytest.mark.parametrize("orientation", [1, 3])
@pytest.mark.parametrize("photometric", ["miniswhite", "minisblack"])
def test_images_that_people_have_opened_are_those_of_the_file(
    tmp_path: Path, photometric: str, orientation: int
) -> None:
    tags = [(0x0112, "H", 1, orientation, True)]
    tiff(RAMP.astype(np.uint16) * 257, photometric=photometric, extratags=tags)(tmp_path / "a.tif")
    with Image.open(tmp_path / "a.tif") as image:
        opened, _ = as_images("images", image)
    torch.testing.assert_close(opened[0], read_image(tmp_path / "a.tif"), rtol=0, atol=0)


@pytest.mark.parametrize(
    ("shape", "size", "expected"), [((100, 50), 20, (20, 10)), ((1000, 1), 10, (10, 1)), ((9, 9), 1, (1, 1))]
)
def test_limit_size(shape: tuple[int, int], size: int, expected: tuple[int, int]) -> None:
    image = torch.rand(3, *shape)
    small = limit_size(image, size)
    assert small.shape == (3, *expected)
    assert small.min() >= 0
    assert small.max() <= 1
    assert torch.equal(limit_size(image, 2000), image)
    with pytest.raises(ValueError, match="size must be at least 1 pixel, got 0"):
        limit_size(image, 0)


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


@pytest.mark.parametrize(
    ("picture", "message"),
    [
        (np.zeros(5), r"of shape \(H, W\), \(1, H, W\) or \(3, H, W\), got \(5,\)"),
        (torch.zeros(2, 4, 5), r"got \(2, 4, 5\)"),
        (np.zeros((4, 5, 3)), r"got \(4, 5, 3\)"),
        (np.array([[0.5, np.nan]]), "a picture in 0…1, got NaN"),
    ],
)
def test_what_is_no_picture_is_not_written(tmp_path: Path, picture: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        write_image(tmp_path / "w.png", picture)
    assert not os.listdir(tmp_path)


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


def rational(value: float) -> IFDRational:
    fraction = Fraction(value).limit_denominator(10_000)
    return IFDRational(fraction.numerator, fraction.denominator)


PLANE = {"FocalLength": rational(5.2), "FocalPlaneXResolution": rational(2540)}  # 100 pixels a millimetre


@pytest.mark.parametrize(
    ("tags", "expected"),
    [
        ({"FocalLengthIn35mmFilm": 43}, 500 * 43 / math.hypot(36, 24)),  # by the diagonals of film and photograph
        ({**PLANE, "FocalPlaneResolutionUnit": 2}, 520),
        (PLANE, 520),
        ({**PLANE, "FocalPlaneXResolution": rational(1000), "FocalPlaneResolutionUnit": 3}, 520),
        ({**PLANE, "FocalPlaneXResolution": rational(100), "FocalPlaneResolutionUnit": 4}, 520),
        ({**PLANE, "ExifImageWidth": 800, "ExifImageHeight": 600}, 260),  # it was made smaller
        ({**PLANE, "ExifImageWidth": 600, "ExifImageHeight": 800}, 260),  # and turned
        ({}, None),
        ({"FocalLengthIn35mmFilm": 5}, 500 * 5 / math.hypot(36, 24)),  # 0.1 … 100 diagonals of the photograph
        ({"FocalLengthIn35mmFilm": 4}, None),
        ({"FocalLengthIn35mmFilm": 4326}, 500 * 4326 / math.hypot(36, 24)),
        ({"FocalLengthIn35mmFilm": 4327}, None),
        ({**PLANE, "ExifImageWidth": 807, "ExifImageHeight": 600}, 520 * 400 / 807),  # rounded, at most by a hundredth
        ({**PLANE, "ExifImageWidth": 809, "ExifImageHeight": 600}, None),
        ({"FocalLengthIn35mmFilm": 26, "ExifImageWidth": 800, "ExifImageHeight": 800}, None),  # cut
        ({**PLANE, "FocalLength": IFDRational(5, 0)}, None),
        ({**PLANE, "FocalPlaneResolutionUnit": 1}, None),  # which says that there is none
    ],
)
@pytest.mark.parametrize("orientation", [1, 6])
def test_focal_lengths(tmp_path: Path, tags: dict[str, Any], expected: float | None, orientation: int) -> None:
    exif = Image.Exif()
    exif[TAGS.Orientation] = orientation
    exif[ExifTags.IFD.Exif] = {getattr(TAGS, name): value for name, value in tags.items()}
    Image.new("RGB", (400, 300)).save(tmp_path / "photo.jpg", exif=exif)
    assert read_exif_focal(tmp_path / "photo.jpg") == pytest.approx(expected)


def test_no_photograph_has_no_focal_length(tmp_path: Path) -> None:
    (tmp_path / "text.jpg").write_text("hello")
    for name in ("text.jpg", "missing.jpg"):
        assert read_exif_focal(tmp_path / name) is None


def test_polygons_are_drawn_as_a_mask() -> None:
    mask = draw_polygons([(2, 1, 6, 1, 6, 4, 2, 4), (0, 0, 0, 0, 0, 0)], 8, 10)
    assert (mask.dtype, mask.shape) == (torch.bool, (8, 10))
    assert bool(mask[1:5, 2:7].all())
    assert bool(mask[0, 0])
    assert int(mask.sum()) == 21
