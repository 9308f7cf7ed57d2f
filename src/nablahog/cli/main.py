"""The command ``nablahog``: reads and checks all inputs, does the work, writes the results."""

from __future__ import annotations

import argparse
import io
import logging
import os
import sys
from collections.abc import Sequence
from functools import cache
from importlib import import_module
from typing import NoReturn, TextIO

from ..requests.options import integer
from ..runtime.extras import INSTALL_COMMANDS
from ..runtime.text import MOST_ERROR_CHARACTERS, one_line
from .arguments import options
from .arguments.options import Parser
from .arguments.parsers import KINDS, demo, glyph, hog, invert, learn, pose, table1, table2
from .errors import WRONG_ARGUMENTS, WrongArguments, tell, word_error
from .interruption import INTERRUPTED, raise_at_interrupt

PORT = 8765
LAST_PORT = 65535
_COMMANDS = {
    "hog": ".commands.hog",
    "glyph": ".commands.hog",
    "invert": ".commands.invert",
    "demo": ".commands.demo",
    "table1": ".commands.tables",
    "table2": ".commands.tables",
    "pose": ".commands.pose",
    **{f"learn {kind}": ".commands.learn" for kind in KINDS},
    "app": ".commands.app",
}
"""The module of each command, imported when it is run, as most import PyTorch; it has a function of its name."""


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
    command = commands.add_parser(
        "app",
        help="a page in the browser to see, invert and fit",
        description="Starts a page on this machine: see the HOG of a photograph, watch its pre-image grow, turn a "
        "model until it fits. Nothing leaves the machine. Needs some packages: "
        f"{INSTALL_COMMANDS['app']}.",
    )
    command.add_argument("photos", nargs="*", metavar="PHOTO", help="photographs to begin with")
    options.add(command, "--port", integer(0, LAST_PORT), "port of the page; 0 takes a free one", PORT)
    command.add_argument(
        "--host",
        default="127.0.0.1",
        help="address to listen at (default: %(default)s, this machine only); with any other, the page's address "
        "contains a secret token",
    )
    command.add_argument("-q", "--quiet", action="store_true", help="print nothing but errors")
    command.set_defaults(command="app")


@cache
def _null_device() -> TextIO:
    """What is written there is lost; open as long as the process is."""
    return open(os.devnull, "w", encoding="utf-8")


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command with ``argv``, by default the arguments of this process.

    Returns:
        The exit status: 0; 1 after an error, which one line on stderr names; 2 for arguments that are wrong or do not
        go together; 3 when some inputs were skipped, each with a line on stderr, and the others done; 4 when the
        confidence of a pose is too low; 130 when interrupted.
    """
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed, or of a program without a console
            setattr(sys, name, _null_device())
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # file names and units need not fit the terminal's encoding
    whole = parser()
    if "_ARGCOMPLETE" in os.environ:  # the shell asks for completions
        import argcomplete

        argcomplete.autocomplete(whole)
    try:
        arguments = whole.parse_args(argv)
    except SystemExit as stop:  # --help, --version or wrong arguments: argparse has printed
        return int(stop.code or 0)
    command: str = arguments.command
    if sys.stderr.isatty() and not arguments.quiet:
        _show_log()
    try:
        from .terminal import be_quiet  # loads rich

        be_quiet(arguments.quiet)
        run = getattr(import_module(_COMMANDS[command], __package__), command.split()[0])
        raise_at_interrupt()  # from here on results may be half done
        status = run(arguments)
        sys.stdout.flush()  # a closed pipe should fail here, not at exit
    except KeyboardInterrupt as stop:
        return _failed(command, "; ".join(["interrupted", *map(str, stop.args)]), INTERRUPTED)
    except BrokenPipeError:
        # the reader has closed the pipe; Python would fail again when it flushes stdout at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except (ValueError, OSError) as error:
        return _failed(command, word_error(error), WRONG_ARGUMENTS if isinstance(error, WrongArguments) else 1)
    except (MemoryError, RuntimeError) as error:
        if not isinstance(error, MemoryError) and "memory" not in str(error):
            raise
        return _failed(command, "not enough memory; a smaller --size, or fewer inputs at once, need less")
    return int(status or 0)


class _ToStderr(logging.Handler):
    """Prints to the present sys.stderr, which progress bars replace."""

    def emit(self, record: logging.LogRecord) -> None:
        print(f"nablahog: {one_line(record.getMessage(), MOST_ERROR_CHARACTERS)}", file=sys.stderr)


def _show_log() -> None:
    """Shows what the package logs, such as the address of a cluster's dashboard."""
    logger = logging.getLogger(__package__.partition(".")[0])
    if not logger.handlers:
        logger.addHandler(_ToStderr())
        logger.setLevel(logging.INFO)


def _failed(command: str, message: str, status: int = 1) -> int:
    tell(command, f"error: {message}")
    return status
