"""The arguments of the command ``nablahog``."""

from __future__ import annotations

import argparse
from typing import NoReturn

from ...evaluate.names import DIALECTS, TABLE1
from . import options
from .dialects import dialects
from .invert_template import invert_template
from .learn import KINDS, learn
from .options import Parser, integer
from .pose import pose, table2

SIZE = 256
TABLE1_SIZE = 128  # that of the paper's images


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
    for kind in (method for method in TABLE1 if method in KINDS):
        text = f"what `nablahog learn {kind}` wrote, for the method {kind}"
        default = "default: learned once from photographs that come with scikit-image"
        table1.add_argument(f"--{kind}", metavar="FILE", help=f"{text} ({default})")

    pose(commands)
    table2(commands)
    dialects(commands)

    learn(commands)
    return top
