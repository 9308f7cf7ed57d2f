"""Options that several commands share, and the types of their values."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable, Collection, Mapping
from typing import Any, NoReturn

from ...runtime.text import did_you_mean, one_line
from .presets import DEFAULT_PRESET, PRESETS, defaults_of

SIZE = 256  # pixels of the longer side: the pre-image of such a photograph takes seconds
SEVERAL = "a folder or a quoted pattern for all such files; - for stdin"


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line, which suggests what may have been meant."""

    def error(self, message: str) -> NoReturn:
        if message.startswith("argument --") and message.endswith(": expected one argument"):
            message += f"; one that begins with a minus is written {message.split()[1].rstrip(':')}=-…"
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
        parameters = {key for name in PRESETS for key in defaults_of(name)} if "--set" in options else ()
        for key in (name[2:].replace("-", "_") for name in names):
            if key in parameters:
                return f"; did you mean '--set {key}=…'?"
        return next(filter(None, (did_you_mean(name, options) for name in names)), "")


def image_size(text: str) -> tuple[int, int]:
    """(height, width) in pixels."""
    match = re.fullmatch(r"([1-9]\d{0,5})[x×]([1-9]\d{0,5})", text)
    if match is None:
        raise argparse.ArgumentTypeError(f"expected pixels as HEIGHTxWIDTH, each at least 1, got {text!r}")
    return int(match[1]), int(match[2])


def setting(text: str) -> tuple[str, str]:
    key, equals, value = text.partition("=")
    if not key or not equals:
        raise argparse.ArgumentTypeError(f"expected KEY=VALUE, a parameter of the preset, got {text!r}")
    return key, value


def path(text: str) -> str:
    """The name of a file or folder, which is not empty."""
    if not text:
        raise argparse.ArgumentTypeError("expected the name of a file or folder, got ''")
    return text


def numbers(names: str) -> Callable[[str], tuple[float, ...]]:
    """Parses finite numbers separated by commas, one for each of the comma-separated ``names``."""

    def parse(text: str) -> tuple[float, ...]:
        try:
            values = tuple(float(part) for part in text.split(","))
        except ValueError:
            values = ()
        if len(values) != len(names.split(",")) or not all(map(math.isfinite, values)):
            what = f"{names.count(',') + 1} numbers {names}" if "," in names else "a number"
            raise argparse.ArgumentTypeError(f"expected {what}, got {text!r}")
        return values

    return parse


def chosen(kind: str, choices: Collection[str], sets: Mapping[str, Collection[str]]) -> Callable[[str], list[str]]:
    """Parses names separated by commas, of ``choices`` or of ``sets`` of them; ``kind`` says what they name."""

    def parse(text: str) -> list[str]:
        names = [name for part in text.split(",") for name in sets.get(part, [part])]
        for name in names:
            if name not in choices:
                meant = did_you_mean(name, [*choices, *sets])
                raise argparse.ArgumentTypeError(f"expected {kind} from {', '.join(choices)}, got {name!r}{meant}")
        return list(dict.fromkeys(names))

    return parse


def device(text: str) -> str:
    """An existing device by its name; PyTorch is imported for CUDA only."""
    match = re.fullmatch(r"cpu|cuda(?::(\d{1,3}))?", text)
    if match is None:
        raise argparse.ArgumentTypeError(f"expected cpu, cuda or cuda:N, got {text!r}")
    if text != "cpu":
        import torch

        devices = torch.cuda.device_count() if torch.cuda.is_available() else 0
        if devices == 0:
            raise argparse.ArgumentTypeError(f"expected a CUDA device for {text}, but PyTorch finds none here")
        if int(match[1] or 0) >= devices:
            raise argparse.ArgumentTypeError(f"expected cuda:0 … cuda:{devices - 1}, got {text}")
    return text


def number(
    command: argparse.ArgumentParser,
    name: str,
    text: str,
    *,
    least: int = 1,
    most: int = 10**18 - 1,
    default: int | None = None,
) -> None:
    """Adds an option for an integer in ``least`` … ``most``."""

    def parse(value: str) -> int:
        if not re.fullmatch(r"\d{1,18}", value) or int(value) < least:
            raise argparse.ArgumentTypeError(f"expected an integer of at least {least}, got {value!r}")
        if int(value) > most:
            raise argparse.ArgumentTypeError(f"expected an integer of at most {most}, got {value!r}")
        return int(value)

    command.add_argument(name, type=parse, default=default, metavar="N", help=text)


def file(command: argparse.ArgumentParser, name: str, metavar: str, text: str) -> None:
    """Adds an option for the name of a file or folder."""
    command.add_argument(name, type=path, metavar=metavar, help=text)


def inputs(command: argparse.ArgumentParser, more: str = "") -> None:
    """Adds the inputs of a command, and the options for arrays; ``more`` says what else the inputs may be."""
    command.add_argument(
        "inputs",
        nargs="+",
        type=path,
        metavar="INPUT",
        help="a photograph; a file of `nablahog hog`; with --preset, an array of another library (.npy, .npz, .mat); "
        f"{SEVERAL}{more}",
    )
    command.add_argument(
        "--image-size",
        type=image_size,
        metavar="HxW",
        help="height x width of an array's image; required if the array is flat",
    )
    command.add_argument("--key", metavar="NAME", help="name of the array, if the file holds several")


def output(command: argparse.ArgumentParser, metavar: str, text: str, *, stdout: bool = False) -> None:
    """Adds ``--output`` and ``--quiet``; with ``stdout``, the output may be ``-``."""

    def parse(value: str) -> str:
        if value == "-" and not stdout:
            raise argparse.ArgumentTypeError("expected the name of a file or folder; these results cannot go to stdout")
        return path(value)

    command.add_argument("-o", "--output", required=True, type=parse, metavar=metavar, help=text)
    command.add_argument("-q", "--quiet", action="store_true", help="print nothing but errors")
    command.set_defaults(parser=command)


def choice(command: argparse.ArgumentParser, name: str, choices: Collection[str], text: str) -> None:
    """Adds an option for one of the ``choices``, by default the first."""
    default = next(iter(choices))
    command.add_argument(name, choices=choices, default=default, metavar="NAME", help=f"{text} (default: {default})")


def images(command: argparse.ArgumentParser) -> None:
    file(command, "--images", "DIR", "folder of photographs (default: those of scikit-image)")


def preset(command: argparse.ArgumentParser, default: str | None = None) -> None:
    """Adds ``--preset`` and ``--set``; without a ``default``, the command knows whether the preset was chosen."""
    command.add_argument(
        "--preset",
        choices=PRESETS,
        default=default,
        metavar="NAME",
        help=f"kind of descriptor (default: {default or DEFAULT_PRESET}): {', '.join(PRESETS)}",
    )
    command.add_argument(
        "--set",
        dest="settings",
        action="append",
        type=setting,
        metavar="KEY=VALUE",
        help="a parameter of the preset, as in nablahog.presets, such as cell_size=8x6; may be repeated",
    )


def size(command: argparse.ArgumentParser, default: int | None = None) -> None:
    """Adds ``--size``; without a ``default``, the command knows whether it was chosen."""
    text = f"shrink photographs to at most N pixels on the longer side; 0 keeps their size (default: {default or SIZE})"
    number(command, "--size", text, least=0, default=default)


def workers(command: argparse.ArgumentParser) -> None:
    number(command, "--workers", "number of processes (default: one for each core)")


def cluster(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--cluster",
        metavar="CLUSTER",
        help="work on a Dask cluster: local, local:N, tcp://HOST:PORT, or a scheduler's JSON file",
    )


def seed(command: argparse.ArgumentParser) -> None:
    number(command, "--seed", "seed of all random numbers (default: 0)", least=0, default=0)
