"""Numbers, sizes, truth values and choices of Python, NumPy and PyTorch, as Python's own.

Every function takes the name of an argument and its value, and returns the value or raises ValueError with one sentence
that says what was expected, what came and, where it helps, what to write.
"""

from __future__ import annotations

import json
import math
import numbers
from collections.abc import Callable
from contextlib import suppress
from dataclasses import fields
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from ..runtime.text import did_you_mean, one_line

Kind = TypeVar("Kind")

LEAST_CONSTANT, MOST_CONSTANT = 1e-12, 1e12  # bounds of a spec's constants: their cubes are finite in float32
LONGEST_SIDE = 1_000_000  # in pixels or cells


def as_plain(value: Any) -> Any:
    """Numbers of NumPy, PyTorch and enumerations as those of Python; lists, arrays and tensors as tuples; all else as
    it is."""
    if hasattr(value, "tolist"):
        with suppress(NotImplementedError, RuntimeError):  # tensors without numbers to read, on the device meta
            value = value.tolist()
    if isinstance(value, tuple | list):
        return tuple(map(as_plain, value))
    for kind in (int, float):  # of their subclasses
        if isinstance(value, kind) and not isinstance(value, bool):
            return kind(value)
    return value


def parse_numbers(text: str) -> Any:
    """The number in a text, or several between commas, also in the brackets of JSON; other text as it is."""
    try:
        numbers = [*map(_parse_number, text.split(","))] if "[" not in text else json.loads(text)
    except (ValueError, RecursionError):
        return text
    return as_plain(numbers if len(numbers) > 1 else numbers[0])


def _parse_number(text: str) -> int | float:
    try:
        return int(text)
    except ValueError:
        return float(text)


def as_integer(name: str, value: object, least: int = 1, most: int | None = None) -> int:
    """An integer of at least ``least`` and, unless that is None, at most ``most``; not a float, not a truth value."""
    plain = as_plain(value)
    if type(plain) is not int or plain < least or (most is not None and plain > most):
        allowed = f"of at least {least:,}" if most is None else f"in {least:,} … {most:,}"
        write = f": write {int(plain)}" if isinstance(plain, float) and plain.is_integer() else ""
        raise ValueError(f"{name} must be an integer {allowed}, got {shortened(value)}{write}")
    return plain


def as_number(
    name: str,
    value: object,
    least: float = -math.inf,
    most: float = math.inf,
    *,
    above: float = -math.inf,
    below: float = math.inf,
) -> float:
    """A finite number in ``least`` … ``most``, above ``above`` and below ``below``; not a truth value."""
    plain = as_plain(value)
    if not is_finite(plain) or not (least <= plain <= most and above < plain < below):
        bounds = (("of at least", least), ("above", above), ("at most", most), ("below", below))
        allowed = [f" {words} {bound:g}" for words, bound in bounds if math.isfinite(bound)]
        if len(allowed) == 2 and math.isfinite(least) and math.isfinite(most):
            allowed = [f" in {least:g} … {most:g}"]
        raise ValueError(f"{name} must be a finite number{' and'.join(allowed)}, got {shortened(value)}")
    return float(plain)


def as_seed(seed: object) -> int:
    """A seed of PyTorch's generators."""
    return as_integer("seed", seed, -(2**63), 2**64 - 1)


def is_finite(value: object) -> bool:
    """True for a real number, not a truth value, that is neither NaN nor infinite as a float."""
    try:
        return isinstance(value, numbers.Real) and not isinstance(value, bool) and math.isfinite(value)
    except OverflowError:  # an integer beyond all floats
        return False


def as_numbers(name: str, value: object, of_what: str) -> tuple[float, ...]:
    """As many finite numbers as ``of_what`` names, separated by commas: "x0, y0, x1, y1"."""
    plain = as_plain(value)
    count = len(of_what.split(","))
    if not isinstance(plain, tuple) or len(plain) != count or not all(map(is_finite, plain)):
        raise ValueError(f"{name} must be {count} finite numbers {of_what}, got {shortened(value)}")
    return tuple(map(float, plain))


def as_integers(name: str, value: object, least: int = 1) -> tuple[int, ...]:
    """One or more integers of at least ``least``, in a list, a tuple, an array or a tensor."""
    plain = as_plain(value)
    if not isinstance(plain, tuple) or not plain:
        raise ValueError(f"{name} must be integers of at least {least}, such as (4, 1), got {shortened(value)}")
    return tuple(as_integer(f"each of {name}", integer, least) for integer in plain)


def as_size(name: str, value: object, axes: str = "height, width") -> tuple[int, int]:
    """Height and width, or both sides as ``axes`` orders them, integers in 1 … :data:`LONGEST_SIDE`."""
    plain = as_plain(value)
    if not isinstance(plain, tuple) or len(plain) != 2 or not all(map(_is_side, plain)):
        advice = _advise_on_size(plain) if axes == "height, width" else ""  # which are those of arrays
        raise ValueError(
            f"{name} must be a pair ({axes}) of integers in 1 … {LONGEST_SIDE:,}, got {shortened(value)}{advice}"
        )
    return plain


def as_square_or_size(name: str, value: object, axes: str = "height, width") -> tuple[int, int]:
    """One number for both sides, or both as ``axes`` orders them, integers in 1 … :data:`LONGEST_SIDE`."""
    plain = as_plain(value)
    return as_size(name, plain if isinstance(plain, tuple) else (plain, plain), axes)


def _is_side(value: object) -> bool:
    return type(value) is int and 1 <= value <= LONGEST_SIDE


def _advise_on_size(plain: object) -> str:
    if _is_side(plain):
        return f": write ({plain}, {plain}) for a square"
    if isinstance(plain, tuple) and len(plain) in (3, 4) and all(map(_is_side, plain)):
        return ": write image.shape[:2] of an array (H, W, C), or images.shape[-2:] of a tensor (B, C, H, W)"
    return ""


def as_truth(name: str, value: object) -> bool:
    """True or False."""
    plain = as_plain(value)
    if not isinstance(plain, bool):
        raise ValueError(f"{name} must be True or False, got {shortened(value)}")
    return plain


def check_type(name: str, value: object, kind: type[Kind], write: str = "") -> Kind:
    """``value``; TypeError unless it is of this class, with what to ``write``."""
    if not isinstance(value, kind):
        advice = f": write {write}" if write else ""
        raise TypeError(f"{name} must be a {kind.__name__}, got {shortened(value)}{advice}")
    return value


def check_callable(name: str, value: object, arguments: str) -> None:
    """Raises TypeError unless ``value`` can be called, with these arguments."""
    if not callable(value):
        raise TypeError(f"{name} must be a function of ({arguments}), got {shortened(value)}: leave it out for none")


def check_choice(name: str, value: object, choices: Any) -> None:
    """``value`` is one of the literal type, or of the names, ``choices``."""
    allowed = get_args(choices) or tuple(choices)
    if not isinstance(value, str) or value not in allowed:
        meant = did_you_mean(value, allowed) if isinstance(value, str) else ""
        raise ValueError(f"{name} must be one of {', '.join(map(repr, allowed))}, got {shortened(value)}{meant}")


def convert_fields(instance: Any, *others: str) -> None:
    """Converts the fields of a frozen dataclass by their types; lists become tuples.

    A float lies in :data:`LEAST_CONSTANT` … :data:`MOST_CONSTANT`.  Fields of types other than floats, truth values,
    pairs of integers and literals are left to the class, and so are the ``others``.
    """
    if type(instance) not in _FIELD_TYPES:
        types = get_type_hints(type(instance))  # of class variables, too
        _FIELD_TYPES[type(instance)] = {field.name: types[field.name] for field in fields(instance)}
    for name, kind in _FIELD_TYPES[type(instance)].items():
        value = as_plain(getattr(instance, name))
        if name not in others and get_origin(kind) is Literal:
            check_choice(name, value, kind)
        elif name not in others and kind in _CONVERSIONS:
            value = _CONVERSIONS[kind](name, value)
        object.__setattr__(instance, name, value)


def _as_constant(name: str, value: object) -> float:
    return as_number(name, value, LEAST_CONSTANT, MOST_CONSTANT)


_CONVERSIONS: dict[Any, Callable[[str, object], Any]] = {bool: as_truth, float: _as_constant, tuple[int, int]: as_size}
_FIELD_TYPES: dict[type, dict[str, Any]] = {}
"""Of each class, the types of its fields; read once, since torch.compile cannot trace the reading."""


def shortened(value: object) -> str:
    """A wrong value in at most 60 characters, for an error message."""
    return one_line(repr(value), 60)
