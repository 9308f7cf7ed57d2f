"""Photographs of objects whose viewpoints are annotated, from a folder and a CSV file."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from torch import Tensor
from torch.nn import functional

from ..hog.box import Box
from ..io.files import check_file, check_folder
from ..io.images import read_image
from ..runtime.text import one_line
from .viewpoints import MAX_BYTES

SIDES = ("x0", "y0", "x1", "y1")
ANGLES = ("azimuth", "elevation", "theta")
COLUMNS = ("image", *SIDES, *ANGLES)
LEAST = 8  # pixels of a side of a box
MOST = 256  # pixels of the longer side of a box: twice what a search looks at
BEYOND = 1.0  # pixels that a box may reach out of the image, by rounding


@dataclass(frozen=True, eq=False)
class AnnotatedPhotograph:
    """An object in a photograph.

    Attributes:
        name: of the image file in its folder, and the number of the object's row in the file, as "a.jpg#2".
        image: (C, H, W), C 1 or 3, float32 in 0…1: the photograph, shrunk so that the box's longer side has at most
            :data:`MOST` pixels.
        box: of the object in ``image``.
        azimuth, elevation, theta: degrees, as :data:`~nablahog.render.camera.PARAMETERS` says; azimuth in 0…360.
        model: the name of its model; None if none is annotated.
    """

    name: str
    image: Tensor
    box: Box
    azimuth: float
    elevation: float
    theta: float
    model: str | None


def read_annotations(
    path: str | os.PathLike[str],
    photographs: str | os.PathLike[str],
    models: Collection[str] | None = None,
    limit: int | None = None,
) -> list[AnnotatedPhotograph]:
    """Reads the objects in a CSV file: a line of column names, then one line for each object.

    Args:
        path: the file, in UTF-8, with the columns ``image``, a file's name in the folder; ``x0``, ``y0``, ``x1``,
            ``y1``, the box in pixels from the upper left corner, half open; ``azimuth``, ``elevation`` and ``theta``,
            degrees, as PASCAL3D+ has them; and perhaps ``model``, the name of the object's CAD model, which may be
            empty.  Others are ignored.
        photographs: the folder of the images.
        models: the names that a model may have; None for any.
        limit: only the first so many objects.

    Raises:
        FileNotFoundError, NotADirectoryError: there is no such file or folder.
        ValueError: a column is missing, there is no object, or a value is wrong; the message names the line and the
            column.

    >>> from pathlib import Path
    >>> from PIL import Image
    >>> Path("photographs").mkdir()
    >>> Image.new("L", (160, 120)).save("photographs/a.png")
    >>> lines = ["image,x0,y0,x1,y1,azimuth,elevation,theta", "a.png,10,0,110,120,317.5,20,-3.5"]
    >>> _ = Path("objects.csv").write_text("\\n".join(lines))
    >>> (one,) = nablahog.paper.annotations.read_annotations("objects.csv", "photographs")
    >>> one.name, one.image.shape, tuple(one.box), one.azimuth, one.model
    ('a.png#1', torch.Size([1, 120, 160]), (10.0, 0.0, 110.0, 120.0), 317.5, None)
    """
    path, folder = Path(path), Path(photographs)
    check_file(path, "a CSV file")
    check_folder(folder, "photographs")
    if path.stat().st_size > MAX_BYTES:
        raise ValueError(f"{path}: a list of objects of more than {MAX_BYTES:,} bytes is refused")
    objects: list[AnnotatedPhotograph] = []
    opened: dict[str, Tensor] = {}
    for line, row in _rows(path):
        if len(objects) == limit:
            break
        try:
            if row["model"] and models is not None and row["model"] not in models:
                some = ", ".join([*sorted(models)[:5], *(["…"] if len(models) > 5 else [])])
                raise ValueError(f"column model: expected one of {some}, got {one_line(repr(row['model']), 60)}")
            objects.append(_object(row, f"{row['image']}#{len(objects) + 1}", folder, opened))
        except ValueError as error:
            raise ValueError(f"{path}, line {line}, {error}") from None
    if not objects:
        raise ValueError(f"{path}: expected at least one object below the names of the columns, got none")
    return objects


def _rows(path: Path) -> Iterator[tuple[int, dict[str, str]]]:
    """The number of each line that holds an object, and its values by column."""
    with open(path, newline="", encoding="utf-8-sig") as file:
        reader = csv.reader(file, skipinitialspace=True)
        try:
            names = [name.strip() for name in next((row for row in reader if row), [])]
            missing = [name for name in COLUMNS if name not in names]
            if missing:
                raise ValueError(f"expected the columns {', '.join(COLUMNS)}, but {' and '.join(missing)} is missing")
            for row in reader:
                if row:
                    values = {name: value.strip() for name, value in zip(names, row, strict=False)}
                    yield reader.line_num, {name: values.get(name, "") for name in (*COLUMNS, "model")}
        except (ValueError, csv.Error) as error:  # UnicodeDecodeError is a ValueError
            raise ValueError(f"{path}, line {max(1, reader.line_num)}: {one_line(error)}") from None


def _object(row: Mapping[str, str], name: str, folder: Path, opened: dict[str, Tensor]) -> AnnotatedPhotograph:
    """One object; ``opened`` keeps the photograph of the row before, which often has several."""
    if not row["image"]:
        raise ValueError("column image: expected the name of a file, got ''")
    if row["image"] not in opened:
        opened.clear()
        try:
            opened[row["image"]] = read_image(folder / row["image"])
        except (OSError, ValueError) as error:
            raise ValueError(f"column image: {one_line(error)}") from None
    image = opened[row["image"]]
    box = _box(row, *image.shape[1:])
    azimuth, elevation, theta = (_number(row, column, "degrees") for column in ANGLES)
    if abs(elevation) > 90:
        raise ValueError(f"column elevation: expected -90…90 degrees, got {row['elevation']}")
    small, scale = _shrunk(image, MOST / max(box.width, box.height))
    inside = Box.of(side * scale[k % 2] for k, side in enumerate(box))
    return AnnotatedPhotograph(name, small, inside, azimuth % 360, elevation, theta, row["model"] or None)


def _box(row: Mapping[str, str], height: int, width: int) -> Box:
    box = Box.of(_number(row, column, "pixels") for column in SIDES)
    for low, high, length in (("x0", "x1", width), ("y0", "y1", height)):
        first, last = getattr(box, low), getattr(box, high)
        if last - first < LEAST:
            raise ValueError(
                f"column {high}: expected at least {LEAST} pixels more than {low}, {first:g}, got {last:g}"
            )
        for column, value in ((low, first), (high, last)):
            if not -BEYOND <= value <= length + BEYOND:
                raise ValueError(
                    f"column {column}: the box must lie in the image {row['image']} of {height}x{width} pixels "
                    f"(height x width), got {value:g}"
                )
    return box.intersect(Box(0.0, 0.0, float(width), float(height)))


def _number(row: Mapping[str, str], column: str, unit: str) -> float:
    try:
        value = float(row[column])
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"column {column}: expected a finite number of {unit}, got {one_line(repr(row[column]), 60)}")
    return value


def _shrunk(image: Tensor, scale: float) -> tuple[Tensor, tuple[float, float]]:
    """The image, antialiased and smaller by ``scale`` if that is below 1, and its true factors across and down."""
    if scale >= 1:
        return image, (1.0, 1.0)
    height, width = image.shape[1:]
    size = [max(1, round(side * scale)) for side in (height, width)]
    small = functional.interpolate(image[None], size, mode="bicubic", antialias=True, align_corners=False)[0]
    return small.clamp(0, 1), (size[1] / width, size[0] / height)
