"""The fields of requests: each has a default, a kind of values, and a sentence of help."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, get_args, get_origin, get_type_hints

from .kinds import FLAG, Kind, choice


@dataclass(frozen=True)
class Option:
    """A field of a request.

    Attributes:
        name: of the field.
        hint: its type.
        default: its value if nothing is asked for.
        help: a sentence for `--help`.
        kind: how its values are written, and their range.
        flag: the option of the command.
        keyword: whether it is a keyword of the package's function, too.
        on_page: whether the page has it.
        page_choices: of all its values those that the page has.
        stands_for: what the default None means.
    """

    name: str
    hint: Any
    default: Any
    help: str
    kind: Kind
    flag: str
    keyword: bool
    on_page: bool
    page_choices: tuple[str, ...]
    stands_for: Any


def option(
    default: Any,
    text: str,
    kind: Kind | None = None,
    *,
    flag: str = "",
    keyword: bool = False,
    on_page: bool | tuple[str, ...] = False,
    stands_for: Any = None,
) -> Any:
    """A field of a request, as :class:`Option` has it.

    Args:
        default: of the field, or a type that makes it.
        text: the sentence of help.
        kind: of its values; by default that of the field's type, ``bool`` or a ``Literal``.
        flag: by default the name of the field.
        keyword: whether the package's function has a keyword of this name.
        on_page: whether the page has it, or those of its values that the page has.
        stands_for: what the default None means.
    """
    about = {"help": text, "kind": kind, "flag": flag, "keyword": keyword, "on_page": on_page, "stands_for": stands_for}
    if isinstance(default, type):
        return dataclasses.field(default_factory=default, metadata=about)
    return dataclasses.field(default=default, metadata=about)


@cache
def options_of(request: type) -> tuple[Option, ...]:
    """The options of a request, in the order of its fields; a field that is no :func:`option` is none."""
    hints = get_type_hints(request)
    return tuple(_option(each, hints[each.name]) for each in dataclasses.fields(request) if "help" in each.metadata)


def _option(field: dataclasses.Field[Any], hint: Any) -> Option:
    about = field.metadata
    factory = field.default_factory
    default = field.default if factory is dataclasses.MISSING else factory()
    kind = about["kind"] or (choice(get_args(hint)) if get_origin(hint) is Literal else FLAG)
    on_page = about["on_page"]
    return Option(
        field.name,
        hint,
        default,
        about["help"],
        kind,
        about["flag"] or f"--{field.name.replace('_', '-')}",
        about["keyword"],
        bool(on_page),
        on_page if isinstance(on_page, tuple) else tuple(kind.choices),
        about["stands_for"],
    )


def changed(request: Any, kind: type, beyond: type | None = None) -> list[tuple[Option, Any]]:
    """The options of ``kind`` that differ from their defaults in a request, with their values.

    Those of ``beyond``, from which the kind inherits, are left out.
    """
    inherited = {each.name for each in options_of(beyond)} if beyond else set()
    values = [(each, getattr(request, each.name)) for each in options_of(kind) if each.name not in inherited]
    return [(each, value) for each, value in values if value != each.default]


def words(request: Any, kind: type, beyond: type | None = None) -> list[str]:
    """The options of the command that ask for the same, as :func:`changed` has them."""
    return [word for each, value in changed(request, kind, beyond) for word in _words_of(each, value)]


def _words_of(option: Option, value: Any) -> Iterator[str]:
    if option.kind is FLAG:
        yield option.flag
        return
    for each in value.items() if isinstance(value, Mapping) else (value,):
        text = option.kind.write(each)
        # argparse takes a text that begins with a minus for an option
        yield from [f"{option.flag}={text}"] if text[:1] == "-" else [option.flag, text]


def keywords(request: Any, kind: type) -> dict[str, Any]:
    """The keywords of the package's function that ask for the same."""
    return {each.name: value for each, value in changed(request, kind) if each.keyword}
