"""The fields of requests: each has a default, a kind of values, and a sentence of help."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import KW_ONLY, dataclass
from functools import cache
from typing import Any, Literal, get_args, get_origin, get_type_hints


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
        if not text.isdecimal() or (len(text) < 19 and int(text) < least):
            raise ValueError(f"expected an integer of at least {least}, got {text!r}")
        if len(text) > 18 or int(text) > most:
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


@dataclass(frozen=True, eq=False)
class Option:
    """A field of a request.

    Attributes:
        default: its value if nothing is asked for, or a type that makes it.
        help: a sentence for `--help`.
        kind: how its values are written, and their range; a ``bool`` or a ``Literal`` needs none.
        flag: the option of the command, by default the field's name.
        keyword: whether the package's function has a keyword of its name.
        on_page: whether the page has it, or those of its values that the page has.
        stands_for: what the default None means.
        name, hint: of the field.
    """

    default: Any
    help: str
    kind: Kind = FLAG
    _: KW_ONLY
    flag: str = ""
    keyword: bool = False
    on_page: bool | tuple[str, ...] = False
    stands_for: Any = None
    name: str = ""
    hint: Any = None

    @property
    def page_choices(self) -> tuple[str, ...]:
        """Its values on the page, if they are few names."""
        return self.on_page if isinstance(self.on_page, tuple) else tuple(self.kind.choices)


def option(default: Any, *about: Any, **more: Any) -> Any:
    """A field of a request, with the attributes of :class:`Option`."""
    metadata = {"option": Option(default, *about, **more)}
    if isinstance(default, type):
        return dataclasses.field(default_factory=default, metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


@cache
def list_options(request: type) -> tuple[Option, ...]:
    """The options of a request, in the order of its fields; a field that is no :func:`option` is none."""
    hints = get_type_hints(request)
    fields = [field for field in dataclasses.fields(request) if "option" in field.metadata]
    return tuple(_complete(field.metadata["option"], field.name, hints[field.name]) for field in fields)


def _complete(option: Option, name: str, hint: Any) -> Option:
    default = option.default() if isinstance(option.default, type) else option.default
    kind = choice(get_args(hint)) if get_origin(hint) is Literal else option.kind
    flag = option.flag or f"--{name.replace('_', '-')}"
    return dataclasses.replace(option, name=name, hint=hint, default=default, kind=kind, flag=flag)


def changed(request: Any, kind: type, beyond: type | None = None) -> list[tuple[Option, Any]]:
    """The options of ``kind`` that differ from their defaults in a request, with their values.

    Those of ``beyond``, from which the kind inherits, are left out.
    """
    inherited = {option.name for option in list_options(beyond)} if beyond else set()
    values = [(option, getattr(request, option.name)) for option in list_options(kind) if option.name not in inherited]
    return [(option, value) for option, value in values if value != option.default]


def words(request: Any, kind: type, beyond: type | None = None) -> list[str]:
    """The options of the command that ask for the same, as :func:`changed` has them."""
    return [word for option, value in changed(request, kind, beyond) for word in _write_words(option, value)]


def _write_words(option: Option, value: Any) -> Iterator[str]:
    if option.kind is FLAG:
        yield option.flag
        return
    for item in value.items() if isinstance(value, Mapping) else (value,):
        text = option.kind.write(item)
        # argparse takes a text that begins with a minus for an option
        yield from [f"{option.flag}={text}"] if text[:1] == "-" else [option.flag, text]


def keywords(request: Any, kind: type) -> dict[str, Any]:
    """The keywords of the package's function that ask for the same."""
    return {option.name: value for option, value in changed(request, kind) if option.keyword}
