"""Checks of the fields of a spec: each raises ValueError with one sentence.  Lists become tuples."""

from __future__ import annotations

import sys
from typing import Any, get_args


def check_choice(field: str, value: object, choices: Any) -> None:
    """``value`` is one of the literal type ``choices``."""
    allowed = get_args(choices)
    if value not in allowed:
        raise ValueError(f"{field} must be one of {', '.join(map(repr, allowed))}, got {value!r}")


def check_positive(field: str, value: object) -> None:
    """``value`` is a finite number above 0."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value <= sys.float_info.max:
        raise ValueError(f"{field} must be a finite number above 0, got {value!r}")


def check_pair(field: str, value: object) -> None:
    """``value`` is a pair of integers of at least 1."""
    if not (isinstance(value, tuple) and len(value) == 2 and all(type(c) is int and c >= 1 for c in value)):
        raise ValueError(f"{field} must be a pair (height, width) of integers of at least 1, got {value!r}")


def lists_to_tuples(part: object, *fields: str) -> None:
    """Makes tuples of those fields of a frozen dataclass that are lists, as those read from JSON are."""
    for field in fields:
        value = getattr(part, field)
        if isinstance(value, list):
            object.__setattr__(part, field, tuple(value))
