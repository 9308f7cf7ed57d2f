"""The arguments of ``nablahog app``."""

from __future__ import annotations

import argparse

from . import options
from .options import Parser

PORT = 8765
LAST_PORT = 65535


def app(commands: argparse._SubParsersAction[Parser]) -> None:
    """Adds ``nablahog app``."""
    command = commands.add_parser(
        "app",
        help="a page in the browser to see, invert and fit",
        description="Starts a page on this machine: see the HOG of a photograph, watch its pre-image grow, turn a "
        "model until it fits. Nothing leaves the machine. Needs the extra nablahog[app].",
    )
    command.add_argument("photos", nargs="*", metavar="PHOTO", help="photographs to begin with")
    options.number(
        command,
        "--port",
        f"of the page, 0 for any that is free (default: {PORT})",
        least=0,
        most=LAST_PORT,
        default=PORT,
    )
    command.add_argument(
        "--host",
        default="127.0.0.1",
        help="address to listen at (default: %(default)s, this machine alone); at any other, the page's address has a "
        "secret token",
    )
    command.add_argument("-q", "--quiet", action="store_true", help="print nothing but errors")
    command.set_defaults(command="app")
