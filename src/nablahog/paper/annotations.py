"""Objects in photographs whose viewpoints are annotated, and viewpoints alone: lists in CSV files, and random ones."""

from __future__ import annotations

import os
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from ..inputs.boxes import Box
from ..io.images import read_image
from ..io.lists import ANGLES, BOUNDS, SIDES, AnnotatedObject, ListEntry, read_csv, read_object
from ..render.models import Model
from ..runtime.errors import explain
from ..runtime.text import one_line

Floats = NDArray[np.float64]
MIN_SIDE = 8  # pixels of a side of a box
MAX_SIDE = 256  # pixels of the longer side of a box: twice what a search looks at
BEYOND = 1.0  # pixels that a box may reach out of the image, by rounding


@dataclass(frozen=True, eq=False)
class Example:
    """An example of Table 2: an object in an image, with its true viewpoint and what a search for its pose is given.

    Attributes:
        name: unique.
        image: (C, H, W), C 1 or 3, float32 in 0…1.
        box: of the object in the image; None if a search is given none.
        azimuth, elevation, theta: the true ones in degrees, as :data:`~nablahog.render.camera.PARAMETERS` says.
        model: the name of its own CAD model, or of the one most like it; None if none is annotated.
        initial: azimuth and elevation that a search may begin at, degrees; None if it is given none.
        candidates: the models to search among.
    """

    name: str
    image: Tensor
    box: Box | None
    azimuth: float
    elevation: float
    theta: float
    model: str | None
    initial: tuple[float, float] | None = None
    candidates: tuple[Model, ...] = ()


def read_annotations(
    path: str | os.PathLike[str], models: Collection[str] | None = None, limit: int | None = None
) -> list[Example]:
    """Reads the objects in a CSV file.

    Args:
        path: the file, as :func:`.lists.read_csv` takes it, with the columns ``image``, a file relative to the folder
            of this one; ``x0``, ``y0``, ``x1``, ``y1``, the box in pixels from the upper left corner, half open;
            ``azimuth``, ``elevation`` and ``theta``, degrees, as PASCAL3D+ has them; and perhaps ``model``, the name of
            the object's CAD model, which may be empty.
        models: the names that a model may have; None for any.
        limit: only the first so many objects.

    Returns:
        Objects without an initial pose or candidates.  Their names are that of the image and the number of the row, as
        "a.jpg#2".  Images are shrunk so that the longer side of the box has at most :data:`MAX_SIDE` pixels.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: a column is missing, there is no object, or a value is wrong; the message names the line and the
            column.

    >>> from pathlib import Path
    >>> from PIL import Image
    >>> Image.new("L", (160, 120)).save("a.png")
    >>> lines = ["image,x0,y0,x1,y1,azimuth,elevation,theta", "a.png,10,0,110,120,317.5,20,-3.5"]
    >>> _ = Path("objects.csv").write_text("\\n".join(lines))
    >>> (one,) = nablahog.paper.annotations.read_annotations("objects.csv")
    >>> one.name, one.image.shape, tuple(one.box), one.azimuth, one.model
    ('a.png#1', torch.Size([1, 120, 160]), (10.0, 0.0, 110.0, 120.0), 317.5, None)
    """
    rows = read_csv(path, ("image", *SIDES, *ANGLES))[:limit]
    examples: list[Example] = []
    opened: dict[str, Tensor] = {}
    for number, row in enumerate(rows, 1):
        annotated = read_object(number, row, row.text("image"))
        name, model = annotated.image, annotated.model
        if model is not None and models is not None and model not in models:
            some = ", ".join([*sorted(models)[:5], *(["…"] if len(models) > 5 else [])])
            raise row.error("model", f"expected one of {some}, got {one_line(repr(model), 60)}")
        if name not in opened:  # the row before is often of the same photograph
            opened = {name: _image(row, Path(path).parent)}
        examples.append(_example(row, annotated, opened[name]))
    return examples


def _image(row: ListEntry, folder: Path) -> Tensor:
    if not row.text("image"):
        raise row.error("image", "expected the name of a file, got ''")
    try:
        return read_image(folder / row.text("image"))
    except (OSError, ValueError) as error:
        raise row.error("image", one_line(explain(error))) from None


def _example(row: ListEntry, annotated: AnnotatedObject, image: Tensor) -> Example:
    if annotated.view is None or annotated.theta is None:
        missing = "azimuth" if annotated.view is None else "theta"
        raise row.error(missing, f"expected numbers in the columns {', '.join(ANGLES)}, got none")
    box, (azimuth, elevation) = _box(row, annotated.box, *image.shape[1:]), annotated.view
    small, scale = _shrunk(image, MAX_SIDE / max(box.width, box.height))
    inside = Box(*(side * scale[k % 2] for k, side in enumerate(box)))
    name = f"{annotated.image}#{annotated.id}"
    return Example(name, small, inside, azimuth % 360, elevation, annotated.theta, annotated.model)


def _box(row: ListEntry, box: Box | None, height: int, width: int) -> Box:
    """The box, cut to the image, which it may leave by a rounding."""
    if box is None:
        raise row.error("x0", "expected a box, got none")
    if min(box.width, box.height) < MIN_SIDE:
        raise row.error("x1", f"expected a box of at least {MIN_SIDE}x{MIN_SIDE} pixels, got {tuple(box)}")
    if min(box.x0, box.y0) < -BEYOND or box.x1 > width + BEYOND or box.y1 > height + BEYOND:
        raise row.error(
            "x0", f"the box must lie in the image of {height}x{width} pixels (height x width), got {tuple(box)}"
        )
    return box.intersect(Box(0.0, 0.0, float(width), float(height)))


def _shrunk(image: Tensor, scale: float) -> tuple[Tensor, tuple[float, float]]:
    """The image, antialiased and smaller by ``scale`` if that is below 1, and its true factors across and down."""
    if scale >= 1:
        return image, (1.0, 1.0)
    height, width = image.shape[1:]
    size = [max(1, round(side * scale)) for side in (height, width)]
    small = functional.interpolate(image[None], size, mode="bicubic", antialias=True, align_corners=False)[0]
    return small.clamp(0, 1), (size[1] / width, size[0] / height)


def read_viewpoints(path: str | os.PathLike[str]) -> Floats:
    """Reads the viewpoints in a CSV file.

    Args:
        path: the file, as :func:`.lists.read_csv` takes it, with the columns ``azimuth``, ``elevation`` and perhaps
            ``theta``, in degrees as :data:`~nablahog.render.camera.PARAMETERS` says.

    Returns:
        (N, 3), float64: azimuth in 0…360 (without 360), elevation in -90…90, theta (0 without such a column).

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is no such file, has no viewpoints, or a value is not a finite number or out of its range; the
            message names the line.

    >>> from pathlib import Path
    >>> _ = Path("viewpoints.csv").write_text("azimuth,elevation\\n30,10\\n350,15.5\\n")
    >>> nablahog.paper.annotations.read_viewpoints("viewpoints.csv")
    array([[ 30. ,  10. ,   0. ],
           [350. ,  15.5,   0. ]])
    """
    rows = read_csv(path, ("azimuth", "elevation"))
    viewpoints = np.zeros((len(rows), 3))
    for viewpoint, row in zip(viewpoints, rows, strict=True):
        for k, column in enumerate(ANGLES):
            if k < 2 or column in row.values:
                viewpoint[k] = row.number(column, **BOUNDS.get(column, {}))
    viewpoints[:, 0] %= 360
    viewpoints[viewpoints[:, 0] == 360, 0] = 0  # the remainder of a number just below 0
    return viewpoints


def sample_viewpoints(count: int, generator: np.random.Generator) -> Floats:
    """Random viewpoints, as people photograph chairs: standing, from all around, most often from the front.

    Azimuth: for half of them normal about the front, σ = 45°, for the others uniform.  Elevation: triangular from 0° to
    45° with its peak at 15°.  Theta: normal, σ = 3°.

    Args:
        count: number of viewpoints.
        generator: of random numbers.

    Returns:
        (``count``, 3), float64, as :func:`read_viewpoints`.

    >>> nablahog.paper.annotations.sample_viewpoints(5, np.random.default_rng(0)).shape
    (5, 3)
    """
    frontal = generator.random(count) < 0.5
    azimuth = np.where(frontal, generator.normal(0, 45, count), generator.uniform(0, 360, count)) % 360
    return np.stack([azimuth, generator.triangular(0, 15, 45, count), generator.normal(0, 3, count)], axis=1)
