"""What only OpenCV itself has: its other names, and the coefficients of its two detectors of people.

The coefficients of the detectors, trained by Dalal and by Daimler, are OpenCV's, and no part of this package.  They
come from an installed OpenCV that has them (4.x, and 5 with the contributed modules), or from a file.
"""

from __future__ import annotations

import importlib
import os
import sys
import threading
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import storage

FOLDER = "NABLAHOG_PEOPLE_DETECTORS"
_importing = threading.Lock()


def load_original(name: str) -> Any:
    """The object of that name in OpenCV, also where a program has put this package's module or object in its place.

    Raises:
        ImportError: OpenCV is not installed.
        AttributeError: it has no such name.
    """
    module = importlib.import_module("cv2")
    if module.__name__ == __package__ or _is_replacement(getattr(module, name, None)):
        module = _import_opencv_again()
    return getattr(module, name)


def _is_replacement(value: object) -> bool:
    return str(getattr(value, "__module__", None)).startswith(f"{__package__}.")


@cache
def _import_opencv_again() -> ModuleType:
    """OpenCV as it is installed; ``sys.modules["cv2"]`` stays what it is."""
    with _importing:
        replacement = sys.modules.pop("cv2")
        try:
            return importlib.import_module("cv2")
        finally:
            sys.modules["cv2"] = replacement


def people_detector(name: str, size: int) -> NDArray[np.float32]:
    """The coefficients of ``"Default"`` or ``"Daimler"``, of which there are ``size``."""
    function = f"get{name}PeopleDetector"
    path = Path(os.environ.get(FOLDER, "")) / f"{name.lower()}.yml"
    if os.environ.get(FOLDER) and path.is_file():
        coefficients = np.array(storage.floats(storage.read(path, ""), "SVMDetector"), np.float32)
        if len(coefficients) != size:
            raise ValueError(f"{path}: expected the {size} coefficients of {function}, got {len(coefficients)}")
        return coefficients
    try:
        theirs = load_original(f"HOGDescriptor_{function}")
    except (ImportError, AttributeError):
        raise RuntimeError(
            f"{function} needs OpenCV's own coefficients: install opencv-contrib-python (also of OpenCV 5) or "
            f"opencv-python<5, or set {FOLDER} to a folder with {path.name}, saved by a descriptor with this detector"
        ) from None
    return np.array(theirs(), np.float32).reshape(-1)
