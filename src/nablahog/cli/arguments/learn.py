"""The arguments of ``nablahog learn``."""

from __future__ import annotations

import argparse

from . import options
from .options import Parser
from .preset_parameters import DEFAULT_PRESET

BOVW_SIZE = 128  # that of the images of Table 1
KINDS = ("prior", "background", "hoggles", "bovw")
"""What ``nablahog learn`` learns from photographs."""

_HELP = {
    "prior": "the images to expect for a descriptor, for `nablahog invert --prior`",
    "background": "mean and covariance of descriptors, for estimate_pose(background=…)",
    "hoggles": "the paired dictionaries of HOGgles, for Table 1",
    "bovw": "visual words and their arrangements, for Table 1",
}
_DESCRIPTIONS = {
    "prior": "Trains a network to predict an image from its descriptor: near the mean of all photographs that have it. "
    "Runs on a GPU if there is one. The state after each epoch is saved in FILE.npz.checkpoint; an interrupted run is "
    "resumed from it when it is repeated, and it is removed at the end.",
    "background": "Learns the mean of a descriptor and the covariance of its cells at each offset, over all "
    "photographs and their scales: the background from which the elements of an object stand out.",
    "hoggles": "Learns a dictionary of windows of descriptors together with one of their gray patches, as Vondrick et "
    "al. do. This takes about half an hour on one core.",
    "bovw": "Learns visual words, their gray patches and their arrangements from images of one size, which is the size "
    "of the images that can be reconstructed.",
}
_OUTPUTS = {"prior": "the prior", "background": "the background", "hoggles": "the dictionaries", "bovw": "the words"}


def learn(commands: argparse._SubParsersAction[Parser]) -> None:
    """Adds ``nablahog learn`` and all its kinds."""
    command = commands.add_parser(
        "learn",
        help="learn from photographs",
        description="Learns models from photographs that help to invert descriptors, or to find poses.",
    )
    kinds = command.add_subparsers(metavar="WHAT", required=True, parser_class=Parser)
    for kind in KINDS:
        parser = kinds.add_parser(kind, help=_HELP[kind], description=_DESCRIPTIONS[kind])
        options.output(parser, "FILE.npz", _OUTPUTS[kind])
        options.images(parser)
        if kind == "prior":
            _prior(parser)
        if kind in ("background", "hoggles"):
            options.preset(parser, "aubry" if kind == "background" else DEFAULT_PRESET)
        if kind == "bovw":
            options.size(parser, BOVW_SIZE)
        if kind in ("background", "bovw"):
            options.cluster(parser)
        if kind in ("hoggles", "bovw"):
            options.seed(parser)
        parser.set_defaults(command=f"learn {kind}", kind=kind)


def _prior(command: argparse.ArgumentParser) -> None:
    signs = "for all descriptors of signed gradients, such as uoctti, or of unsigned ones, such as paper"
    options.choice(command, "--signs", ("signed", "unsigned"), signs)
    start = "go on from this prior; 'default' is the one that comes with nablahog"
    options.file(command, "--start", "FILE", start)
    options.number(command, "--epochs", "passes over the images (default: as many as take an hour or two on two cores)")
