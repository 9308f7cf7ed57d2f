"""OpenCV's two detectors of people.

Their coefficients are OpenCV's, trained by Dalal and by Daimler, and are no part of this package.  They come from an
installed OpenCV that has them (4.x, and 5 with the contributed modules), or from a file.
"""

from __future__ import annotations

import importlib
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import storage

FOLDER = "NABLAHOG_PEOPLE_DETECTORS"


def people_detector(name: str, size: int) -> NDArray[np.float32]:
    """The coefficients of ``"Default"`` or ``"Daimler"``, of which there are ``size``.

    Raises:
        RuntimeError: there is no OpenCV with them, and no file.
        ValueError: the file holds another detector.
    """
    function = f"get{name}PeopleDetector"
    path = Path(os.environ.get(FOLDER, "")) / f"{name.lower()}.yml"
    if os.environ.get(FOLDER) and path.is_file():
        coefficients = np.array(storage.floats(storage.read(path, ""), "SVMDetector"), np.float32)
        if len(coefficients) != size:
            raise ValueError(f"{path}: expected the {size} coefficients of {function}, got {len(coefficients)}")
        return coefficients
    theirs = getattr(_opencv(), "HOGDescriptor", None)
    if theirs is None:
        raise RuntimeError(
            f"{function} needs OpenCV's own coefficients: install opencv-python<5, or name by {FOLDER} a folder with "
            f"{path.name}, which a descriptor with this detector has saved elsewhere"
        )
    return np.array(getattr(theirs, function)(), np.float32).reshape(-1)


def _opencv() -> Any:
    try:
        return importlib.import_module("cv2")
    except ImportError:
        return None
