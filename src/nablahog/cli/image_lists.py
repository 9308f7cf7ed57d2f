"""The images of a data set: files, folders, patterns, URLs, and lists of these."""

from __future__ import annotations

import glob
import itertools
import os
from argparse import Namespace
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.request import url2pathname

import fsspec

from ..io.arrays import naming
from ..io.dataset_manifest import ImageState
from ..io.files import local_name, natural_order
from ..io.images import image_endings
from ..runtime.errors import explain
from ..runtime.text import decode_text
from .errors import Skipping
from .input_files import expand, tell_of_subfolders

LIST = "@"
VERSIONS = ("ETag", "etag", "CRC", "mtime", "LastModified", "last_modified", "created")
"""What stores say of a file that changes with it, the surest first."""


def list_images(arguments: Namespace) -> tuple[list[ImageState], Skipping]:
    """All images among the ``inputs`` of a command, in order: of files and folders, then of URLs, then of lists.

    What stands for no image is skipped: a folder or pattern without any, and a store that cannot be opened.  A file
    that is not there counts as an image, whose row will say so.

    Raises:
        ValueError: there are no images, or a list cannot be read.
    """
    named = [_decode_file_url(name) for name in arguments.inputs if not name.startswith(LIST)]
    lists = [_read_lines(name[1:]) for name in arguments.inputs if name.startswith(LIST)]
    lines = [_decode_file_url(local_name(line)) for line in itertools.chain(*lists)]
    images: list[ImageState] = []
    skipping = Skipping(arguments.command, len(named) + len(lines))

    for name in sorted(named, key=lambda name: "://" in name):
        with skipping.guard(name):
            images += _list_store(name) if "://" in name else _expand(arguments, name)
    for line in lines:
        with skipping.guard(line):
            if "://" in line:  # signed URLs have question marks, which are no patterns
                images += _list_store(line) if "*" in line else [ImageState(line)]
            elif os.path.isdir(line) or glob.has_magic(line):
                images += _expand(arguments, line)
            else:
                images.append(_read_state(line))
    if not images:
        raise ValueError("there are no images among the inputs")
    return images, skipping


def _decode_file_url(name: str) -> str:
    """The path of a URL as ``Path.as_uri()`` writes it, if fsspec, which decodes none, finds no file; else itself."""
    path = name.removeprefix("file://").removeprefix("localhost")
    if "%" not in path or not name.startswith("file://") or "::" in name:
        return name

    def exists(pattern: str) -> bool:
        return os.path.lexists(pattern) or any(glob.iglob(pattern, recursive=True))

    decoded = url2pathname(path)
    return decoded if exists(decoded) and not exists(path) else name


def _expand(arguments: Namespace, name: str) -> list[ImageState]:
    return list(map(_read_state, expand([name], arguments, image_endings()).paths))


def _read_state(path: str) -> ImageState:
    """The state of a file of this machine; an unknown one if there is no such file, or it may not be read."""
    try:
        state = os.stat(path)
    except OSError:
        return ImageState(path)
    if not os.access(path, os.R_OK):
        return ImageState(path)
    return ImageState(path, state.st_size, str(state.st_mtime_ns))


def _read_lines(name: str) -> list[str]:
    """The entries of a list: lines without blanks and quotes around them; comments (#) and empty ones are left out."""
    try:
        lines = [line.strip() for line in decode_text(Path(name).read_bytes()).splitlines()]
    except (OSError, UnicodeDecodeError) as error:
        reason = explain(error).removeprefix(f"{name}: ")
        raise ValueError(f"{name}: expected a list of images, one per line: {reason}") from None
    lines = [line[1:-1] if len(line) > 1 and line[0] == line[-1] == '"' else line for line in lines]
    return [line for line in lines if line and not (line.startswith("#") and not os.path.exists(line))]


def _list_store(name: str) -> list[ImageState]:
    """The images of a URL: of a file, pattern or folder; each with the chain, as in ``zip://*.jpg::photos.zip``."""
    system, path = open_store(name)
    with naming(name):
        if glob.has_magic(path) and not system.exists(path):
            listed = {str(file): about for file, about in system.glob(path, detail=True).items()}
        elif system.isdir(path):
            listed = {str(about["name"]): about for about in system.ls(path, detail=True)}
            folders = [file for file, about in listed.items() if about.get("type") == "directory"]
            pattern = f"{path.rstrip('/')}/**/*.jpg" if path.strip("/") else "**/*.jpg"
            tell_of_subfolders(name, folders, _make_url(name, system, path, pattern))
        else:
            listed = {path: {}}
            with suppress(Exception):  # files that are not there, which their rows will say, and stores that don't tell
                listed = {path: system.info(path)}
        endings = image_endings()
        named = {*Path(path).parts}
        visible = (
            file for file in listed if not any(part.startswith(".") for part in Path(file).parts if part not in named)
        )
        files = sorted((file for file in visible if Path(file).suffix.lower() in endings), key=natural_order)
    return [_state_in_store(_make_url(name, system, path, file), listed[file]) for file in files]


def _make_url(name: str, system: Any, path: str, file: str) -> str:
    """The URL of a file that the URL ``name``, which has ``path`` in it, stands for."""
    links = name.split("::")
    if len(links) == 1:
        return str(system.unstrip_protocol(file))
    # in a chained URL, the part with the path: a cache uses the path of the store behind it
    at = next((k for k, link in enumerate(links) if link.partition("://")[2].strip("/") == path.strip("/")), 0)
    protocol = links[at].partition("://")[0]
    return "::".join([*links[:at], f"{protocol}://{file}", *links[at + 1 :]])


def _state_in_store(url: str, about: Mapping[str, Any]) -> ImageState:
    version = next((str(about[name]) for name in VERSIONS if about.get(name) is not None), None)
    return ImageState(url, about.get("size"), version)


def open_store(name: str) -> tuple[Any, str]:
    """The file system of fsspec that a URL or path is on, and its path there."""
    try:
        system, path = fsspec.core.url_to_fs(name)
    except Exception as error:  # archives and stores that cannot be opened raise nearly anything
        raise ValueError(f"{name}: {error}") from None
    return system, str(path)
