"""Lists of objects: what is read, and errors that name the row and the column."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from nablahog.inputs.boxes import Box
from nablahog.io import lists
from nablahog.io.lists import AnnotatedObject, read_csv, read_objects


def _write(folder: Path, content: str | dict[str, Any], encoding: str = "utf-8") -> Path:
    """A list as CSV, or as JSON where the content is that or an object."""
    text = content if isinstance(content, str) else json.dumps(content)
    path = folder / ("list.json" if text.startswith(("{", "[")) else "list.csv")
    path.write_bytes(text.encode(encoding))
    return path


# --- rows


@pytest.mark.parametrize(
    ("text", "encoding"),
    [
        ('image, x\n"a,b.jpg", 1.5\n\nc.jpg,-2\n', "utf-8"),
        ('image,x\r\n"a,b.jpg",1.5\r\nc.jpg,-2\r\n', "utf-8-sig"),
        ('sep=,\nIMAGE,X,,\n"a,b.jpg",1.5,,,\nc.jpg,-2,,\n', "utf-8"),  # a remark for Excel, and its empty cells
        ('image,x\r"a,b.jpg",1.5\rc.jpg,-2\r', "utf-8"),
        ("image\tx\r\na,b.jpg\t1,5\r\nc.jpg\t-2\r\n", "utf-16"),  # "Unicode text" of Excel
        ("image;x;note\na,b.jpg;1,5;x\nc.jpg;-2;\n", "utf-8-sig"),  # as Excel writes it where the comma is decimal
    ],
)
def test_rows(tmp_path: Path, text: str, encoding: str) -> None:
    read = read_csv(_write(tmp_path, text, encoding), ("image", "x"))
    assert [(row.text("image"), row.number("x")) for row in read] == [("a,b.jpg", 1.5), ("c.jpg", -2)]
    assert read[0].text("none") == ""


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("image_path,xmin\na.png,1\n", "image is missing among image_path, xmin: rename the one that means it"),
        ("", "line 1: expected the columns image, x, .* but image is missing"),
        ("image|x\na|1\n", "divided by commas, semicolons or tabs"),
        ("image,x,X\na,1,2\n", "line 1: expected one column x, got 2"),
        ("image,x\na,1,5\n", "line 2: expected one value per column, 2 in all, got more"),  # commas in numbers
        ("image,x\n", "expected at least one row below the names of the columns, got none"),
        ("image,x\na,1\nb,1e400\n", "line 3, column x must be a finite number, got inf"),
        ("image,x\na\n", "line 2, column x must be a finite number, got None"),
        ('image,x\n"a\n' + 140_000 * "x", "field larger than field limit"),
        ("image,x\n\xff\n", "line 1: 'utf-8' codec"),
    ],
)
def test_rows_that_are_refused(tmp_path: Path, text: str, message: str) -> None:
    path = _write(tmp_path, text, "latin-1")
    with pytest.raises(ValueError, match=message) as caught:
        [row.number("x") for row in read_csv(path, ("image", "x"))]
    assert str(caught.value).startswith(str(path))


# --- lists of objects

COCO: dict[str, Any] = {
    "images": [{"id": 7, "file_name": "in/a.jpg"}, {"id": 9, "file_name": "b.jpg"}],
    "annotations": [
        {"id": 3, "image_id": 9, "bbox": [10, 20, 30.5, 40], "category_id": 1},
        {"id": 1, "image_id": 7, "azimuth": 0, "elevation": -5},
    ],
}


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("image,xmin,ymin,xmax,ymax\nin\\a.jpg,1,2,30,40\n", [AnnotatedObject(1, "in/a.jpg", Box(1, 2, 30, 40))]),
        (
            "image,x0,y0,x1,y1,azimuth,elevation,theta,model\na.jpg,1,2,30,40.5,,,,\nin/b.jpg,,,,,30,10,-2,a\n",
            [AnnotatedObject(1, "a.jpg", Box(1, 2, 30, 40.5)), AnnotatedObject(2, "in/b.jpg", None, (30, 10), -2, "a")],
        ),
        (COCO, [AnnotatedObject(3, "b.jpg", Box(10, 20, 40.5, 60)), AnnotatedObject(1, "in/a.jpg", None, (0, -5))]),
        ("image,id\na,7\nb,5\n", [AnnotatedObject(7, "a"), AnnotatedObject(5, "b")]),
        ("image,id\na,7\nb,7\n", [AnnotatedObject(1, "a"), AnnotatedObject(2, "b")]),  # ids that are no ids
        ("image,id\na,7\nb,a\n", [AnnotatedObject(1, "a"), AnnotatedObject(2, "b")]),
    ],
)
def test_objects(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, content: Any, expected: list[AnnotatedObject]
) -> None:
    path = _write(tmp_path, content)
    monkeypatch.setattr(lists, "MAX_TABLE_BYTES", path.stat().st_size)
    assert read_objects(path) == expected
    monkeypatch.setattr(lists, "MAX_TABLE_BYTES", path.stat().st_size - 1)
    with pytest.raises(ValueError, match=rf"{path.name}: a list of more than {path.stat().st_size - 1} bytes is ref"):
        read_objects(path)


def test_polygons_take_the_place_of_a_missing_box(tmp_path: Path) -> None:
    sides = [28, 12, 95, 12, 95, 125, 28, 125]
    annotations = [
        {"id": 1, "image_id": 7, "segmentation": [sides, [100, 12, 110, 12, 110, 20.5]]},
        {"id": 2, "image_id": 7, "segmentation": [sides], "bbox": [1, 2, 3, 4]},
        {"id": 3, "image_id": 7, "segmentation": []},
    ]
    outlined, boxed, unknown = read_objects(_write(tmp_path, {**COCO, "annotations": annotations}))
    assert outlined.box == Box(28, 12, 110, 125)
    assert outlined.polygons == (tuple(sides), (100, 12, 110, 12, 110, 20.5))
    assert (boxed.box, boxed.polygons, unknown.box) == (Box(1, 2, 4, 6), (), None)


def test_absolute_names_of_files_in_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = _write(tmp_path, f"image\n{tmp_path}/photos/in/a.jpg\n")
    for folder in ("photos", tmp_path / "photos"):
        assert read_objects(path, folder)[0].image == "in/a.jpg"
    with pytest.raises(ValueError, match="expected the name of a file in the folder"):
        read_objects(path, tmp_path / "photos" / "in" / "deeper")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("image,x0,y0,x1\na.jpg,1,2,3\n", "expected the columns x0, y0, x1, y1 together, but y1 is missing"),
        ("image,x,y,width,height\na.jpg,1,2,3,4\n", "expected boxes in the columns x0, y0, x1, y1, got image, x, y"),
        ("image,x0,y0,x1,y1\na.jpg,1,2,3,4\nb.jpg,1,2,,4\n", "line 3, column x1 must be a finite number"),
        ("sep=;\nimage;x0;y0;x1;y1\na.jpg;1;2;x;4\n", "line 3, column x1"),  # the remark of spreadsheets counts
        ("image,x0,y0,x1,y1\na.jpg,5,2,3,4\n", "line 2: expected a box with sides above 0"),
        ("image,azimuth,elevation\na.jpg,5,91\n", "line 2, column elevation must be a finite number in -90 … 90"),
        ("image\n../a.jpg\n", "line 2, column image: expected the name of a file in the folder of photographs"),
        ("image\n/etc/passwd\n", "line 2, column image: expected the name of a file in the folder"),
        ("{", "expected"),
        ("[1]", "expected"),
        ("[" * 100_000, "expected"),
        ({"images": 3}, "expected an object with the lists images and annotations"),
        ({"images": [{"id": "x"}]}, r"images\[0\], column id must be an integer in .*, got 'x'"),
        ({"images": [5]}, r"images\[0\]: expected an object"),
        (
            {"images": [{"id": 10**18 + 1}]},
            r"images\[0\], column id must be an integer in .* 1,000,000,000,000,000,000, got",
        ),
        ({"images": [{"id": 10**18}]}, r"annotations\[0\], column image_id: expected the id of one"),
        ({"images": [{"id": 7}]}, r"annotations\[0\], column image_id: expected the id of one of the images, got 9"),
        ({"annotations": [{"id": 1, "image_id": 7}] * 2}, r"annotations\[1\], column id: expected a different id for"),
        ({"annotations": [{"id": 1, "image_id": 7, "segmentation": {"counts": "x"}}]}, "segmentation: expected a bbox"),
        ({"annotations": [{"id": 1, "image_id": 7, "segmentation": [[1, 2, 3, 4, 5, "x"]]}]}, "must be a finite numb"),
        *(
            ({"annotations": [{"id": 1, "image_id": 7, "segmentation": [[*range(length)]]}]}, "expected a bbox, or pol")
            for length in (4, 5, 7)
        ),
        ({"annotations": [{"id": 1, "image_id": 7, "bbox": [1, 2]}]}, r"column bbox must be 4 finite numbers"),
        ({"annotations": [{"id": 1, "image_id": 7, "bbox": [1, 2, 3, True]}]}, r"bbox must be 4 finite numbers"),
    ],
)
def test_objects_that_are_refused(tmp_path: Path, content: Any, message: str) -> None:
    content = {**COCO, **content} if isinstance(content, dict) else content
    with pytest.raises(ValueError, match=message):
        read_objects(_write(tmp_path, content))


def test_a_list_by_another_name(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"got the ending '.txt'"):
        read_objects(_write(tmp_path, COCO).rename(tmp_path / "a.txt"))
