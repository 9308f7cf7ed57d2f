"""Warnings of the line that called the package."""

from __future__ import annotations

import sys
import warnings

_BETWEEN = ("nablahog", "torch", "sklearn", "joblib", "contextlib", "functools")
"""Packages whose lines are skipped: modules, decorators and pipelines that call this package for others."""


def warn_caller(advice: str, category: type[Warning] = UserWarning) -> None:
    """Warns of the innermost line outside this package, and outside of what calls it for others."""
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and frame.f_globals.get("__name__", "").partition(".")[0] in _BETWEEN:
        frame, level = frame.f_back, level + 1
    warnings.warn(advice, category, stacklevel=level)
