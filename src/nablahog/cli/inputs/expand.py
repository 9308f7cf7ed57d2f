"""Inputs by name: files, folders, patterns that the shell did not expand, and ``-`` for stdin."""

from __future__ import annotations

import glob
import os
import sys
import tempfile
from argparse import Namespace
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ...io.pixels import MAX_BYTES
from ..errors import Skipping, UserError

STDIN = "-"


@dataclass(frozen=True)
class Expanded:
    """The inputs of a command.

    Attributes:
        paths: of files, in order; :data:`STDIN` is one.
        skipping: has the folders and patterns without a file, and later the files that are unusable.
        many: whether results go to a folder: there are several inputs, or a folder or a pattern, even of one file.
    """

    paths: list[str]
    skipping: Skipping
    many: bool


def expand(arguments: Namespace, endings: Collection[str]) -> Expanded:
    """The files that ``arguments.inputs`` stand for.

    A folder stands for the files in it with one of the ``endings``, sorted by name, without hidden files and
    subfolders; a pattern (``*``, ``?``, ``[…]``, ``**``) for the files that match, unless it is the name of a file.
    """
    paths: list[str] = []
    empty: list[tuple[str, str]] = []
    named = list(arguments.inputs)
    if named.count(STDIN) > 1:
        raise UserError("stdin can be read once: expected one - among the inputs")
    for name in named:
        if os.path.isdir(name):
            if os.path.realpath(name) == os.path.realpath(arguments.output):
                raise UserError(f"results in the folder {name} would be its inputs next time: expected another -o")
            files = _files(os.scandir(name), endings)
            reason = f"expected a file, or a folder of files of these kinds: {', '.join(sorted(endings))}"
        elif glob.has_magic(name) and not os.path.lexists(name):
            files = sorted(path for path in glob.iglob(name, recursive=True) if os.path.isfile(path))
            reason = "no file matches this pattern"
        else:
            files, reason = [name], ""
        paths += files
        if not files:
            empty.append((name, reason))
    skipping = Skipping(arguments.command, len(paths) + len(empty))
    for name, reason in empty:
        with skipping.each(name):
            raise ValueError(f"{name}: {reason}")
    return Expanded(paths, skipping, many=len(named) > 1 or paths != named)


def _files(entries: Iterator[os.DirEntry[str]], endings: Collection[str]) -> list[str]:
    return sorted(
        entry.path
        for entry in entries
        if not entry.name.startswith(".") and Path(entry.name).suffix.lower() in endings and not entry.is_dir()
    )


@contextmanager
def stdin_as_file() -> Iterator[str]:
    """The name of a temporary file that holds all of stdin; errors of the block name stdin instead."""
    if sys.stdin.isatty():
        raise ValueError("-: expected a file on stdin, got a terminal")
    with tempfile.NamedTemporaryFile(prefix="nablahog-stdin-") as file:
        size = file.write(sys.stdin.buffer.read(MAX_BYTES + 1))
        file.flush()
        if not size or size > MAX_BYTES:
            got = "nothing" if not size else "more"
            raise ValueError(f"-: expected a file of 1 … {MAX_BYTES:,} bytes on stdin, got {got}")
        try:
            yield file.name
        except (ValueError, OSError) as error:
            raise ValueError(str(error).replace(file.name, STDIN)) from None
