"""Kinds of values: how the command writes and reads them, and their ranges."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, eq=False)
class Kind:
    """A kind of values.

    Attributes:
        name: in a line of usage.
        read: the value of a text; ValueError says what was expected.
        write: the text of a value.
        choices: all values, if they are few names.
        least, most: the range of numbers.
        above: whether the least number is none of the range.
        collect: what the values of a repeated option are together; None for an option that is not repeated.
    """

    name: str
    read: Callable[[str], Any] = str
    write: Callable[[Any], str] = str
    choices: Collection[str] = ()
    least: float | None = None
    most: float | None = None
    above: bool = False
    collect: Callable[[list[Any]], Any] | None = None


def choice(names: Collection[str]) -> Kind:
    """One of the names."""
    return Kind("NAME", choices=names)


def integer(least: int = 1, most: int = 10**18 - 1) -> Kind:
    """An integer in ``least`` … ``most``."""

    def read(text: str) -> int:
        if not re.fullmatch(r"\d{1,18}", text) or int(text) < least:
            raise ValueError(f"expected an integer of at least {least}, got {text!r}")
        if int(text) > most:
            raise ValueError(f"expected an integer of at most {most}, got {text!r}")
        return int(text)

    return Kind("N", read, least=least, most=most)


def number(name: str, expected: str, least: float, most: float | None = None, *, above: bool = False) -> Kind:
    """A number in a range, which ``expected`` says; with ``above``, more than ``least``."""

    def read(text: str) -> float:
        (value,) = numbers(name).read(text)
        if value < least or (above and value == least) or (most is not None and value > most):
            raise ValueError(f"expected {expected}, got {text!r}")
        return float(value)

    return Kind(name, read, "{:g}".format, least=least, most=most, above=above)


def numbers(names: str, check: Callable[..., None] = lambda *values: None) -> Kind:
    """Finite numbers separated by commas, one for each of ``names``, which are, too; ``check`` raises ValueError."""

    def read(text: str) -> tuple[float, ...]:
        try:
            values = tuple(float(part) for part in text.split(","))
        except ValueError:
            values = ()
        if len(values) != len(names.split(",")) or not all(map(math.isfinite, values)):
            what = f"{names.count(',') + 1} numbers {names}" if "," in names else "a number"
            raise ValueError(f"expected {what}, got {text!r}")
        check(*values)
        return values

    return Kind(names, read, lambda values: ",".join(f"{value:g}" for value in values))


def path(name: str) -> Kind:
    """The name of a file or folder, which is not empty."""
    return Kind(name, read_path)


def read_path(text: str) -> str:
    """The name of a file or folder, which is not empty."""
    if not text:
        raise ValueError("expected the name of a file or folder, got ''")
    return text


def _read_size(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"([1-9]\d{0,5})[x×]([1-9]\d{0,5})", text)
    if match is None:
        raise ValueError(f"expected pixels as HEIGHTxWIDTH, each at least 1, got {text!r}")
    return int(match[1]), int(match[2])


def _read_setting(text: str) -> tuple[str, str]:
    key, equals, value = text.partition("=")
    if not key or not equals:
        raise ValueError(f"expected KEY=VALUE, a parameter of the preset, got {text!r}")
    return key, value


FLAG = Kind("")  # true if it is there
TEXT = Kind("NAME")
SIZE = Kind("HxW", _read_size, lambda sides: "x".join(map(str, sides)))
SETTING = Kind("KEY=VALUE", _read_setting, "=".join, collect=dict)
