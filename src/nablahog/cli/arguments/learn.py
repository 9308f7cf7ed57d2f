"""The arguments of ``nablahog learn``."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import NamedTuple

from . import options
from .options import Parser
from .preset_parameters import DEFAULT_PRESET

BOVW_SIZE = 128  # that of the images of Table 1
SIGNS = ("signed", "unsigned")


class Kind(NamedTuple):
    """The arguments for a kind of model.

    Attributes:
        help: one line.
        description: what is learned.
        output: what the output file is.
        options: adds its own options.
    """

    help: str
    description: str
    output: str
    options: Callable[[argparse.ArgumentParser], None]


def _prior(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--signs",
        choices=SIGNS,
        default=SIGNS[0],
        help="for all descriptors of signed gradients, such as uoctti, or of unsigned ones, such as paper "
        "(default: %(default)s)",
    )
    command.add_argument(
        "--start", metavar="FILE", help="go on from this prior; 'default' is the one that comes with nablahog"
    )
    options.number(command, "--epochs", "passes over the images (default: as many as take an hour or two on two cores)")


def _background(command: argparse.ArgumentParser) -> None:
    options.preset(command, "aubry")
    options.cluster(command)


def _hoggles(command: argparse.ArgumentParser) -> None:
    options.preset(command, DEFAULT_PRESET)
    options.seed(command)


def _bovw(command: argparse.ArgumentParser) -> None:
    options.size(command, BOVW_SIZE)
    options.cluster(command)
    options.seed(command)


KINDS = {
    "prior": Kind(
        "the images to expect for a descriptor, for `nablahog invert --prior`",
        "Trains a network to predict an image from its descriptor: near the mean of all photographs that have it. Runs "
        "on a GPU if there is one. The state after each epoch is saved in FILE.npz.checkpoint; an interrupted run is "
        "resumed from it when it is repeated, and it is removed at the end.",
        "the prior",
        _prior,
    ),
    "background": Kind(
        "mean and covariance of descriptors, for estimate_pose(background=…)",
        "Learns the mean of a descriptor and the covariance of its cells at each offset, over all photographs and "
        "their scales: the background from which the elements of an object stand out.",
        "the background",
        _background,
    ),
    "hoggles": Kind(
        "the paired dictionaries of HOGgles, for Table 1",
        "Learns a dictionary of windows of descriptors together with one of their gray patches, as Vondrick et al. do. "
        "This takes about half an hour on one core.",
        "the dictionaries",
        _hoggles,
    ),
    "bovw": Kind(
        "visual words and their arrangements, for Table 1",
        "Learns visual words, their gray patches and their arrangements from images of one size, which is the size of "
        "the images that can be reconstructed.",
        "the words",
        _bovw,
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
        parser = kinds.add_parser(name, help=kind.help, description=kind.description)
        options.output(parser, "FILE.npz", kind.output)
        options.images(parser)
        kind.options(parser)
        parser.set_defaults(command=f"learn {name}", kind=name)
