"""Options that several commands share, and the types of their values."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Collection, Mapping
from functools import partial
from typing import Any, NoReturn, TypeVar

from ...requests.dialect import PRESETS, preset_defaults
from ...requests.options import FLAG, Kind, integer, list_options, path, read_path
from ...runtime.text import did_you_mean, most_similar, one_line
from ..errors import blaming_arguments

Request = TypeVar("Request")
SEVERAL = "a folder (without subfolders) or a quoted pattern for all such files; - for stdin"


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line, which suggests what may have been meant."""

    def error(self, message: str) -> NoReturn:
        if message.startswith("argument --") and message.endswith(": expected one argument"):
            message += f"; one that begins with a minus is written {message.split()[1].rstrip(':')}=-…"
        message = re.sub(r"^argument (\S+): (?=\1 )", "", message)  # which names the option itself
        self.exit(2, f"{self.prog}: error: {one_line(message)} (see {self.prog} --help)\n")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            expected = f"invalid choice: {value!r} (choose from {', '.join(map(str, action.choices))})"
            raise argparse.ArgumentError(action, expected + did_you_mean(str(value), action.choices))

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        arguments, unknown = self.parse_known_args(args, namespace)
        if "inputs" in arguments and all(each == "-" or each[:1] not in ("", "-") for each in unknown):
            arguments.inputs += unknown  # those after an option, which argparse does not take
        elif unknown:
            owner = getattr(arguments, "parser", self)
            owner.error(f"unrecognized arguments: {' '.join(unknown)}{owner.meant(unknown)}")
        return arguments

    def meant(self, unknown: Collection[str]) -> str:
        """A suggestion for the first of the unknown arguments that is a parameter of a preset, or like an option."""
        options = [option for option in self._option_string_actions if option.startswith("--")]
        names = [each.split("=")[0] for each in unknown if each.startswith("--")]
        parameters = {key for name in PRESETS for key in preset_defaults(name)} if "--set" in options else ()
        for key in (name[2:].replace("-", "_") for name in names):
            if key in parameters:
                return f"; did you mean '--set {key}=…'?"
        return next(filter(None, (did_you_mean(name, options) for name in names)), "")


def typed(read: Callable[[str], Any]) -> Callable[[str], Any]:
    """``read`` for argparse, which shows the sentence of its own error alone."""

    def parse(text: str) -> Any:
        try:
            return read(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return parse


def chosen(kind: str, choices: Collection[str], sets: Mapping[str, Collection[str]]) -> Callable[[str], list[str]]:
    """Parses names separated by commas, of ``choices`` or of ``sets`` of them; ``kind`` says what they name."""

    def parse(text: str) -> list[str]:
        names = [name for part in text.split(",") for name in sets.get(part, [part])]
        for name in names:
            if name not in choices:
                meant = did_you_mean(name, [*choices, *sets])
                near = ", ".join(most_similar(name, [*choices, *sets]))
                raise argparse.ArgumentTypeError(f"expected {kind} such as {near}, got {name!r}{meant}")
        return list(dict.fromkeys(names))

    return parse


def add(
    command: argparse.ArgumentParser, name: str, kind: Kind, text: str, default: Any = None, *, dest: str = ""
) -> None:
    """Adds an option, or an argument, with values of a kind; its help ends with the default, if there is one."""
    named = {"dest": dest} if dest else {}
    if kind is FLAG:
        command.add_argument(name, action="store_true", help=text, **named)  # type: ignore[arg-type]
        return
    command.add_argument(
        name,
        type=typed(partial(kind.read, name)),
        action="store" if kind.collect is None else "append",
        choices=kind.choices or None,
        default=default,
        metavar=kind.name,
        help=text if default is None else f"{text} (default: {kind.write(default)})",
        **named,  # type: ignore[arg-type]
    )


def add_field(command: argparse.ArgumentParser, request: type, name: str, default: Any = None) -> None:
    """Adds the option of a request's field, perhaps with another default."""
    field = next(each for each in list_options(request) if each.name == name)
    text, repeated = field.help, field.kind.collect is not None
    if default is None and field.stands_for is not None:
        text = f"{text} (default: {field.kind.write(field.stands_for)})"
    elif default is None and not repeated:
        default = field.default
    add(command, field.flag, field.kind, text, default, dest=name)


def add_request(command: argparse.ArgumentParser, request: type) -> None:
    """Adds the options of all fields of a request."""
    for each in list_options(request):
        add_field(command, request, each.name)


def build_request(request: type[Request], arguments: argparse.Namespace) -> Request:
    """The request of the options that :func:`add_request` has added; WrongArguments if they do not go together."""
    values = {}
    for each in list_options(request):  # type: ignore[arg-type]  # mypy takes no class for hashable
        value = getattr(arguments, each.name)
        values[each.name] = value if each.kind.collect is None else each.kind.collect(value or [])
    with blaming_arguments():
        return request(**values)


def inputs(command: argparse.ArgumentParser, more: str = "") -> None:
    """Adds the inputs of a command; ``more`` says what else they may be."""
    command.add_argument(
        "inputs",
        nargs="+",
        type=typed(read_path),
        metavar="INPUT",
        help=f"a photograph; a file of `nablahog hog`; an array of another library (.npy, .npz, .mat); {SEVERAL}{more}",
    )


def output(command: argparse.ArgumentParser, metavar: str, text: str, *, stdout: bool = False) -> None:
    """Adds ``--output`` and ``--quiet``; with ``stdout``, the output may be ``-``."""

    def read(value: str) -> str:
        if value == "-" and not stdout:
            raise ValueError("expected the name of a file or folder; these results cannot go to stdout")
        return read_path(value)

    command.add_argument("-o", "--output", required=True, type=typed(read), metavar=metavar, help=text)
    command.add_argument("-q", "--quiet", action="store_true", help="print nothing but errors")
    command.set_defaults(parser=command)


def images(command: argparse.ArgumentParser) -> None:
    add(command, "--images", path("DIR"), "folder of photographs (default: those of scikit-image)")


def workers(command: argparse.ArgumentParser) -> None:
    add(command, "--workers", integer(), "number of processes (default: one for each core)")


def cluster(command: argparse.ArgumentParser) -> None:
    text = "work on a Dask cluster: local, local:N, tcp://HOST:PORT, or a scheduler's JSON file"
    command.add_argument("--cluster", metavar="CLUSTER", help=text)


def seed(command: argparse.ArgumentParser) -> None:
    add(command, "--seed", integer(0), "seed of all random numbers", 0)
