"""The arguments of the command ``nablahog``."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from importlib.metadata import version
from typing import NoReturn, get_args

import torch

from .evaluate.methods import METHODS
from .hog.spec import Vote
from .sources import DEFAULT_CELL, DEFAULT_DESCRIPTOR, PRESETS

SIZE = 256
TABLE1_SIZE = 128  # that of the paper's images
LEARN_SIZE = 512
MOST_THREADS = 1024


class _Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line, as all errors of this command are."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {message} (see {self.prog} --help)\n")


def _integer(least: int, most: int = 10**18 - 1) -> Callable[[str], int]:
    def parse(text: str) -> int:
        if not re.fullmatch(r"\d{1,18}", text) or int(text) < least:
            raise argparse.ArgumentTypeError(f"expected an integer of at least {least}, got {text!r}")
        if int(text) > most:
            raise argparse.ArgumentTypeError(f"expected an integer of at most {most}, got {text!r}")
        return int(text)

    return parse


def _cell(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"([1-9]\d{0,5})(?:[x×]([1-9]\d{0,5}))?", text)
    if match is None:
        raise argparse.ArgumentTypeError(
            f"expected pixels of a cell, one number or HEIGHTxWIDTH, each at least 1, got {text!r}"
        )
    return int(match[1]), int(match[2] or match[1])


def _device(text: str) -> torch.device:
    match = re.fullmatch(r"cpu|cuda(?::(\d{1,3}))?", text)
    if match is None:
        raise argparse.ArgumentTypeError(f"expected cpu, cuda or cuda:N, got {text!r}")
    if text != "cpu":
        devices = torch.cuda.device_count() if torch.cuda.is_available() else 0
        if devices == 0:
            raise argparse.ArgumentTypeError(f"expected a CUDA device for {text}, but PyTorch finds none here")
        if int(match[1] or 0) >= devices:
            raise argparse.ArgumentTypeError(f"expected cuda:0 … cuda:{devices - 1}, got {text}")
    return torch.device(text)


def parser() -> argparse.ArgumentParser:
    """The parser of the command; the name of the subcommand is its ``command``."""
    top = _Parser(
        prog="nablahog",
        description="HOG descriptors of photographs, and photographs from HOG descriptors.",
        epilog="`nablahog COMMAND --help` lists the options of a command.",
    )
    top.add_argument("--version", action="version", version=f"nablahog {version('nablahog')}")
    commands = top.add_subparsers(dest="command", metavar="COMMAND", required=True, parser_class=_Parser)

    hog = commands.add_parser(
        "hog",
        help="compute the descriptors of photographs",
        description="Computes the HOG descriptor of each photograph and saves it with its spec.",
    )
    hog.add_argument("inputs", nargs="+", metavar="PHOTO", help="an image of any format that Pillow reads")
    _output(hog, "FILE", "descriptor file (.npz) of one photograph; of several, a folder for one file each")
    _common(hog, size=0)

    glyph = commands.add_parser(
        "glyph",
        help="draw descriptors",
        description="Draws each descriptor as glyphs: in each cell, strokes along its edges.",
    )
    _inputs(glyph)
    _output(glyph, "FILE", "PNG file for one input; any name that does not end in .png is a folder for one file each")
    _common(glyph, size=SIZE)

    invert = commands.add_parser(
        "invert",
        help="find images that have given descriptors",
        description="Finds, for each descriptor, an image that has it, and compares it with the photograph if known. "
        "Leaves <stem>_preimage.png, _glyphs.png and _thumbnails.png in the folder, and results.json.",
    )
    _inputs(invert)
    _output(invert, "DIR", "folder for the results, made if missing")
    _common(invert, size=SIZE)
    _minimiser(invert)
    _prior(invert, "for descriptors of the spec that it was learned for")

    demo = commands.add_parser(
        "demo",
        help="invert a photograph that comes with scikit-image",
        description="Inverts both descriptors of one photograph and writes pictures, figures and a page to look at.",
    )
    _output(demo, "DIR", "folder for the results, made if missing")
    _device_option(demo)
    _minimiser(demo)

    table1 = commands.add_parser(
        "table1",
        help="compare all methods on a folder of images",
        description="Inverts the descriptors of all images by all methods of the paper's Table 1 and writes the table: "
        "index.html to look at, summary.csv, per_image.csv, times.csv and failures.csv. A run that was interrupted "
        "goes on when it is repeated.",
    )
    _images(table1)
    _output(table1, "DIR", "folder for the results, made if missing")
    table1.add_argument(
        "--methods",
        type=_methods,
        metavar="NAME,…",
        help=f"only these, separated by commas, of: {', '.join(METHODS)}",
    )
    table1.add_argument("--limit", type=_integer(1), metavar="N", help="only the first N images")
    _size(table1, TABLE1_SIZE)
    _minimiser(table1)
    _prior(table1, "needed by, and only by, uoctti-learned")
    table1.add_argument(
        "--workers", type=_integer(1), metavar="N", help="processes to work in (default: one for each core)"
    )

    learn = commands.add_parser(
        "learn", help="learn from photographs", description="Learns from photographs what helps to invert descriptors."
    )
    _learn_prior(learn.add_subparsers(metavar="WHAT", required=True, parser_class=_Parser))
    return top


def _learn_prior(kinds: argparse._SubParsersAction[_Parser]) -> None:
    prior = kinds.add_parser(
        "prior",
        help="what photographs look like, given a descriptor, for --prior",
        description="Teaches a network which image to expect for a descriptor: near the mean of all photographs that "
        "have it. What is learned is kept in FILE.npz.checkpoint after each epoch, so a run that was interrupted goes "
        "on when it is repeated; that file is removed at the end.",
    )
    prior.set_defaults(command="learn prior")
    _output(prior, "FILE.npz", "the prior, for `nablahog invert --prior` and `nablahog table1 --prior`")
    _images(prior)
    prior.add_argument(
        "--epochs",
        type=_integer(1),
        metavar="N",
        help="passes over the images (default: as many as take about an hour and a half on one core)",
    )
    prior.add_argument("--seed", type=_integer(0), default=0, help="of everything random (default: 0)")
    prior.add_argument(
        "--threads",
        type=_integer(1, MOST_THREADS),
        metavar="N",
        help="to compute in (default: one for each core); another number rounds otherwise",
    )
    _dialect(prior, f"type of descriptor (default: {DEFAULT_DESCRIPTOR})")
    _size(prior, LEARN_SIZE)


def _methods(text: str) -> list[str]:
    names = text.split(",")
    for name in names:
        if name not in METHODS:
            raise argparse.ArgumentTypeError(f"expected methods of {', '.join(METHODS)}, got {name!r}")
    return names


def _inputs(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "inputs",
        nargs="+",
        metavar="PHOTO_or_DESCRIPTOR",
        help="an image of any format that Pillow reads, or a file that `nablahog hog` wrote",
    )


def _output(command: argparse.ArgumentParser, metavar: str, text: str) -> None:
    command.add_argument("-o", "--output", required=True, metavar=metavar, help=text)


def _images(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--images", metavar="DIR", help="folder of images (default: photographs that come with scikit-image)"
    )


def _prior(command: argparse.ArgumentParser, use: str) -> None:
    command.add_argument("--prior", metavar="FILE", help=f"a prior that `nablahog learn prior` wrote; {use}")


def _common(command: argparse.ArgumentParser, *, size: int) -> None:
    _dialect(
        command,
        f"type of descriptor (default: {DEFAULT_DESCRIPTOR}); descriptor files state theirs and must agree",
    )
    _size(command, size)
    _device_option(command)
    command.add_argument("--json", action="store_true", help="print the results as JSON instead of a table")


def _dialect(command: argparse.ArgumentParser, descriptor: str) -> None:
    cell = f"{DEFAULT_CELL[0]}"
    command.add_argument("--descriptor", choices=PRESETS, help=descriptor)
    command.add_argument(
        "--cell", type=_cell, metavar="N|HxW", help=f"pixels of a cell, one number or height x width (default: {cell})"
    )
    command.add_argument(
        "--vote", choices=get_args(Vote), help="orientation votes of uoctti: shared by two bins, or all to one bin"
    )


def _size(command: argparse.ArgumentParser, size: int) -> None:
    command.add_argument(
        "--size",
        type=_integer(0),
        default=size,
        metavar="N",
        help=f"shrink photographs to at most N pixels on the longer side, 0 for never (default: {size})",
    )


def _device_option(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--device", type=_device, default=torch.device("cpu"), help="cpu, cuda or cuda:N (default: cpu)"
    )


def _minimiser(command: argparse.ArgumentParser) -> None:
    command.add_argument("--seed", type=_integer(0), default=0, help="of the starting image (default: 0)")
    command.add_argument(
        "--max-evaluations", type=_integer(2), metavar="N", help="of the objective, for each image; fewer is faster"
    )
