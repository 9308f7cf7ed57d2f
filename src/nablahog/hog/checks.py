"""Checks of the fields of a spec and its parts: each raises ValueError with one sentence."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from typing import Any, Literal, get_args, get_origin, get_type_hints

_CHECKS: dict[type, dict[str, tuple[Any, Callable[[str, object], None] | None]]] = {}
"""Of each class by field: its kind and its check, read once, since torch.compile cannot trace how types are read."""


def check_fields(part: object, *others: str) -> None:
    """The fields of a frozen dataclass are what their types say; tuples may be given as lists, as JSON has them.

    A float is finite and above 0, a pair of integers is one of at least 1.  Fields of other types than these, literals
    and truth values are left to the class, and so are the ``others``.
    """
    if type(part) not in _CHECKS:
        hints = get_type_hints(type(part)).items()
        _CHECKS[type(part)] = {field: (get_origin(hint), _check_of(hint)) for field, hint in hints}
    for field, (kind, check) in _CHECKS[type(part)].items():
        value = getattr(part, field)
        if kind is tuple and isinstance(value, list):
            value = tuple(value)
            object.__setattr__(part, field, value)
        if check and field not in others:
            check(field, value)


def _check_of(kind: Any) -> Callable[[str, object], None] | None:
    if get_origin(kind) is Literal:
        return partial(check_choice, choices=kind)
    return {bool: check_truth, float: check_positive, tuple[int, int]: check_pair}.get(kind)


def check_truth(field: str, value: object) -> None:
    """``value`` is True or False."""
    if not isinstance(value, bool):
        raise ValueError(f"{field} must be True or False, got {value!r}")


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
