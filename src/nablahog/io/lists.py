"""Lists in files: tables row by row (CSV), and objects in photographs as boxes (CSV, or JSON like COCO's)."""

from __future__ import annotations

import csv
import io
import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from ..inputs.boxes import Box
from ..inputs.numbers import as_integer, as_number, as_numbers, parse_numbers
from ..runtime.text import decode_text, one_line, unguard_formula
from .input_file import input_file

MAX_TABLE_BYTES = 2**28  # of a file
LARGEST_ID = 10**18  # of an object in a list
SIDES = ("x0", "y0", "x1", "y1")
ANGLES = ("azimuth", "elevation", "theta")
BOUNDS = {"elevation": {"least": -90, "most": 90}}  # of numbers, by column
_OTHER_NAMES = dict(zip(("xmin", "ymin", "xmax", "ymax"), SIDES, strict=True))  # as in PASCAL VOC


@dataclass(frozen=True)
class ListEntry:
    """A row of a table, or an entry of another list: where it is, for messages, and its values by column.

    ``decimal`` is the character between whole numbers and fractions.
    """

    where: str
    values: Mapping[str, object]
    decimal: str = "."

    def error(self, column: str, message: str) -> ValueError:
        """The error to raise about the value of a column."""
        return ValueError(f"{self.where}, column {column}: {message}")

    def text(self, column: str) -> str:
        """The text of a column without blanks around it; empty if there is none."""
        value = self.values.get(column)
        return value.strip() if isinstance(value, str) else ""

    def number(self, column: str, **bounds: Any) -> float:
        """The number in a column, in the bounds of :func:`.as_number`; ValueError if it is none."""
        value = self.values.get(column)
        number = parse_numbers(value.replace(self.decimal, ".")) if isinstance(value, str) else value
        return as_number(f"{self.where}, column {column}", number, **bounds)

    def numbers(self, columns: Sequence[str]) -> list[float] | None:
        """The numbers in some columns; None if all are empty; ValueError if some are, or one is not a finite number."""
        if all(str(self.values.get(column) or "").strip() == "" and self.values.get(column) != 0 for column in columns):
            return None
        return [self.number(column, **BOUNDS.get(column, {})) for column in columns]


def read_list(path: Path, expected: str) -> bytes:
    """The bytes of a file, at most :data:`MAX_TABLE_BYTES`.

    Raises:
        FileNotFoundError, ValueError: there is no such file, it is not a regular one, or it is larger.
    """
    input_file(path).check(expected)
    if path.stat().st_size > MAX_TABLE_BYTES:
        raise ValueError(f"{path}: a list of more than {MAX_TABLE_BYTES:,} bytes is refused")
    return path.read_bytes()


def read_csv(path: str | os.PathLike[str], required: Sequence[str]) -> list[ListEntry]:
    """The rows below the line of column names, empty ones left out.

    Args:
        path: a file in UTF-8, or in UTF-16 with a byte order mark.  Its columns are divided by commas; or by semicolons
            or tabs, and then numbers may have a decimal comma.  Capitals in their names do not matter.
        required: columns that it must have; further ones may stand anywhere.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it has more than :data:`MAX_TABLE_BYTES`, is no such file, lacks a column, or has no row.
    """
    path = Path(path)
    line, data = 1, read_list(path, "a CSV file")
    try:
        written = io.StringIO(decode_text(data), newline=None).read()
        table = re.sub(r"\Asep=.\n", "", written)  # a remark for spreadsheets
        remarks = int(table != written)
        delimiter = max(",;\t", key=table.partition("\n")[0].count)  # the first of equals
        reader = csv.DictReader(io.StringIO(table), delimiter=delimiter, skipinitialspace=True)
        written_names = [name.strip().lower() for name in reader.fieldnames or ()]
        names = [_OTHER_NAMES.get(name, name) for name in written_names]
        reader.fieldnames = names
        missing = [name for name in required if name not in names]
        if missing:
            raise ValueError(
                f"expected the columns {', '.join(required)}, divided by commas, semicolons or tabs, but {missing[0]} "
                f"is missing among {', '.join(written_names) or 'none'}: rename the one that means it, or add it"
            )
        twice = next((name for name in names if name and names.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f"expected one column {twice}, got {names.count(twice)}")
        rows = []
        for values in reader:
            line = reader.line_num + remarks
            if any(values.pop(None, ())):  # commas in numbers shift all that follow
                raise ValueError(f"expected one value per column, {len(names)} in all, got more")
            rows.append(ListEntry(f"{path}, line {line}", values, "." if delimiter == "," else ","))
    except (ValueError, csv.Error) as error:  # UnicodeDecodeError is a ValueError
        raise ValueError(f"{path}, line {line}: {one_line(error)}") from None
    if not rows:
        raise ValueError(f"{path}: expected at least one row below the names of the columns, got none")
    return rows


@dataclass(frozen=True)
class AnnotatedObject:
    """What a list says about an object in a photograph.

    Attributes:
        id: of the object in its list, unique.
        image: the file of the photograph, relative to the folder of all.
        box: of the object, pixels; None if unknown.
        view: its azimuth and elevation, degrees; None if unknown.
        theta: its rotation in the image, degrees; None if unknown.
        model: the name of its CAD model, or of the one most like it; None if unknown.
        polygons: its outline, each polygon x, y, x, y, … in pixels, if the list has it in place of a box.
    """

    id: int
    image: str
    box: Box | None = None
    view: tuple[float, float] | None = None
    theta: float | None = None
    model: str | None = None
    polygons: tuple[tuple[float, ...], ...] = ()


def read_objects(path: str | os.PathLike[str], folder: str | os.PathLike[str] | None = None) -> list[AnnotatedObject]:
    """The objects that a file lists, in its order.

    A CSV file has a line of column names and then a line for each object: ``image``, and where they are known ``x0``,
    ``y0``, ``x1``, ``y1`` (or ``xmin``, ``ymin``, ``xmax``, ``ymax``), ``azimuth`` and ``elevation``, ``theta``, and
    ``model``.  Other columns are not read; objects are numbered from 1, unless the column ``id`` has a different whole
    number for each.  A JSON file is like those of COCO: ``images`` with ``id`` and ``file_name``, ``annotations`` with
    ``id``, ``image_id``, ``bbox`` (x, y, width, height) and perhaps angles and ``model``.  Where there is no ``bbox``,
    the polygons of ``segmentation`` tell the box.

    Args:
        path: the file, in UTF-8.
        folder: of the photographs; the list may name those in it by their absolute paths, too.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is no such file, lists nothing, or a value is none of the above; the message names row and
            column.

    >>> from pathlib import Path
    >>> _ = Path("chairs.csv").write_text("image,x0,y0,x1,y1\\na.jpg,10,20,110,220\\nb.jpg,,,,\\n")
    >>> for each in nablahog.io.lists.read_objects("chairs.csv"):
    ...     print(each.id, each.image, each.box)
    1 a.jpg Box(x0=10.0, y0=20.0, x1=110.0, y1=220.0)
    2 b.jpg None
    """
    path = Path(path)
    ending = path.suffix.lower()
    if ending not in (".csv", ".json"):
        input_file(path).check("a CSV or JSON file")
        raise ValueError(f"{path}: expected a list of objects (.csv, .json), got the ending {path.suffix!r}")
    return _read_csv_objects(path, folder) if ending == ".csv" else _read_json_objects(path, folder)


def _read_csv_objects(path: Path, folder: str | os.PathLike[str] | None) -> list[AnnotatedObject]:
    rows = read_csv(path, ("image",))
    for group in (SIDES, ANGLES[:2]):
        missing = [name for name in group if name not in rows[0].values]
        if missing and len(missing) < len(group):
            raise ValueError(f"{path}: expected the columns {', '.join(group)} together, but {missing[0]} is missing")
    if SIDES[0] not in rows[0].values and {"width", "height", "w", "h", "bbox", "x2", "right"} & rows[0].values.keys():
        raise ValueError(f"{path}: expected boxes in the columns {', '.join(SIDES)}, got {', '.join(rows[0].values)}")
    ids = [row.text("id") for row in rows]
    numbers = [int(text) for text in ids if re.fullmatch("[0-9]{1,18}", text)]
    if len({*numbers}) < len(rows):
        numbers = [*range(1, len(rows) + 1)]
    return [
        read_object(number, row, _relative_name(row, unguard_formula(row.text("image")), folder))
        for number, row in zip(numbers, rows, strict=True)
    ]


def _read_json_objects(path: Path, folder: str | os.PathLike[str] | None) -> list[AnnotatedObject]:
    data = read_list(path, "a JSON file")
    try:
        whole = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: expected JSON, but it cannot be read: {one_line(error)}") from None
    images, annotations = (whole.get(key) if isinstance(whole, dict) else None for key in ("images", "annotations"))
    if not isinstance(images, list) or not isinstance(annotations, list) or not annotations:
        raise ValueError(f"{path}: expected an object with the lists images and annotations, as COCO has them")
    names = {_id(row, "id"): row.values.get("file_name") for row in _list_entries(path, "images", images)}
    objects: dict[int, AnnotatedObject] = {}
    for row in _list_entries(path, "annotations", annotations):
        number, image = _id(row, "id"), _id(row, "image_id")
        if image not in names:
            raise row.error("image_id", f"expected the id of one of the images, got {image}")
        if number in objects:
            raise row.error("id", f"expected a different id for each object, got {number} twice")
        objects[number] = read_object(number, row, _relative_name(row, names[image], folder))
    return list(objects.values())


def _list_entries(path: Path, name: str, items: list[Any]) -> list[ListEntry]:
    wrong = next((k for k, entry in enumerate(items) if not isinstance(entry, Mapping)), None)
    if wrong is not None:
        raise ValueError(f"{path}, {name}[{wrong}]: expected an object, got {one_line(repr(items[wrong]), 60)}")
    return [ListEntry(f"{path}, {name}[{k}]", entry) for k, entry in enumerate(items)]


def _id(row: ListEntry, key: str) -> int:
    return as_integer(f"{row.where}, column {key}", row.values.get(key), -LARGEST_ID, LARGEST_ID)


def _relative_name(row: ListEntry, image: object, folder: str | os.PathLike[str] | None) -> str:
    """The name of a file in the folder of photographs, or below, relative to it: others are refused."""
    name = image.strip().replace("\\", "/") if isinstance(image, str) else ""  # lists of Windows, too
    if folder is not None and os.path.isabs(name) and "\0" not in name:
        inside = os.path.relpath(os.path.normpath(name), os.path.abspath(folder)).replace(os.sep, "/")
        name = name if inside.startswith("..") else inside
    if not name or PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts or "\0" in name:
        expected = "the name of a file in the folder of photographs, or below"
        raise row.error("image", f"expected {expected}, got {one_line(repr(image), 60)}")
    return name


def read_object(number: int, row: ListEntry, image: str) -> AnnotatedObject:
    """The object of a row of either format, in the file ``image``; ValueError, with the row, if a value is wrong."""
    sides = row.numbers(SIDES)
    if "bbox" in row.values:
        x, y, width, height = as_numbers(f"{row.where}, column bbox", row.values["bbox"], "x, y, width, height")
        sides = [x, y, x + width, y + height]
    polygons = () if sides is not None else _read_polygons(row)
    if polygons:
        along_x, along_y = ([value for polygon in polygons for value in polygon[k::2]] for k in (0, 1))
        sides = [min(along_x), min(along_y), max(along_x), max(along_y)]
    box = None if sides is None else Box(*sides)
    if box is not None and not (box.width > 0 and box.height > 0):
        raise ValueError(f"{row.where}: expected a box with sides above 0, got {tuple(box)}")
    view = row.numbers(ANGLES[:2])
    (theta,) = row.numbers(ANGLES[2:]) or (None,)
    angles = None if view is None else (view[0], view[1])
    return AnnotatedObject(number, image, box, angles, theta, row.text("model") or None, polygons)


def _read_polygons(row: ListEntry) -> tuple[tuple[float, ...], ...]:
    """The polygons of COCO's ``segmentation``; none if there is none."""
    column = "segmentation"
    polygons = row.values.get(column)
    if not polygons or isinstance(polygons, str):  # another table's text
        return ()
    if not isinstance(polygons, list) or not all(
        isinstance(polygon, list) and len(polygon) >= 6 and len(polygon) % 2 == 0 for polygon in polygons
    ):
        expected = "a bbox, or polygons [[x, y, x, y, x, y, …], …]"
        raise row.error(column, f"expected {expected}, got {one_line(repr(polygons), 60)}")
    where = f"{row.where}, column {column}"
    return tuple(tuple(as_number(where, value) for value in polygon) for polygon in polygons)
