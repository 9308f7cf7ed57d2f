"""Viewpoints: lists in CSV files, and a random distribution."""

from __future__ import annotations

import csv
import math
import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..io.files import check_file
from ..runtime.text import one_line

Floats = NDArray[np.float64]

MAX_BYTES = 2**26  # of a list

_REQUIRED = ("azimuth", "elevation")
_COLUMNS = (*_REQUIRED, "theta")


def read_viewpoints(path: str | os.PathLike[str]) -> Floats:
    """Reads the viewpoints in a CSV file: a line of column names, then one line for each viewpoint.

    Args:
        path: the file, in UTF-8.  Of its columns, ``azimuth``, ``elevation`` and, if there is one, ``theta`` are read,
            in degrees as :data:`~nablahog.render.camera.PARAMETERS` says.

    Returns:
        (N, 3), float64: azimuth in 0…360 (without 360), elevation in -90…90, theta (0 without such a column).

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is no such file, has no viewpoints, or a value is no finite number or out of its range; the
            message names the line.

    >>> from pathlib import Path
    >>> _ = Path("viewpoints.csv").write_text("azimuth,elevation\\n30,10\\n350,15.5\\n")
    >>> nablahog.paper.viewpoints.read_viewpoints("viewpoints.csv")
    array([[ 30. ,  10. ,   0. ],
           [350. ,  15.5,   0. ]])
    """
    path = Path(path)
    check_file(path, "a CSV file")
    if path.stat().st_size > MAX_BYTES:
        raise ValueError(f"{path}: a list of viewpoints of more than {MAX_BYTES:,} bytes is refused")
    with open(path, newline="", encoding="utf-8-sig") as file:
        reader = csv.reader(file, skipinitialspace=True)
        try:
            names = [name.strip() for name in next((row for row in reader if row), [])]
            missing = [name for name in _REQUIRED if name not in names]
            if missing:
                raise ValueError(f"expected the columns azimuth and elevation, but {' and '.join(missing)} is missing")
            columns = [(names.index(name), name) for name in _COLUMNS if name in names]
            rows = [
                [_number(row[at] if at < len(row) else None, name) for at, name in columns] for row in reader if row
            ]
        except (ValueError, csv.Error) as error:  # UnicodeDecodeError is a ValueError
            raise ValueError(f"{path}, line {max(1, reader.line_num)}: {one_line(error)}") from None
    if not rows:
        raise ValueError(f"{path}: expected at least one viewpoint below the names of the columns, got none")
    viewpoints = np.zeros((len(rows), 3))
    viewpoints[:, : len(rows[0])] = rows
    viewpoints[:, 0] %= 360
    viewpoints[viewpoints[:, 0] == 360, 0] = 0  # the remainder of a number just below 0
    return viewpoints


def _number(text: str | None, name: str) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"expected a finite number of degrees as {name}, got {one_line(repr(text), 60)}")
    if name == "elevation" and abs(value) > 90:
        raise ValueError(f"elevation must lie in -90…90 degrees, got {one_line(text, 60)}")
    return value


def sample_viewpoints(count: int, generator: np.random.Generator) -> Floats:
    """Random viewpoints, as people photograph chairs: standing, from all around, most often from the front.

    Azimuth: for half of them normal about the front, σ = 45°, for the others uniform.  Elevation: triangular from 0° to
    45° with its peak at 15°.  Theta: normal, σ = 3°.

    Args:
        count: number of viewpoints.
        generator: of random numbers.

    Returns:
        (``count``, 3), float64, as :func:`read_viewpoints`.

    >>> nablahog.paper.viewpoints.sample_viewpoints(5, np.random.default_rng(0)).shape
    (5, 3)
    """
    frontal = generator.random(count) < 0.5
    azimuth = np.where(frontal, generator.normal(0, 45, count), generator.uniform(0, 360, count)) % 360
    return np.stack([azimuth, generator.triangular(0, 15, 45, count), generator.normal(0, 3, count)], axis=1)
