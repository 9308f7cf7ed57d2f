"""Lists of objects: what they say, and errors that name row and column."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from nablahog.hog.box import Box
from nablahog.paper.object_lists import ListedObject, read_objects

COCO: dict[str, Any] = {
    "images": [{"id": 7, "file_name": "in/a.jpg"}, {"id": 9, "file_name": "b.jpg"}],
    "annotations": [
        {"id": 3, "image_id": 9, "bbox": [10, 20, 30.5, 40], "category_id": 1},
        {"id": 1, "image_id": 7, "azimuth": 350, "elevation": -5},
    ],
}


def test_a_csv_file(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("note,image, x0,y0,x1,y1,azimuth,elevation\n,a.jpg,1,2,30,40.5,,\n\n,in/b.jpg,,,,,30,10\n")
    assert read_objects(path) == [
        ListedObject(1, "a.jpg", Box(1, 2, 30, 40.5)),
        ListedObject(2, "in/b.jpg", None, (30, 10)),
    ]
    path.write_text('\ufeffimage\n"a,b.jpg"\n')
    assert read_objects(path) == [ListedObject(1, "a,b.jpg")]


def test_a_file_like_cocos(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text(json.dumps(COCO))
    assert read_objects(path) == [
        ListedObject(3, "b.jpg", Box(10, 20, 40.5, 60)),
        ListedObject(1, "in/a.jpg", None, (350, -5)),
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("file\na.jpg\n", "line 1: expected the column image"),
        ("image,x0,y0,x1\na.jpg,1,2,3\n", "line 1: expected the columns x0, y0, x1, y1 together, but y1 is missing"),
        ("image\n", "expected at least one object, got none"),
        ("image,x0,y0,x1,y1\na.jpg,1,2,3,4\nb.jpg,1,2,,4\n", "line 3: column x1: expected a finite number of pixels"),
        ("image,x0,y0,x1,y1\na.jpg,1,2,3\n", "line 2: column y1: expected a finite number of pixels, got None"),
        ("image,x0,y0,x1,y1\na.jpg,1,2,3,inf\n", "line 2: column y1: expected a finite number of pixels, got 'inf'"),
        ("image,x0,y0,x1,y1\na.jpg,5,2,3,4\n", "line 2: expected a box with sides above 0"),
        ("image,azimuth,elevation\na.jpg,5,91\n", "line 2: column elevation: expected degrees in -90…90, got 91"),
        ("image\n../a.jpg\n", "line 2: column image: expected the name of a file in the folder of photographs"),
        ("image\n/etc/passwd\n", "line 2: column image: expected the name of a file in the folder"),
        ("image,x0,y0,x1,y1\n,1,2,3,4\n", "line 2: column image: expected the name of a file"),
    ],
)
def test_refuses_a_csv_file(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=message) as raised:
        read_objects(path)
    assert str(raised.value).startswith(str(path))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"images": []}, "expected an object with the lists images and annotations"),
        ({"annotations": 3}, "expected an object with the lists images and annotations"),
        ({"images": [{"id": "x"}]}, r"images\[0\]: id: expected an integer, got 'x'"),
        ({"images": [5]}, r"images\[0\]: id: expected an integer, got None"),
        ({"images": [{"id": 7}]}, r"annotations\[0\]: image_id: expected the id of one of the images, got 9"),
        ({"images": [{"id": 7}, {"id": 9}]}, r"annotations\[0\]: image: expected the name of a file"),
        ({"annotations": [{"id": 1, "image_id": 7}] * 2}, r"annotations\[1\]: id: expected another one for each"),
        ({"annotations": [{"id": 1, "image_id": 7, "bbox": [1, 2]}]}, r"annotations\[0\]: bbox: expected x, y, width"),
        ({"annotations": [{"id": 1, "image_id": 7, "bbox": [1, 2, 3, "w"]}]}, r"bbox: expected a finite number"),
        ({"annotations": [{"id": 1, "image_id": 7, "azimuth": 3}]}, r"annotations\[0\]: elevation: expected a finite"),
        ({"annotations": []}, "expected at least one object"),
    ],
)
def test_refuses_a_json_file(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    path = tmp_path / "a.json"
    path.write_text(json.dumps({**COCO, **change}))
    with pytest.raises(ValueError, match=message):
        read_objects(path)


@pytest.mark.parametrize("text", ["{", "[1]", "[" * 100_000, '{"images": 3}'])
def test_refuses_what_is_no_list(tmp_path: Path, text: str) -> None:
    path = tmp_path / "a.json"
    path.write_text(text)
    with pytest.raises(ValueError, match="expected"):
        read_objects(path)
    with pytest.raises(ValueError, match=r"got the ending '.txt'"):
        read_objects(path.rename(path.with_suffix(".txt")))
    with pytest.raises(FileNotFoundError, match="no such file"):
        read_objects(tmp_path / "none.csv")
