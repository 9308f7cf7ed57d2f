"""Ctrl-C while the command imports its modules."""

from __future__ import annotations

import os
import signal
from contextlib import suppress
from types import FrameType
from typing import NoReturn

INTERRUPTED = 130  # what shells report of a command ended by Ctrl-C


def end_at_interrupt() -> None:
    """From now on Ctrl-C ends the process at once, unless it is ignored or handled by others.

    Nothing is lost before work begins.  KeyboardInterrupt, raised somewhere in an import, may be caught there, and come
    out later as another error of a module that is half imported.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)


def raise_at_interrupt() -> None:
    """From now on Ctrl-C raises KeyboardInterrupt again."""
    if signal.getsignal(signal.SIGINT) is _end:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _end(number: int, frame: FrameType | None) -> NoReturn:
    with suppress(OSError):  # stderr may be closed, and Python's own stream in use
        os.write(2, b"nablahog: error: interrupted\n")
    os._exit(INTERRUPTED)
