"""Options that several commands share, and the types of their values."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Any, NoReturn, get_args

from ...hog.spec import Vote
from ...runtime.text import one_line
from .did_you_mean import did_you_mean
from .preset_parameters import DEFAULT_DESCRIPTOR, PRESETS

MEMORY = 4  # gigabytes
SIZE = 256  # pixels of photographs: a pre-image of so many takes seconds
SEVERAL = "a folder or a quoted pattern for all such files in it; - for stdin"


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line, as all errors of this command are, and suggest what was meant."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {one_line(message)} (see {self.prog} --help)\n")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            expected = f"invalid choice: {value!r} (choose from {', '.join(map(str, action.choices))})"
            raise argparse.ArgumentError(action, expected + did_you_mean(str(value), action.choices))

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        arguments, unknown = self.parse_known_args(args, namespace)
        if unknown:
            owner = getattr(arguments, "parser", self)
            owner.error(f"unrecognized arguments: {' '.join(unknown)}{owner.meant(unknown)}")
        return arguments

    def meant(self, unknown: Collection[str]) -> str:
        """A suggestion for the first of the unknown arguments that is like one of the options."""
        options = [option for option in self._option_string_actions if option.startswith("--")]
        suggestions = (did_you_mean(each.split("=")[0], options) for each in unknown if each.startswith("--"))
        return next(filter(None, suggestions), "")


def _sides(expected: str, *, square: bool) -> Callable[[str], tuple[int, int]]:
    """Parses (height, width) in pixels; with ``square``, one number is both."""

    def parse(text: str) -> tuple[int, int]:
        match = re.fullmatch(r"([1-9]\d{0,5})(?:[x×]([1-9]\d{0,5}))?", text)
        if match is None or not (match[2] or square):
            raise argparse.ArgumentTypeError(f"expected {expected}, each at least 1, got {text!r}")
        return int(match[1]), int(match[2] or match[1])

    return parse


cell = _sides("pixels of a cell, one number or HEIGHTxWIDTH", square=True)
image_size = _sides("pixels as HEIGHTxWIDTH", square=False)


def setting(text: str) -> tuple[str, str]:
    key, equals, value = text.partition("=")
    if not key or not equals:
        raise argparse.ArgumentTypeError(f"expected KEY=VALUE, a parameter of the preset, got {text!r}")
    return key, value


def path(text: str) -> str:
    """The name of a file or folder; none would be that of the folder at work."""
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
            raise argparse.ArgumentTypeError(f"expected the numbers {names}, got {text!r}")
        return values

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


class _ListMethods(argparse.Action):
    """Prints the lines of its ``const`` and exits."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: object, option: object = None
    ) -> NoReturn:
        print(*self.const(), sep="\n")
        parser.exit()


def table(
    command: argparse.ArgumentParser,
    methods: Collection[str],
    listed: Callable[[], Iterable[str]],
    sets: Mapping[str, Collection[str]] | None = None,
) -> None:
    """Adds the options of the commands of tables.

    Args:
        command: to add them to.
        methods: the names to choose from.
        listed: the lines of ``--list-methods``.
        sets: names for several methods.
    """
    sets = sets or {}

    def parse(text: str) -> list[str]:
        names = [name for part in text.split(",") for name in sets.get(part, [part])]
        for name in names:
            if name not in methods:
                meant = did_you_mean(name, [*methods, *sets])
                raise argparse.ArgumentTypeError(f"expected methods of {', '.join(methods)}, got {name!r}{meant}")
        return names

    output(command, "DIR", "folder for the results, made if missing")
    several = "".join(f"; {name} for {', '.join(each)}" for name, each in sets.items())
    only = f"only these, separated by commas, of: {', '.join(methods)}{several}"
    command.add_argument("--methods", type=parse, metavar="NAME,…", help=only)
    command.add_argument(
        "--list-methods",
        action=_ListMethods,
        nargs=0,
        const=listed,
        default=argparse.SUPPRESS,
        help="list the methods, and which of them run without being asked for, and exit",
    )
    workers(command)
    cluster(command)


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


def workers(command: argparse.ArgumentParser) -> None:
    number(command, "--workers", "processes to work in (default: one for each core)")


def cluster(command: argparse.ArgumentParser) -> None:
    """Adds ``--cluster``."""
    command.add_argument(
        "--cluster",
        metavar="CLUSTER",
        help="work on a Dask cluster instead: local or local:N for processes of this machine, tcp://HOST:PORT, or the "
        "JSON file of a scheduler; needs the extra nablahog[cluster]",
    )


def inputs(command: argparse.ArgumentParser, more: str = "") -> None:
    """Adds the inputs of a command; ``more`` says what else they may be."""
    command.add_argument(
        "inputs",
        nargs="+",
        type=path,
        metavar="PHOTO_or_DESCRIPTOR",
        help="an image of any format that Pillow reads, a file that `nablahog hog` wrote, or, with --preset, an array "
        f"that another library computed: .npy, .npz, or .mat up to version 7; {SEVERAL}{more}",
    )
    of_arrays(command)


def of_arrays(command: argparse.ArgumentParser) -> None:
    """Adds the options that describe arrays of other libraries."""
    command.add_argument(
        "--image-size",
        type=image_size,
        metavar="HxW",
        help="height x width of the image of an array, in pixels; required for an array in one row (default: "
        "whole cells; of opencv its win_size)",
    )
    command.add_argument("--key", metavar="NAME", help="name of the array in an .npz or .mat file with several")


def output(
    command: argparse.ArgumentParser, metavar: str, text: str, *, stdout: bool = False, required: bool = True
) -> None:
    """Adds ``--output`` and ``--quiet``; with ``stdout``, the output may be ``-``."""

    def parse(value: str) -> str:
        if value == "-" and not stdout:
            raise argparse.ArgumentTypeError("expected the name of a file or folder: these results cannot go to stdout")
        return path(value)

    command.add_argument("-o", "--output", required=required, type=parse, metavar=metavar, help=text)
    quiet(command)
    command.set_defaults(parser=command)


def quiet(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "-q", "--quiet", action="store_true", help="print neither tables nor progress; errors and --json are printed"
    )


def images(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--images", type=path, metavar="DIR", help="folder of images (default: photographs that come with scikit-image)"
    )


def prior(command: argparse.ArgumentParser) -> None:
    """Adds ``--prior`` and ``--no-prior``."""
    choice = command.add_mutually_exclusive_group()
    choice.add_argument(
        "--prior",
        type=path,
        metavar="FILE",
        help="what `nablahog learn prior` wrote for such descriptors (default: the prior that comes with nablahog)",
    )
    choice.add_argument("--no-prior", action="store_true", help="invert with nothing that was learned")


def common(command: argparse.ArgumentParser) -> None:
    dialect(
        command,
        f"type of descriptor (default: {DEFAULT_DESCRIPTOR}); must agree with that of descriptor files",
    )
    text = (
        f"shrink photographs to at most N pixels on the longer side, 0 for never (default: {SIZE}, as said on stderr)"
    )
    number(command, "--size", text, least=0)
    device_option(command)
    command.add_argument("--json", action="store_true", help="print the results as JSON instead of a table")


def dialect(command: argparse.ArgumentParser, preset: str) -> None:
    command.add_argument(
        "--preset",
        "--descriptor",
        dest="descriptor",
        choices=PRESETS,
        metavar="NAME",
        help=f"{preset}; one of {', '.join(PRESETS)}",
    )
    command.add_argument(
        "--set",
        dest="settings",
        action="append",
        type=setting,
        metavar="KEY=VALUE",
        help="a parameter of the preset, such as orientations=8 or cells_per_block=2x2, as in nablahog.presets; sizes "
        "are height x width, except for opencv: width x height, as in OpenCV; may be repeated",
    )
    command.add_argument(
        "--cell",
        type=cell,
        metavar="N|HxW",
        help="pixels of a cell, one number or height x width, also for opencv (default: 8; 5 for seeing3d)",
    )
    command.add_argument(
        "--vote",
        choices=get_args(Vote),
        help="orientation votes of uoctti, aubry, vlfeat and cnn_hog: linear, shared by two bins, or hard, for one bin",
    )


def size(command: argparse.ArgumentParser, longer_side: int) -> None:
    text = f"shrink photographs to at most N pixels on the longer side, 0 for never (default: {longer_side})"
    number(command, "--size", text, least=0, default=longer_side)


def memory(command: argparse.ArgumentParser) -> None:
    text = f"gigabytes that an input may need; one that needs more is refused (default: {MEMORY})"
    number(command, "--memory", text, most=10**6, default=MEMORY)


def device_option(command: argparse.ArgumentParser) -> None:
    command.add_argument("--device", type=device, default="cpu", help="cpu, cuda or cuda:N (default: cpu)")


def minimiser(command: argparse.ArgumentParser) -> None:
    seed(command, "the starting image")
    number(command, "--max-evaluations", "of the objective, for each image; fewer is faster", least=2)


def seed(command: argparse.ArgumentParser, of: str = "everything random") -> None:
    number(command, "--seed", f"of {of} (default: 0)", least=0, default=0)
