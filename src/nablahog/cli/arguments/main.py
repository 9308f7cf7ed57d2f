"""The arguments of the command ``nablahog``."""

from __future__ import annotations

import argparse
from typing import NoReturn

from . import options
from .invert import demo, glyph, hog, invert
from .learn import learn
from .options import Parser
from .pose import pose
from .tables import table1, table2

PORT = 8765
LAST_PORT = 65535


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


def app(commands: argparse._SubParsersAction[Parser]) -> None:
    """Adds ``nablahog app``."""
    command = commands.add_parser(
        "app",
        help="a page in the browser to see, invert and fit",
        description="Starts a page on this machine: see the HOG of a photograph, watch its pre-image grow, turn a "
        "model until it fits. Nothing leaves the machine. Needs the extra nablahog[app].",
    )
    command.add_argument("photos", nargs="*", metavar="PHOTO", help="photographs to begin with")
    port = f"of the page, 0 for any that is free (default: {PORT})"
    options.number(command, "--port", port, least=0, most=LAST_PORT, default=PORT)
    command.add_argument(
        "--host",
        default="127.0.0.1",
        help="address to listen at (default: %(default)s, this machine alone); at any other, the page's address has a "
        "secret token",
    )
    command.add_argument("-q", "--quiet", action="store_true", help="print nothing but errors")
    command.set_defaults(command="app")
