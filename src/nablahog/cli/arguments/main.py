"""The arguments of the command ``nablahog``."""

from __future__ import annotations

import argparse
from typing import NoReturn

from ...evaluate.names import DIALECTS, TABLE1
from ...pose.choices import ORDER
from ..inputs.preset_parameters import DEFAULT_DESCRIPTOR
from . import options
from .dialects import dialects
from .invert_template import invert_template
from .options import Parser, integer
from .pose import exemplars, pose, table2

SIZE = 256
TABLE1_SIZE = 128  # that of the paper's images
LEARN_SIZE = 512
MOST_THREADS = 1024
MOST_ORDER = 100


class _Version(argparse.Action):
    """As argparse's own, but it asks for the version when it is wanted: that takes as long as all the rest."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: object, option: object = None
    ) -> NoReturn:
        from importlib.metadata import version

        print(f"nablahog {version('nablahog')}")
        parser.exit()


def parser() -> argparse.ArgumentParser:
    """The parser of the command; the name of the subcommand is its ``command``."""
    top = Parser(
        prog="nablahog",
        description="HOG descriptors of photographs, and photographs from HOG descriptors.",
        epilog="`nablahog COMMAND --help` lists the options of a command.",
    )
    top.add_argument(
        "--version", action=_Version, nargs=0, default=argparse.SUPPRESS, help="show program's version number and exit"
    )
    commands = top.add_subparsers(dest="command", metavar="COMMAND", required=True, parser_class=Parser)

    hog = commands.add_parser(
        "hog",
        help="compute the descriptors of photographs",
        description="Computes the HOG descriptor of each photograph and saves it with its spec.",
    )
    hog.add_argument("inputs", nargs="+", metavar="PHOTO", help="an image of any format that Pillow reads")
    options.output(hog, "FILE", "descriptor file (.npz) of one photograph; of several, a folder for one file each")
    options.common(hog, 0)

    glyph = commands.add_parser(
        "glyph",
        help="draw descriptors",
        description="Draws each descriptor as glyphs: in each cell, strokes along its edges.",
    )
    options.inputs(glyph)
    options.output(
        glyph, "FILE", "PNG file for one input; any name that does not end in .png is a folder for one file each"
    )
    options.common(glyph, SIZE)

    invert = commands.add_parser(
        "invert",
        help="find images that have given descriptors",
        description="Finds, for each descriptor, an image that has it, and compares it with the photograph if known. "
        "Leaves <stem>_preimage.png, _glyphs.png and _thumbnails.png in the folder, and results.json.",
    )
    options.inputs(invert)
    options.output(invert, "DIR", "folder for the results, made if missing")
    options.common(invert, SIZE)
    options.minimiser(invert)
    options.quality(invert)
    options.prior(invert, "for descriptors of the spec that it was learned for")
    invert.add_argument(
        "--colour",
        action="store_true",
        help="find images in colour, for descriptors that read colour; which colours is a guess, as they do not say",
    )

    invert_template(commands)

    demo = commands.add_parser(
        "demo",
        help="invert a photograph that comes with scikit-image",
        description="Inverts both descriptors of one photograph and writes pictures, figures and a page to look at.",
    )
    options.output(demo, "DIR", "folder for the results, made if missing")
    options.device_option(demo)
    options.minimiser(demo)

    table1 = commands.add_parser(
        "table1",
        help="compare all methods on a folder of images",
        description="Inverts the descriptors of all images by all methods of the paper's Table 1 and writes the table: "
        "index.html to look at, summary.csv, per_image.csv, times.csv and failures.csv. A run that was interrupted "
        "goes on when it is repeated.",
    )
    options.images(table1)
    options.table(table1, TABLE1, {"dialects": DIALECTS})
    table1.add_argument("--limit", type=integer(1), metavar="N", help="only the first N images")
    options.size(table1, TABLE1_SIZE)
    options.minimiser(table1)
    options.prior(table1, "needed by, and only by, uoctti-learned")
    for kind in ("bovw", "hoggles", "ridge", "nearest"):
        text = f"what `nablahog learn {kind}` wrote, for the method {kind}"
        default = "default: learned once from photographs that come with scikit-image"
        table1.add_argument(f"--{kind}", metavar="FILE", help=f"{text} ({default})")

    pose(commands)
    table2(commands)
    dialects(commands)

    learn = commands.add_parser(
        "learn",
        help="learn from photographs",
        description="Learns from photographs what helps to invert descriptors, or to find poses.",
    )
    kinds = learn.add_subparsers(metavar="WHAT", required=True, parser_class=Parser)
    _learn_prior(kinds)
    _learn_background(kinds)
    _learn_hoggles(kinds)
    _learn_bovw(kinds)
    _learn_ridge(kinds)
    _learn_nearest(kinds)
    exemplars(kinds)
    return top


def _learn_prior(kinds: argparse._SubParsersAction[Parser]) -> None:
    prior = kinds.add_parser(
        "prior",
        help="what photographs look like, given a descriptor, for --prior",
        description="Teaches a network which image to expect for a descriptor: near the mean of all photographs that "
        "have it. What is learned is kept in FILE.npz.checkpoint after each epoch, so a run that was interrupted goes "
        "on when it is repeated; that file is removed at the end.",
    )
    prior.set_defaults(command="learn prior")
    options.output(prior, "FILE.npz", "the prior, for `nablahog invert --prior` and `nablahog table1 --prior`")
    options.images(prior)
    prior.add_argument(
        "--epochs",
        type=integer(1),
        metavar="N",
        help="passes over the images (default: as many as take about an hour and a half on one core)",
    )
    options.seed(prior)
    prior.add_argument(
        "--threads",
        type=integer(1, MOST_THREADS),
        metavar="N",
        help="to compute in (default: one for each core); another number rounds otherwise",
    )
    options.dialect(prior, f"type of descriptor (default: {DEFAULT_DESCRIPTOR})")
    options.size(prior, LEARN_SIZE)


def _learn_background(kinds: argparse._SubParsersAction[Parser]) -> None:
    background = kinds.add_parser(
        "background",
        help="what descriptors of photographs are like anywhere, to tell from it what stands out",
        description="Learns the mean of a descriptor, and how its cells depend on each other at each offset, over all "
        "photographs and their scales: the background from which the elements of an object stand out.",
    )
    background.set_defaults(command="learn background")
    options.output(background, "FILE.npz", "the background")
    options.images(background)
    background.add_argument(
        "--order",
        type=integer(0, MOST_ORDER),
        default=ORDER,
        metavar="N",
        help=f"the largest offset in cells; elements may have a row and a column more (default: {ORDER})",
    )
    options.dialect(background, "type of descriptor (default: aubry); not paper, which is normalised globally")
    background.set_defaults(descriptor="aubry")
    options.size(background, LEARN_SIZE)


def _learn_hoggles(kinds: argparse._SubParsersAction[Parser]) -> None:
    hoggles = kinds.add_parser(
        "hoggles",
        help="the paired dictionaries of HOGgles, for `nablahog table1 --hoggles`",
        description="Learns a dictionary of windows of descriptors with the gray patches that they come from, as "
        "Vondrick et al. do. What is learned is kept in FILE.npz.checkpoint now and then, so a run that was "
        "interrupted goes on when it is repeated; that file is removed at the end.",
    )
    hoggles.set_defaults(command="learn hoggles")
    options.output(hoggles, "FILE.npz", "the dictionaries")
    options.images(hoggles)
    hoggles.add_argument("--fast", action="store_true", help="random windows as atoms, instead of learning any")
    options.seed(hoggles)
    options.dialect(hoggles, f"type of descriptor (default: {DEFAULT_DESCRIPTOR})")
    options.size(hoggles, LEARN_SIZE)


def _learn_bovw(kinds: argparse._SubParsersAction[Parser]) -> None:
    bovw = kinds.add_parser(
        "bovw",
        help="visual words and how they are arranged, for `nablahog table1 --bovw`",
        description="Learns visual words, what they look like and where they are beside which others, from images of "
        "one size, which is that of the images that can be found by it.",
    )
    bovw.set_defaults(command="learn bovw")
    options.output(bovw, "FILE.npz", "the words")
    options.images(bovw)
    options.seed(bovw)
    options.size(bovw, TABLE1_SIZE)


def _learn_ridge(kinds: argparse._SubParsersAction[Parser]) -> None:
    ridge = kinds.add_parser(
        "ridge",
        help="a linear way back from descriptors to images, for `nablahog table1 --ridge`",
        description="Learns each patch of an image as the linear function of the window of the descriptor around it "
        "that misses it least.",
    )
    ridge.set_defaults(command="learn ridge")
    _from_windows(ridge, "the regression")


def _learn_nearest(kinds: argparse._SubParsersAction[Parser]) -> None:
    nearest = kinds.add_parser(
        "nearest",
        help="a database of windows, for `nablahog table1 --nearest`",
        description="Keeps photographs; the patches of an image are then the means of those that these have under the "
        "most similar windows of their descriptors.",
    )
    nearest.set_defaults(command="learn nearest")
    _from_windows(nearest, "the database")


def _from_windows(command: Parser, what: str) -> None:
    options.output(command, "FILE.npz", what)
    options.images(command)
    options.seed(command)
    options.dialect(command, f"type of descriptor (default: {DEFAULT_DESCRIPTOR})")
    options.size(command, LEARN_SIZE)
