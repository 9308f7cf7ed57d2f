"""The fields of requests: each has a default, a kind of values, and a sentence of help."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from functools import cache, partial
from typing import Any, Literal, get_args, get_origin, get_type_hints

from ..inputs.numbers import (
    as_integer,
    as_number,
    as_numbers,
    as_size,
    as_truth,
    check_choice,
    parse_numbers,
    shortened,
)


@dataclass(frozen=True, eq=False)
class Kind:
    """A kind of values.

    Attributes:
        name: in a line of usage.
        convert: the value of what JSON or :attr:`parse` has, by the name of its argument; ValueError if it is none.
        parse: the numbers or the text that a text of the command stands for.
        write: the text of a value.
        choices: all values, if they are few names.
        least, most: the range of numbers.
        collect: what the values of a repeated option are together; None for an option that is not repeated.
    """

    name: str
    convert: Callable[[str, Any], Any]
    parse: Callable[[str], Any] = str
    write: Callable[[Any], str] = str
    choices: Collection[str] = ()
    least: float | None = None
    most: float | None = None
    collect: Callable[[list[Any]], Any] | None = None

    def read(self, name: str, text: str) -> Any:
        """The value of a text of the command."""
        return self.convert(name, self.parse(text))


def choice(names: Collection[str], name: str = "NAME") -> Kind:
    """One of the names."""

    def convert(argument: str, value: Any) -> str:
        check_choice(argument, value, names)
        return str(value)

    return Kind(name, convert, choices=names)


def integer(least: int = 1, most: int = 10**18 - 1) -> Kind:
    """An integer in ``least`` … ``most``."""
    return Kind("N", partial(as_integer, least=least, most=most), parse_numbers, least=least, most=most)


def number(name: str, **bounds: Any) -> Kind:
    """A number in the bounds of :func:`.as_number`."""
    least = bounds.get("least", bounds.get("above"))
    return Kind(name, partial(as_number, **bounds), parse_numbers, "{:g}".format, least=least, most=bounds.get("most"))


def numbers(names: str, convert: Callable[[str, Any], Any] | None = None) -> Kind:
    """Finite numbers separated by commas, one for each of ``names``, which are, too."""
    return Kind(names, convert or partial(as_numbers, of_what=names), parse_numbers, write_numbers)


def write_numbers(values: Sequence[float]) -> str:
    return ",".join(f"{value:.10g}" for value in values)


def path(name: str) -> Kind:
    """The name of a file or folder, which is not empty."""
    return Kind(name, lambda _, value: read_path(value))


def read_path(text: str) -> str:
    """The name of a file or folder, which is not empty."""
    if not text:
        raise ValueError("expected the name of a file or folder, got ''")
    return text


def _as_text(name: str, value: object) -> str:
    if not isinstance(value, str):
        raise ValueError(f"{name} must be a text, got {shortened(value)}")
    return value


def _as_setting(name: str, setting: tuple[str, ...]) -> tuple[str, str]:
    if len(setting) != 2 or not setting[0] or not isinstance(setting[1], str):
        got = shortened("=".join(map(str, setting)))
        raise ValueError(f"{name} must be KEY=VALUE, a parameter of the preset and a text, got {got}")
    return setting[0], setting[1]


FLAG = Kind("", as_truth)  # true if it is there
TEXT = Kind("NAME", _as_text)
SIZE = Kind(
    "HxW",
    partial(as_size, axes="HEIGHTxWIDTH"),
    lambda text: parse_numbers(re.sub("[x×]", ",", text)),
    lambda sides: "x".join(map(str, sides)),
)
SETTING = Kind("KEY=VALUE", _as_setting, lambda text: tuple(text.split("=", 1)), "=".join, collect=dict)


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
