"""``cv2.HOGDescriptor`` of OpenCV 4, which OpenCV 5 has moved out of its main package, and its score's derivative.

``import nablahog.compat.opencv as cv2`` is enough for a program that uses the class: all other names are those of the
installed OpenCV.
"""

from __future__ import annotations

from typing import Any

from .descriptor import HOGDescriptor, score
from .original import load_original

__all__ = [
    "HOGDescriptor",
    "HOGDescriptor_DEFAULT_NLEVELS",
    "HOGDescriptor_DESCR_FORMAT_COL_BY_COL",
    "HOGDescriptor_DESCR_FORMAT_ROW_BY_ROW",
    "HOGDescriptor_L2Hys",
    "HOGDescriptor_getDaimlerPeopleDetector",
    "HOGDescriptor_getDefaultPeopleDetector",
    "score",
]

HOGDescriptor_L2Hys = 0
HOGDescriptor_DEFAULT_NLEVELS = 64
HOGDescriptor_DESCR_FORMAT_COL_BY_COL, HOGDescriptor_DESCR_FORMAT_ROW_BY_ROW = 0, 1
HOGDescriptor_getDaimlerPeopleDetector = HOGDescriptor.getDaimlerPeopleDetector
HOGDescriptor_getDefaultPeopleDetector = HOGDescriptor.getDefaultPeopleDetector


def __dir__() -> list[str]:
    return __all__


def __getattr__(name: str) -> Any:
    if name.startswith("_"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        return load_original(name)
    except ImportError:
        raise AttributeError(f"{__name__} has no {name!r}, and OpenCV, which may have it, is not installed") from None
