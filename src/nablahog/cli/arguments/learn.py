"""The arguments of ``nablahog learn``."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import NamedTuple

from ...pose.options import ORDER
from . import options
from .options import Parser
from .pose import exemplars
from .preset_parameters import DEFAULT_DESCRIPTOR

SIZE = 512
BOVW_SIZE = 128  # that of the images of Table 1
MOST_THREADS = 1024
MOST_ORDER = 100
PRECISIONS = ("float32", "bfloat16")
SIGNS = ("signed", "unsigned")


class Kind(NamedTuple):
    """The arguments for a kind of model.

    Attributes:
        help: one line.
        description: what is learned.
        output: what the output file is.
        options: adds its own options.
        descriptor: the default type of descriptor; None if there is nothing to choose.
        remark: on types of descriptors.
        size: the default size of images.
    """

    help: str
    description: str
    output: str
    options: Callable[[argparse.ArgumentParser], None] = options.seed
    descriptor: str | None = DEFAULT_DESCRIPTOR
    remark: str = ""
    size: int = SIZE


def _prior(command: argparse.ArgumentParser) -> None:
    options.number(command, "--epochs", "passes over the images (default: as many as take an hour or two on two cores)")
    options.seed(command)
    options.device_option(command)
    threads = "to compute in (default: one for each core); another number rounds otherwise"
    options.number(command, "--threads", threads, most=MOST_THREADS)
    command.add_argument(
        "--precision",
        choices=PRECISIONS,
        help="of convolutions; bfloat16 takes half the time where the processor has instructions for it (default: "
        "float32 on a CPU, bfloat16 on a GPU with instructions for it)",
    )
    command.add_argument(
        "--start",
        metavar="FILE",
        help="go on from this prior, in place of random weights; 'default' is the one that comes with the package",
    )
    command.add_argument(
        "--signs",
        choices=SIGNS,
        default=SIGNS[0],
        help="for all dialects with signed gradients, such as uoctti, or for all with unsigned ones, such as paper "
        "(default: %(default)s)",
    )


def _background(command: argparse.ArgumentParser) -> None:
    text = f"the largest offset in cells; elements may have a row and a column more (default: {ORDER})"
    options.number(command, "--order", text, least=0, most=MOST_ORDER, default=ORDER)
    options.cluster(command)


def _bovw(command: argparse.ArgumentParser) -> None:
    options.seed(command)
    options.cluster(command)


def _hoggles(command: argparse.ArgumentParser) -> None:
    command.add_argument("--fast", action="store_true", help="random windows as atoms, instead of learning any")
    options.seed(command)


KINDS = {
    "prior": Kind(
        "the images to expect for a descriptor, for --prior",
        "Trains a network to predict an image from its descriptor: near the mean of all photographs that have it. "
        "The state after each epoch is saved in FILE.npz.checkpoint; an interrupted run is resumed from it when it is "
        "repeated, and it is removed at the end.",
        "the prior, for `nablahog invert --prior` and `nablahog table1 --prior`",
        _prior,
        descriptor=None,
    ),
    "background": Kind(
        "mean and covariance of descriptors of photographs, from which the elements of objects stand out",
        "Learns the mean of a descriptor and the covariance of its cells at each offset, over all photographs and "
        "their scales: the background from which the elements of an object stand out.",
        "the background",
        _background,
        "aubry",
        "; not paper, which is normalised globally",
    ),
    "hoggles": Kind(
        "the paired dictionaries of HOGgles, for `nablahog table1 --hoggles`",
        "Learns a dictionary of windows of descriptors together with one of their gray patches, as Vondrick et al. do. "
        "With the published numbers it takes about a quarter of an hour.",
        "the dictionaries",
        _hoggles,
    ),
    "bovw": Kind(
        "visual words and their arrangements, for `nablahog table1 --bovw`",
        "Learns visual words, their gray patches and their arrangements from images of one size, which is the size of "
        "the images that can be reconstructed.",
        "the words",
        _bovw,
        descriptor=None,
        size=BOVW_SIZE,
    ),
}
"""By name: what ``nablahog learn`` learns from photographs."""


def learn(commands: argparse._SubParsersAction[Parser]) -> None:
    """Adds ``nablahog learn`` and all its kinds."""
    command = commands.add_parser(
        "learn",
        help="learn from photographs",
        description="Learns models from photographs that help to invert descriptors, or to find poses.",
    )
    kinds = command.add_subparsers(metavar="WHAT", required=True, parser_class=Parser)
    for name, kind in KINDS.items():
        _add(kinds.add_parser(name, help=kind.help, description=kind.description), name, kind)
    exemplars(kinds)


def _add(command: Parser, name: str, kind: Kind) -> None:
    options.output(command, "FILE.npz", kind.output)
    options.images(command)
    kind.options(command)
    if kind.descriptor is not None:
        options.dialect(command, f"type of descriptor (default: {kind.descriptor}){kind.remark}")
        command.set_defaults(descriptor=kind.descriptor)
    options.size(command, kind.size)
    command.set_defaults(command=f"learn {name}", kind=name)
