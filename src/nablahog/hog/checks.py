"""Checks of the fields of a spec and its parts: each raises ValueError with one sentence."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Literal, get_args, get_origin, get_type_hints

from ..runtime.text import one_line

LEAST_CONSTANT, MOST_CONSTANT = 1e-12, 1e12  # bounds of a spec's constants: their cubes are finite in float32
LONGEST_SIDE = 1_000_000  # in pixels or cells
_CHECKS: dict[type, dict[str, tuple[Any, Callable[[str, object], None] | None]]] = {}
"""For each class, the type and check of each field; read once, since torch.compile cannot trace the reading."""


def check_fields(part: object, *unchecked: str) -> None:
    """Checks the fields of a frozen dataclass by their types; lists become tuples, and integers floats.

    A float lies in 1e-12 … 1e12, a pair of integers in 1 … 1,000,000.  Fields of types other than these, literals
    and truth values are left to the class, and so are the ``unchecked``.
    """
    if type(part) not in _CHECKS:
        hints = get_type_hints(type(part)).items()
        _CHECKS[type(part)] = {field: (get_origin(hint) or hint, _check_of(hint)) for field, hint in hints}
    for field, (kind, check) in _CHECKS[type(part)].items():
        value = _plain(getattr(part, field))
        object.__setattr__(part, field, value)
        if check and field not in unchecked:
            check(field, value)
        if kind is float and type(value) is int:
            object.__setattr__(part, field, float(value))


def _plain(value: Any) -> Any:
    """Numbers of NumPy and PyTorch as those of Python; lists and arrays as tuples."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    return tuple(map(_plain, value)) if isinstance(value, tuple | list) else value


def _check_of(kind: Any) -> Callable[[str, object], None] | None:
    if get_origin(kind) is Literal:
        return partial(check_choice, choices=kind)
    return {bool: check_truth, float: check_positive, tuple[int, int]: check_pair}.get(kind)


def check_truth(field: str, value: object) -> None:
    """``value`` is True or False."""
    if not isinstance(value, bool):
        raise ValueError(f"{field} must be True or False, got {shortened(value)}")


def check_choice(field: str, value: object, choices: Any) -> None:
    """``value`` is one of the literal type ``choices``."""
    allowed = get_args(choices)
    if value not in allowed:
        raise ValueError(f"{field} must be one of {', '.join(map(repr, allowed))}, got {shortened(value)}")


def check_positive(field: str, value: object) -> None:
    """``value`` is a number in :data:`LEAST_CONSTANT` … :data:`MOST_CONSTANT`."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not LEAST_CONSTANT <= value <= MOST_CONSTANT:
        raise ValueError(f"{field} must be a number in {LEAST_CONSTANT:g} … {MOST_CONSTANT:g}, got {shortened(value)}")


def check_pair(field: str, value: object) -> None:
    """``value`` is a pair of integers in 1 … :data:`LONGEST_SIDE`."""
    if not (isinstance(value, tuple) and len(value) == 2 and all(map(_is_side, value))):
        raise ValueError(
            f"{field} must be a pair (height, width) of integers in 1 … {LONGEST_SIDE:,}, got {shortened(value)}"
        )


def _is_side(value: object) -> bool:
    return type(value) is int and 1 <= value <= LONGEST_SIDE


def pair(size: int | tuple[int, int]) -> tuple[int, int]:
    """One number for both sides, or (height, width)."""
    sides = _plain(size)
    return sides if isinstance(sides, tuple) else (sides, sides)


def shortened(value: object) -> str:
    """A wrong value in at most 60 characters, for an error message."""
    return one_line(repr(value), 60)
