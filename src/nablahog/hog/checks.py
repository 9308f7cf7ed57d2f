"""Checks of the fields of a spec and its parts, with errors of one sentence, and the register of kinds of parts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from functools import partial
from typing import Any, Literal, TypeVar, get_origin, get_type_hints

from ..inputs.numbers import LEAST_CONSTANT, MOST_CONSTANT, as_plain, as_size, as_truth, check_choice, shortened

Part = TypeVar("Part")

_CHECKS: dict[type, dict[str, tuple[Any, Callable[[str, object], Any] | None]]] = {}
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
        value = as_plain(getattr(part, field))
        object.__setattr__(part, field, value)
        if check and field not in unchecked:
            check(field, value)
        if kind is float and type(value) is int:
            object.__setattr__(part, field, float(value))


def _find_check(kind: Any) -> Callable[[str, object], Any] | None:
    if get_origin(kind) is Literal:
        return partial(check_choice, choices=kind)
    checks: dict[Any, Callable[[str, object], Any]] = {bool: as_truth, float: check_positive, tuple[int, int]: as_size}
    return checks.get(kind)


def check_positive(field: str, value: object) -> None:
    """``value`` is a number in :data:`LEAST_CONSTANT` … :data:`MOST_CONSTANT`."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not LEAST_CONSTANT <= value <= MOST_CONSTANT:
        raise ValueError(f"{field} must be a number in {LEAST_CONSTANT:g} … {MOST_CONSTANT:g}, got {shortened(value)}")


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
