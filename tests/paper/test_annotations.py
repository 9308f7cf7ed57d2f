"""Annotated photographs: what is read, and errors that name the line and the column."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from nablahog.paper.annotations import MOST, read_annotations

HEADS = "image,x0,y0,x1,y1,azimuth,elevation,theta,model"


@pytest.fixture
def photographs(tmp_path: Path) -> Path:
    folder = tmp_path / "photographs"
    (folder / "more").mkdir(parents=True)
    Image.fromarray(np.full((120, 160, 3), 99, np.uint8)).save(folder / "a.png")
    Image.fromarray(np.full((600, 800), 50, np.uint8)).save(folder / "more" / "b.png")
    (folder / "damaged.png").write_text("hello")
    return folder


def _csv(folder: Path, *lines: str, heads: str = HEADS) -> Path:
    path = folder.parent / "objects.csv"
    path.write_text("\n".join([heads, *lines]) + "\n")
    return path


def test_objects(photographs: Path) -> None:
    path = _csv(photographs, "a.png,10,5,110.5,120,-42.5,20,-3.5,chair", "", "more/b.png,0,0,800,600,400,-5,0,")
    first, second = read_annotations(path, photographs)
    assert (first.name, first.image.shape, first.box) == ("a.png#1", (3, 120, 160), (10, 5, 110.5, 120))
    assert (first.azimuth, first.elevation, first.theta, first.model) == (317.5, 20, -3.5, "chair")
    assert (second.name, second.azimuth, second.model) == ("more/b.png#2", 40, None)
    assert len(read_annotations(path, photographs, limit=1)) == 1


def test_large_objects_are_shrunk_with_their_boxes(photographs: Path) -> None:
    """A bright rectangle stays in its box."""
    levels = np.zeros((600, 900), np.uint8)
    levels[100:500, 200:840] = 255
    Image.fromarray(levels).save(photographs / "c.png")
    (one,) = read_annotations(_csv(photographs, "c.png,200,100,840,500,0,0,0,"), photographs)
    assert one.image.shape == (1, 240, 360)
    assert max(one.box.width, one.box.height) == pytest.approx(MOST)
    x0, y0, x1, y1 = (round(side) for side in one.box)
    assert float(one.image[0, y0 + 2 : y1 - 2, x0 + 2 : x1 - 2].min()) > 0.95
    outside = one.image[0].clone()
    outside[y0 - 2 : y1 + 2, x0 - 2 : x1 + 2] = 0
    assert float(outside.max()) < 0.05
    assert torch.isfinite(one.image).all()


def test_columns_in_any_order_and_others(photographs: Path) -> None:
    heads = "note, theta,elevation,azimuth,y1,x1,y0,x0,image"
    (one,) = read_annotations(_csv(photographs, "x,1,2,3,100,90,0,5,a.png", heads=heads), photographs)
    assert (one.box, one.azimuth, one.elevation, one.theta, one.model) == ((5, 0, 90, 100), 3, 2, 1, None)


def test_boxes_a_pixel_beyond_are_cut_at_the_border(photographs: Path) -> None:
    (one,) = read_annotations(_csv(photographs, "a.png,-1,0,161,120.5,0,0,0,"), photographs)
    assert one.box == (0, 0, 160, 120)


GOOD = {"image": "a.png", "x0": 10, "y0": 0, "x1": 110, "y1": 90, "azimuth": 0, "elevation": 0, "theta": 0, "model": ""}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"image": ""}, "column image: expected the name of a file, got ''"),
        ({"image": "no.png"}, "column image: .*no.png: no such file"),
        ({"image": "damaged.png"}, "column image: .*damaged.png: expected an image"),
        ({"image": "more"}, "column image: .*more: expected an image file, got a folder"),
        ({"x0": "left"}, "column x0: expected a finite number of pixels, got 'left'"),
        ({"y1": "nan"}, "column y1: expected a finite number of pixels, got 'nan'"),
        ({"y1": ""}, "column y1: expected a finite number of pixels, got ''"),
        ({"x1": 15}, "column x1: expected at least 8 pixels more than x0, 10, got 15"),
        ({"y1": 130}, r"column y1: the box must lie in the image a.png of 120x160 pixels \(height x width\), got 130"),
        ({"x0": -30}, "column x0: the box must lie in the image a.png of 120x160 pixels .*, got -30"),
        ({"azimuth": "front"}, "column azimuth: expected a finite number of degrees, got 'front'"),
        ({"elevation": 95}, "column elevation: expected -90…90 degrees, got 95"),
        ({"theta": "inf"}, "column theta: expected a finite number of degrees, got 'inf'"),
        ({"model": "sofa"}, "column model: expected one of one, two, got 'sofa'"),
    ],
)
def test_errors_name_line_and_column(photographs: Path, changes: dict[str, object], message: str) -> None:
    good, bad = (",".join(map(str, (GOOD | of).values())) for of in ({}, changes))
    path = _csv(photographs, good, bad)
    with pytest.raises(ValueError, match=rf"objects.csv, line 3, {message}") as error:
        read_annotations(path, photographs, {"one", "two"})
    assert "\n" not in str(error.value)


def test_files_that_are_no_annotations(photographs: Path) -> None:
    with pytest.raises(ValueError, match=r"line 1: expected the columns image, x0, .*, but y1 and theta is missing"):
        read_annotations(_csv(photographs, heads="image,x0,y0,x1,azimuth,elevation"), photographs)
    with pytest.raises(ValueError, match="expected at least one object below the names"):
        read_annotations(_csv(photographs), photographs)
    with pytest.raises(FileNotFoundError, match=r"no\.csv: no such file"):
        read_annotations(photographs / "no.csv", photographs)
    with pytest.raises(FileNotFoundError, match="no such folder"):
        read_annotations(_csv(photographs), photographs / "no")
    path = photographs / "latin.csv"
    path.write_bytes(HEADS.encode() + b"\n\xff\n")
    with pytest.raises(ValueError, match=r"latin\.csv, line 1: 'utf-8' codec"):
        read_annotations(path, photographs)
