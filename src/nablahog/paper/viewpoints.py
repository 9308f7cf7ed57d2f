"""Viewpoints: lists in CSV files, and a random distribution."""

from __future__ import annotations

import os

import numpy as np
from numpy.typing import NDArray

from .rows import read_csv

Floats = NDArray[np.float64]
_COLUMNS = ("azimuth", "elevation", "theta")


def read_viewpoints(path: str | os.PathLike[str]) -> Floats:
    """Reads the viewpoints in a CSV file.

    Args:
        path: the file, as :func:`.rows.read_csv` takes it, with the columns ``azimuth``, ``elevation`` and perhaps
            ``theta``, in degrees as :data:`~nablahog.render.camera.PARAMETERS` says.

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
    rows = read_csv(path, ("azimuth", "elevation"))
    viewpoints = np.zeros((len(rows), 3))
    for viewpoint, row in zip(viewpoints, rows, strict=True):
        for k, column in enumerate(_COLUMNS):
            if k < 2 or column in row.values:
                viewpoint[k] = row.number(column, "degrees")
        if abs(viewpoint[1]) > 90:
            raise row.error("elevation", f"expected -90…90 degrees, got {viewpoint[1]:g}")
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

    >>> nablahog.paper.viewpoints.sample_viewpoints(5, np.random.default_rng(0)).shape
    (5, 3)
    """
    frontal = generator.random(count) < 0.5
    azimuth = np.where(frontal, generator.normal(0, 45, count), generator.uniform(0, 360, count)) % 360
    return np.stack([azimuth, generator.triangular(0, 15, 45, count), generator.normal(0, 3, count)], axis=1)
