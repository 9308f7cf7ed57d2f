"""Annotated photographs and viewpoints of Table 2: what is read, and errors that name the row and the column."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from nablahog.paper.annotations import MAX_SIDE, read_annotations, read_viewpoints, sample_viewpoints


def _csv(folder: Path, text: str) -> Path:
    path = folder / "list.csv"
    path.write_text(text)
    return path


# --- annotated photographs

HEADS = "image,x0,y0,x1,y1,azimuth,elevation,theta,model"
GOOD = {"image": "a.png", "x0": 10, "y0": 0, "x1": 110, "y1": 90, "azimuth": 0, "elevation": 0, "theta": 0, "model": ""}


@pytest.fixture
def photographs(tmp_path: Path) -> Path:
    (tmp_path / "more").mkdir()
    Image.fromarray(np.full((120, 160, 3), 99, np.uint8)).save(tmp_path / "a.png")
    Image.fromarray(np.full((600, 800), 50, np.uint8)).save(tmp_path / "more" / "b.png")
    (tmp_path / "damaged.png").write_text("hello")
    return tmp_path


def test_annotated_objects(photographs: Path) -> None:
    lines = [HEADS, "a.png,10,-1,110.5,120.5,-42.5,20,-3.5,chair", "more/b.png,0,0,800,600,400,-5,0,"]
    path = _csv(photographs, "\n".join(lines))
    first, second = read_annotations(path)
    assert (first.name, first.image.shape, first.box) == ("a.png#1", (3, 120, 160), (10, 0, 110.5, 120))
    assert (first.azimuth, first.elevation, first.theta, first.model) == (317.5, 20, -3.5, "chair")
    assert (second.name, second.azimuth, second.model) == ("more/b.png#2", 40, None)
    assert len(read_annotations(path, limit=1)) == 1
    least, most = read_annotations(_csv(photographs, f"{HEADS}\na.png,0,0,8,8,0,0,0,\na.png,-1,-1,161,121,0,0,0,"))
    assert (least.box, most.box) == ((0, 0, 8, 8), (0, 0, 160, 120))


def test_large_objects_are_shrunk_with_their_boxes(photographs: Path) -> None:
    """A bright rectangle stays in its box."""
    levels = np.zeros((600, 900), np.uint8)
    levels[100:500, 200:840] = 255
    Image.fromarray(levels).save(photographs / "c.png")
    (one,) = read_annotations(_csv(photographs, f"{HEADS}\nc.png,200,100,840,500,0,0,0,\n"))
    assert one.image.shape == (1, 240, 360)
    assert max(one.box.width, one.box.height) == pytest.approx(MAX_SIDE)
    x0, y0, x1, y1 = (round(side) for side in one.box)
    assert float(one.image[0, y0 + 2 : y1 - 2, x0 + 2 : x1 - 2].min()) > 0.95
    outside = one.image[0].clone()
    outside[y0 - 2 : y1 + 2, x0 - 2 : x1 + 2] = 0
    assert float(outside.max()) < 0.05


def test_factors_across_and_down_differ_by_rounding(photographs: Path) -> None:
    Image.fromarray(np.zeros((10, 2000), np.uint8)).save(photographs / "d.png")
    (one,) = read_annotations(_csv(photographs, f"{HEADS}\nd.png,0,0,2000,10,0,0,0,\n"))
    assert one.image.shape == (1, 1, MAX_SIDE)
    assert one.box == pytest.approx((0, 0, MAX_SIDE, 1))


def test_annotations_that_are_refused(photographs: Path) -> None:
    wrong: list[tuple[dict[str, object], str]] = [
        ({"image": "no.png"}, "column image: .*no.png: no such file"),
        ({"image": "damaged.png"}, "column image: .*damaged.png: expected an image"),
        ({"image": ""}, "column image: expected the name of a file, got ''"),
        ({"theta": ""}, "column theta: expected numbers in the columns azimuth, elevation, theta, got none"),
        ({"azimuth": "", "elevation": ""}, "column azimuth: expected numbers in the columns"),
        (dict.fromkeys(("x0", "y0", "x1", "y1"), ""), "column x0: expected a box, got none"),
        ({"y1": "nan"}, "column y1 must be a finite number, got nan"),
        ({"x1": 15}, "column x1: expected a box of at least 8x8 pixels"),
        ({"x1": 17.9}, "column x1: expected a box of at least 8x8 pixels"),
        *(
            (beyond, r"column x0: the box must lie in the image of 120x160 pixels \(height x width\)")
            for beyond in ({"x0": -1.1}, {"y0": -1.1}, {"x1": 161.1}, {"y1": 121.1})
        ),
        ({"elevation": 95}, "column elevation must be a finite number in -90 … 90, got 95"),
        ({"model": "sofa"}, "column model: expected one of one, two, got 'sofa'"),
    ]
    for changes, message in wrong:
        good, bad = (",".join(map(str, (GOOD | of).values())) for of in ({}, changes))
        path = _csv(photographs, "\n".join([HEADS, good, bad]))
        with pytest.raises(ValueError, match=rf"list.csv, line 3, {message}"):
            read_annotations(path, models={"one", "two"})


# --- viewpoints


def test_viewpoints(tmp_path: Path) -> None:
    path = _csv(tmp_path, 'id,elevation,azimuth,note\na,20.5,-30,x\nb,-90,370,"y,z"\nc,0,-1e-20,\n')
    np.testing.assert_allclose(read_viewpoints(path), [[330, 20.5, 0], [10, -90, 0], [0, 0, 0]])
    np.testing.assert_allclose(read_viewpoints(_csv(tmp_path, "azimuth,elevation,theta\n0,10,-5\n")), [[0, 10, -5]])
    for line, message in (("1,2,", "theta must be a finite"), ("1,90.5,0", "elevation must be")):
        with pytest.raises(ValueError, match=f"line 2, (column )?{message}"):
            read_viewpoints(_csv(tmp_path, f"azimuth,elevation,theta\n{line}\n"))


def test_sampled_viewpoints_cover_all_sides_and_favour_the_front() -> None:
    views = sample_viewpoints(20_000, np.random.default_rng(0))
    azimuth, elevation, theta = views.T
    counts = np.histogram(azimuth, bins=8, range=(0, 360))[0]
    assert counts.min() > 1000
    assert counts[0] > 2 * counts[3]
    assert counts[7] > 2 * counts[4]
    assert 0 <= elevation.min() < 5
    assert 35 < elevation.max() <= 45
    assert elevation.mean() == pytest.approx(20, abs=0.5)
    assert theta.std() == pytest.approx(3, rel=0.05)
    np.testing.assert_array_equal(views, sample_viewpoints(20_000, np.random.default_rng(0)))
