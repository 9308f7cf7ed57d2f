"""Output files and folders: written whole or not at all."""

from __future__ import annotations

import hashlib
import io
import itertools
import os
import re
import secrets
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO, TypeAlias

MAX_STEM_BYTES = 180  # file systems allow 255 for a name; endings need some of them
PART = ".part"
ABANDONED = 86_400  # seconds: longer than a host stalls or two hosts' clocks differ

Writable: TypeAlias = str | os.PathLike[str] | BinaryIO
"""Where files are written: a path, or a stream such as standard output."""


@contextmanager
def replacing(path: Writable) -> Iterator[BinaryIO]:
    """A binary file that becomes ``path`` when the block ends, and vanishes when the block fails.

    Written beside ``path`` and renamed at the end: a reader sees the old file or the new one, never a part.  To a
    stream it is written at the end.

    Raises:
        TypeError: ``path`` is neither a path nor a binary stream.
        FileExistsError: ``path`` is a folder or a device.
        OSError: the folder does not exist or cannot be written, or the disk is full; its ``filename`` is ``path``.
    """
    if not isinstance(path, str | bytes | os.PathLike):
        if not hasattr(path, "write") or isinstance(path, io.TextIOBase):
            raise TypeError(f"a file to write must be a path or a binary stream, got {type(path).__name__}")
        memory = io.BytesIO()
        yield memory
        path.write(memory.getvalue())
        return
    path = Path(os.path.realpath(os.fsdecode(path)))  # a link keeps its target
    if path.exists() and not path.is_file():
        raise FileExistsError(f"{path} cannot be written: it is not a regular file")
    # a random name: in containers and on other hosts, process numbers repeat
    part = path.with_name(f".nablahog-{secrets.token_hex(8)}{PART}")
    try:
        try:
            part.touch(exist_ok=False)  # not mkstemp, whose files only their owner may read
            with open(part, "wb") as file:
                yield file
            os.replace(part, path)
        except BaseException:
            with suppress(OSError):  # the first error is the one to report
                part.unlink(missing_ok=True)
            raise
    except OSError as error:
        if error.errno is not None and error.filename in (None, str(part)):
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise


def natural_order(name: str) -> list[str | int]:
    """A key to sort names by as people do: 2.png before 10.png."""
    return [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", name)]


def local_name(name: str) -> str:
    """A file's name in a text as this system's functions take it: in UTF-8 where the locale lacks its letters."""
    try:
        os.fsencode(name)
    except UnicodeEncodeError:
        return os.fsdecode(name.encode(errors="surrogateescape"))
    return name


def check_folder(folder: Path, expected: str) -> None:
    """Raises FileNotFoundError or NotADirectoryError unless it is a folder; ``expected`` is such as "images"."""
    if not folder.exists():
        raise FileNotFoundError(f"{folder}: no such folder")
    if not folder.is_dir():
        raise NotADirectoryError(f"{folder}: expected a folder of {expected}, got a file")


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Writes a text file in UTF-8, whole or not at all; characters that UTF-8 lacks are written as escapes."""
    with replacing(path) as file:
        file.write(text.encode(errors="backslashreplace"))


def remove_parts(folder: Path) -> None:
    """Removes the temporary files in ``folder`` that :func:`replacing` left when its process was killed.

    These are the files that nobody has written to for :data:`ABANDONED` seconds: a younger one may be of a process that
    is at work now, here or on another host.
    """
    for part in folder.glob(f".nablahog-*{PART}"):
        with suppress(OSError):
            if time.time() - part.stat().st_mtime > ABANDONED:
                part.unlink()


@contextmanager
def checkpoint_for(output: Path) -> Iterator[Path]:
    """The checkpoint file of a long computation, beside ``output``; removed when the block succeeds.

    Temporary files of earlier runs are removed first.
    """
    remove_parts(output.parent)
    checkpoint = output.with_name(f"{output.name}.checkpoint")
    yield checkpoint
    checkpoint.unlink(missing_ok=True)


@contextmanager
def output_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """The folder ``path``: made and tried before the block starts, removed if the block fails and leaves it empty.

    Temporary files of earlier runs are removed first (:func:`remove_parts`).

    Raises:
        NotADirectoryError: ``path``, or a folder above it, is a file.
        PermissionError: the folder cannot be made or written.
    """
    path = Path(path)
    above = [path, *path.parents]
    missing = list(itertools.takewhile(lambda folder: not os.path.lexists(folder), above))
    existing = above[len(missing)] if len(missing) < len(above) else path
    if not existing.is_dir():
        raise NotADirectoryError(f"the output folder {path} cannot be made: {existing} is not a folder")
    try:
        path.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path).close()  # permission bits tell less than a try
    except OSError as error:
        _remove_empty(missing)
        raise PermissionError(f"the output folder {path} cannot be written: {error.strerror}") from None
    remove_parts(path)
    try:
        yield path
    except BaseException:
        _remove_empty(missing)
        raise


def _remove_empty(folders: Sequence[Path]) -> None:
    with suppress(OSError):  # stops at the first folder that is not empty
        for folder in folders:
            folder.rmdir()


def distinct_stems(paths: Sequence[Path]) -> list[str]:
    """The stems of ``paths``; where different files have the same, each with a hash of its path: ``a_0f3c91d2``, ``b``.

    A hash, unlike a number, does not depend on the other paths: a file keeps its own when others come or go.  A file
    that is listed twice has a number, ``b_2``.  Stems that differ only in case count as the same, as they are on some
    file systems; very long ones are cut.
    """
    stems = [_shorten(path.stem) or "input" for path in paths]
    counts = Counter(stem.casefold() for stem, _ in {*zip(stems, map(os.path.abspath, paths), strict=True)})
    taken: set[str] = set()
    result = []
    for stem, path in zip(stems, paths, strict=True):
        name = stem if counts[stem.casefold()] == 1 else f"{stem}_{_hash_of_path(path)}"
        numbered = (f"{name}_{number}" for number in itertools.count(2))
        free = (each for each in numbered if each.casefold() not in taken and each.casefold() not in counts)
        result.append(next(free) if name.casefold() in taken else name)
        taken.add(result[-1].casefold())
    return result


def _hash_of_path(path: Path) -> str:
    """Eight digits, the same for all spellings of a path that are absolute or relative to the working directory."""
    return hashlib.sha256(os.fsencode(os.path.abspath(path))).hexdigest()[:8]


def _shorten(stem: str) -> str:
    """The first :data:`MAX_STEM_BYTES` of a name, in the encoding of file names."""
    first = os.fsencode(stem)[:MAX_STEM_BYTES]
    return first.decode(errors="ignore") if sys.getfilesystemencoding() == "utf-8" else os.fsdecode(first)


def forbid_overwrite(inputs: Iterable[str | os.PathLike[str]], targets: Iterable[Path]) -> None:
    """Raises ValueError if a result would be written to an input file."""
    read = {os.path.realpath(path) for path in inputs}
    for target in targets:
        if os.path.realpath(target) in read:
            raise ValueError(f"the result {target} would overwrite an input: expected another -o")
