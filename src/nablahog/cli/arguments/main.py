"""The arguments of the command ``nablahog``."""

from __future__ import annotations

import argparse
from typing import NoReturn

from .app import app
from .invert import demo, glyph, hog, invert
from .learn import learn
from .options import Parser
from .pose import pose
from .tables import table1, table2


class _Version(argparse.Action):
    """Like argparse's own action, but reads the version only when asked: that takes as long as all the rest."""

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
    for add in (hog, glyph, invert, demo, table1, pose, table2, learn, app):
        add(commands)
    return top
