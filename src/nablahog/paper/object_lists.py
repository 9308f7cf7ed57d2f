"""Objects in photographs, as lists of boxes: CSV files, and JSON files like COCO's."""

from __future__ import annotations

import csv
import json
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from ..hog.box import Box
from ..io.files import check_file
from ..runtime.text import one_line

MAX_BYTES = 2**28  # of a list
_SIDES = ("x0", "y0", "x1", "y1")
_VIEW = ("azimuth", "elevation")


@dataclass(frozen=True)
class ListedObject:
    """An object in a photograph.

    Attributes:
        id: of the object in its list, unique.
        image: the file of the photograph, relative to the folder of all.
        box: of the object, pixels; None if unknown.
        initial: about its azimuth and elevation, degrees; None if unknown.
    """

    id: int
    image: str
    box: Box | None = None
    initial: tuple[float, float] | None = None


def read_objects(path: str | os.PathLike[str]) -> list[ListedObject]:
    """The objects that a file lists, in its order.

    A CSV file has a line of column names and then a line for each object: ``image``, and where they are known ``x0``,
    ``y0``, ``x1``, ``y1``, and ``azimuth`` and ``elevation``.  Other columns are not read; objects are numbered from 1.
    A JSON file is like those of COCO: ``images`` with ``id`` and ``file_name``, ``annotations`` with ``id``,
    ``image_id``, ``bbox`` (x, y, width, height) and perhaps ``azimuth`` and ``elevation``.

    Args:
        path: the file, in UTF-8.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is no such file, lists nothing, or a value is none of the above; the message names row and
            column.

    >>> from pathlib import Path
    >>> _ = Path("chairs.csv").write_text("image,x0,y0,x1,y1\\na.jpg,10,20,110,220\\nb.jpg,,,,\\n")
    >>> for each in nablahog.paper.object_lists.read_objects("chairs.csv"):
    ...     print(each.id, each.image, each.box)
    1 a.jpg Box(x0=10.0, y0=20.0, x1=110.0, y1=220.0)
    2 b.jpg None
    """
    path = Path(path)
    check_file(path, "a CSV or JSON file")
    if path.stat().st_size > MAX_BYTES:
        raise ValueError(f"{path}: a list of more than {MAX_BYTES:,} bytes is refused")
    read: dict[str, Callable[[Path], list[ListedObject]]] = {".csv": _of_csv, ".json": _of_json}
    if path.suffix.lower() not in read:
        raise ValueError(f"{path}: expected a list of objects (.csv, .json), got the ending {path.suffix!r}")
    annotations = read[path.suffix.lower()](path)
    if not annotations:
        raise ValueError(f"{path}: expected at least one object, got none")
    return annotations


def _of_csv(path: Path) -> list[ListedObject]:
    with open(path, newline="", encoding="utf-8-sig") as file:
        reader = csv.DictReader(file, skipinitialspace=True)
        try:
            names = [name.strip() for name in reader.fieldnames or ()]
            reader.fieldnames = names
            if "image" not in names:
                raise ValueError("expected the column image, but it is missing")
            for group in (_SIDES, _VIEW):
                given = [name for name in group if name in names]
                if given and len(given) < len(group):
                    missing = ", ".join(name for name in group if name not in names)
                    raise ValueError(f"expected the columns {', '.join(group)} together, but {missing} is missing")
            return [_listed_object(number, row, row["image"], "column ") for number, row in enumerate(reader, 1)]
        except (ValueError, csv.Error) as error:  # UnicodeDecodeError is a ValueError
            raise ValueError(f"{path}, line {max(1, reader.line_num)}: {one_line(error)}") from None


def _of_json(path: Path) -> list[ListedObject]:
    try:
        whole = json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: expected JSON, but it cannot be read: {one_line(error)}") from None
    images, found = (whole.get(key) if isinstance(whole, dict) else None for key in ("images", "annotations"))
    if not isinstance(images, list) or not isinstance(found, list) or not images:
        raise ValueError(f"{path}: expected an object with the lists images and annotations, as COCO has them")
    where = "images"
    try:
        names: dict[Any, object] = {}
        for k, each in enumerate(images):
            where = f"images[{k}]"
            image = _id(each, "id")
            names[image] = each.get("file_name")
        annotations, taken = [], set()
        for k, each in enumerate(found):
            where = f"annotations[{k}]"
            number, image = _id(each, "id"), _id(each, "image_id")
            if image not in names:
                raise ValueError(f"image_id: expected the id of one of the images, got {image}")
            if number in taken:
                raise ValueError(f"id: expected another one for each object, got {number} twice")
            taken.add(number)
            annotations.append(_listed_object(number, each, names[image], ""))
        return annotations
    except ValueError as error:
        raise ValueError(f"{path}, {where}: {one_line(error)}") from None


def _id(entry: object, key: str) -> int:
    value = entry.get(key) if isinstance(entry, dict) else None
    if not isinstance(value, int) or isinstance(value, bool):
        raise ValueError(f"{key}: expected an integer, got {one_line(repr(value), 60)}")
    return value


def _listed_object(number: int, row: Mapping[str, object], image: object, kind: str) -> ListedObject:
    """Of a row of either format; ``kind`` is what errors call its keys."""
    name = image.strip() if isinstance(image, str) else ""
    if not name or PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts or "\0" in name:
        expected = "the name of a file in the folder of photographs, or below"
        raise ValueError(f"{kind}image: expected {expected}, got {one_line(repr(image), 60)}")
    box = None
    if "bbox" in row:
        corner = row["bbox"]
        if not isinstance(corner, list) or len(corner) != 4:
            raise ValueError(f"bbox: expected x, y, width, height, got {one_line(repr(corner), 60)}")
        x, y, width, height = (_number(value, "bbox", "pixels") for value in corner)
        box = Box(x, y, x + width, y + height)
    elif (sides := _together(row, _SIDES, kind, "pixels")) is not None:
        box = Box.of(sides)
    if box is not None and not (box.width > 0 and box.height > 0):
        raise ValueError(f"expected a box with sides above 0, got {tuple(box)}")
    view = _together(row, _VIEW, kind, "degrees")
    if view is not None and abs(view[1]) > 90:
        raise ValueError(f"{kind}elevation: expected degrees in -90…90, got {view[1]:g}")
    return ListedObject(number, name, box, None if view is None else (view[0], view[1]))


def _together(row: Mapping[str, object], names: tuple[str, ...], kind: str, unit: str) -> list[float] | None:
    """The numbers of some columns; None if all of them are empty."""
    if all(row.get(name) is None or not str(row[name]).strip() for name in names):
        return None
    return [_number(row.get(name), f"{kind}{name}", unit) for name in names]


def _number(value: object, name: str, unit: str) -> float:
    try:
        number = math.nan if isinstance(value, bool) else float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"{name}: expected a finite number of {unit}, got {one_line(repr(value), 60)}")
    return number
