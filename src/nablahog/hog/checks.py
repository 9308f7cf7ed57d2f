"""Checks of the fields of a spec and its parts, with errors of one sentence, and the register of kinds of parts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from functools import partial
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from ..runtime.text import one_line

Part = TypeVar("Part")

LEAST_CONSTANT, MOST_CONSTANT = 1e-12, 1e12  # bounds of a spec's constants: their cubes are finite in float32
LONGEST_SIDE = 1_000_000  # in pixels or cells
_CHECKS: dict[type, dict[str, tuple[Any, Callable[[str, object], None] | None]]] = {}
"""For each class, the type and check of each field; read once, since torch.compile cannot trace the reading."""


def check_fields(part: Any, *unchecked: str) -> None:
    """Checks the fields of a frozen dataclass by their types; lists become tuples, and integers floats.

    A float lies in 1e-12 … 1e12, a pair of integers in 1 … 1,000,000.  Fields of types other than these, literals
    and truth values are left to the class, and so are the ``unchecked``.
    """
    if type(part) not in _CHECKS:
        hints = get_type_hints(type(part))  # of class variables, too, which stay the class's
        kinds = {field.name: hints[field.name] for field in fields(part)}
        _CHECKS[type(part)] = {field: (get_origin(kind) or kind, _find_check(kind)) for field, kind in kinds.items()}
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


def _find_check(kind: Any) -> Callable[[str, object], None] | None:
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


def register(part: type[Part], kinds: dict[str, type[Part]]) -> None:
    """Adds the class of a part to those of its sort, if it defines its ``kind``, and not one that inherits it.

    Raises:
        TypeError: another part has this kind.
    """
    if "kind" not in vars(part):
        return
    kind: str = vars(part)["kind"]
    known = kinds.setdefault(kind, part)
    # a class may come again: from a module that is reloaded, or a dataclass with slots
    if (known.__module__, known.__qualname__) != (part.__module__, part.__qualname__):
        raise TypeError(f"the kind {kind!r} of {part.__qualname__} is that of {known.__qualname__}: choose another")
    kinds[kind] = part
