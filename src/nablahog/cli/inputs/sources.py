"""The inputs of a command: photographs, descriptor files and arrays of other libraries, read and checked."""

from __future__ import annotations

import glob
import os
import sys
from argparse import Namespace
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from ...hog import HOGSpec
from ...hog.descriptor import describe
from ...hog.gradient import gray
from ...io.arrays import is_archive, is_raw, naming
from ...io.descriptor_file import StoredDescriptor, load_descriptor
from ...io.dpm_file import is_dpm_file
from ...io.files import distinct_stems, local_name, natural_order
from ...io.images import image_endings, limit_size, longer_side, read_image
from ...io.input_file import InputFile
from ...io.pixels import MAX_BYTES
from ...requests.arrays import read_stored
from ...requests.dialect import Dialect
from ...requests.inversion import LONGER_SIDE, GlyphRequest, HogRequest
from ...runtime.extras import extra
from ...runtime.text import unicode_of
from ..errors import Skipping
from ..terminal import inform

if TYPE_CHECKING:
    from ...io.descriptor_dataset import DescriptorDataset

STDIN = "-"
DATASET = ".parquet"
ROWS = 1000  # of a data set, in memory at a time


def expand(names: Sequence[str], arguments: Namespace, endings: Collection[str]) -> Inputs:
    """The files that ``names`` stand for, in the inputs of a command.

    A folder stands for the files in it with one of the ``endings``, in natural order, without hidden files and
    subfolders; a pattern (``*``, ``?``, ``[…]``, ``**``) for the files that match, unless it is the name of a file.
    """
    paths: list[str] = []
    empty: list[tuple[str, str]] = []
    if names.count(STDIN) > 1:
        raise ValueError("stdin can be read once: expected one - among the inputs")
    for name in names:
        if os.path.isdir(name):
            if os.path.realpath(name) == os.path.realpath(arguments.output):
                raise ValueError(f"results in the folder {name} would be its inputs next time: expected another -o")
            files = _files(os.scandir(name), endings)
            others = sorted({*endings} - image_endings())
            kinds = ", ".join((["images"] if len(others) < len(endings) else []) + others)
            reason = f"expected a file, or a folder of files of these kinds: {kinds}"
        elif glob.has_magic(name) and not os.path.lexists(name):
            found = (path for path in glob.iglob(name, recursive=True) if os.path.isfile(path))
            files = sorted(found, key=natural_order)
            reason = "no file matches this pattern"
        elif ("://" in name or name.startswith("@")) and not os.path.lexists(name):
            files, reason = [], f"expected a file: URLs and lists are read by `nablahog hog … -o NAME{DATASET}`"
        else:
            files, reason = [name], ""
        paths += files
        if not files:
            empty.append((name, reason))
    skipping = Skipping(arguments.command, len(paths) + len(empty))
    for name, reason in empty:
        with skipping.each(name):
            raise ValueError(f"{name}: {reason}")
    return Inputs(paths, skipping, many=len(names) > 1 or paths != [*names])


def _files(entries: Iterator[os.DirEntry[str]], endings: Collection[str]) -> list[str]:
    visible = (entry for entry in entries if not entry.name.startswith(".") and not entry.is_dir())
    return sorted((each.path for each in visible if Path(each.name).suffix.lower() in endings), key=natural_order)


def _read_stdin() -> InputFile:
    if sys.stdin.isatty():
        raise ValueError("-: expected a file on stdin, got a terminal")
    content = sys.stdin.buffer.read(MAX_BYTES + 1)
    if not 0 < len(content) <= MAX_BYTES:
        got = "more" if content else "nothing"
        raise ValueError(f"-: expected a file of 1 … {MAX_BYTES:,} bytes on stdin, got {got}")
    return InputFile(STDIN, content)


@dataclass(frozen=True)
class Source:
    """One input, ready to be drawn or inverted.

    Attributes:
        path: as the user gave it.
        stem: begins the names of its result files; no two sources have the same.
        descriptor: (rows, cols, channels), float32, on the CPU.
        spec: of the descriptor.
        image_size: (height, width) of the image the descriptor was computed from.
        photo: that image, (C, H, W) float32 in 0…1, or None for a descriptor file.
        part: which one of several in the file, for captions.
    """

    path: str
    stem: str
    descriptor: Tensor
    spec: HOGSpec
    image_size: tuple[int, int]
    photo: Tensor | None
    part: str = ""

    @property
    def name(self) -> str:
        """The name of the file without its folders, printable, and the part."""
        file = unicode_of(Path(self.path).name) if self.path != STDIN else "stdin"
        return f"{file}, {self.part}" if self.part else file

    @cached_property
    def gray_photo(self) -> Tensor | None:
        """The photograph in gray (Eq. 1), (H, W), if it is known."""
        return None if self.photo is None else gray(self.photo[None])[0, 0]


@dataclass(frozen=True)
class Inputs:
    """The inputs of a command: files, or :data:`STDIN`, and what is read; rows of data sets are read when needed.

    ``many``: whether results go to a folder: those of several inputs, of a folder, or of a pattern, even for one file.
    """

    paths: list[str]
    skipping: Skipping
    many: bool
    sources: list[Source] = field(default_factory=list)
    datasets: list[DescriptorDataset] = field(default_factory=list)

    def parts(self, check: Callable[[Source], None]) -> Iterator[list[Source]]:
        """The sources of files, then those of data sets that ``check`` allows, :data:`ROWS` at a time."""
        if self.sources:
            yield self.sources
        for data in self.datasets:
            for first in range(0, len(data), ROWS):
                sources = []
                for number, row in enumerate(data[first : first + ROWS], start=first):
                    with self.skipping.each(row.path):
                        if row.stored is None:
                            raise ValueError(f"{row.path}: {row.error}")
                        source = _from_stored(row.path, f"{number:06d}_{local_name(Path(row.path).stem)}", row.stored)
                        check(source)
                        sources.append(source)
                if sources:
                    yield sources


def read_inputs(
    arguments: Namespace,
    request: HogRequest,
    *,
    keep_photos: bool = False,
    check: Callable[[Source], None] = lambda source: None,
    datasets: bool = False,
) -> Inputs:
    """Reads and checks the ``inputs`` of a command; computes the descriptors of the photographs among them.

    A line on stderr says whether photographs were shrunk without being asked for.

    Args:
        arguments: of the command.
        request: which descriptors; of a :class:`.GlyphRequest`, inputs may be descriptors: files of this program, and
            arrays of other libraries.
        keep_photos: whether the photographs are needed afterwards.
        check: raises ValueError for sources that cannot be used.
        datasets: whether inputs may be data sets of descriptors.
    """
    sets = [name for name in arguments.inputs if datasets and name.rstrip("/").endswith(DATASET)]
    data = [_dataset(name, request) for name in sets]
    files = [name for name in arguments.inputs if name not in sets]
    others = [".npz", *([".npy", ".mat"] if request.preset else [])] if isinstance(request, GlyphRequest) else []
    expanded = expand(files, arguments, {*image_endings(), *others})
    expanded.skipping.count += sum(map(len, data))
    reader = _Reader(request)

    def read(file: InputFile, stem: str) -> list[Source]:
        source = reader.read(file, stem)
        check(source)
        return [source if keep_photos else replace(source, photo=None)]

    sources = read_each(expanded, read)
    if reader.shrunk:
        which = "1 photograph is" if reader.shrunk == 1 else f"{reader.shrunk} photographs are"
        inform(f"{which} shrunk to {LONGER_SIDE} pixels; --size 0 keeps the full size")
    if not reader.arrays:
        _check_no_array(request)
    return replace(expanded, many=expanded.many or bool(data), sources=sources, datasets=data)


def read_each(expanded: Inputs, read: Callable[[InputFile, str], list[Source]]) -> list[Source]:
    """The sources of all files by ``read``, called with each file and its stem; skips files that it cannot read."""
    stems = distinct_stems([Path("stdin" if path == STDIN else path) for path in expanded.paths])
    sources = []
    for path, stem in zip(expanded.paths, stems, strict=True):
        with expanded.skipping.each(path):
            sources += read(_read_stdin() if path == STDIN else InputFile(path), stem)
    expanded.skipping.check()
    return sources


def _check_no_array(request: HogRequest) -> None:
    """Raises ValueError if the request is about arrays."""
    for option in ("image_size", "key"):
        if getattr(request, option, None) is not None:
            raise ValueError(
                f"--{option.replace('_', '-')} goes with arrays of other libraries, but no input is one "
                "(.npy, .npz, .mat)"
            )


def _dataset(name: str, dialect: Dialect) -> DescriptorDataset:
    """A data set of descriptors; raises ValueError if there is none, or its spec contradicts the dialect."""
    with extra("dataset", "a data set of descriptors"):
        from ...io.descriptor_dataset import DescriptorDataset
    data = DescriptorDataset(name)
    with naming(Path(name)):
        dialect.check(data.spec)
    return data


@dataclass
class _Reader:
    """Reads inputs; counts arrays, and photographs that were shrunk without being asked for."""

    request: HogRequest
    arrays: int = 0
    shrunk: int = 0

    def read(self, file: InputFile, stem: str) -> Source:
        request = self.request
        if isinstance(request, GlyphRequest) and is_raw(file):
            if is_dpm_file(file):
                raise ValueError(f"{file}: expected a descriptor, got a detector: see `nablahog invert --template`")
            self.arrays += 1
            return _from_stored(file.name, stem, read_stored(file, request))
        if is_archive(file):
            stored = load_descriptor(file)
            with naming(file):
                request.check(stored.spec)
            return _from_stored(file.name, stem, stored)
        try:
            photo = read_image(file, request.longer_side)
        except ValueError as error:
            if not isinstance(request, GlyphRequest) or file.ending in image_endings():
                raise
            raise ValueError(f"{error}; arrays are read from .npy, .npz and .mat files") from None
        shrunk = longer_side(file) > max(photo.shape)
        self.shrunk += shrunk and request.size is None
        return from_photo(file.name, stem, photo, request.spec, size=request.longer_side, shrunk=shrunk)


def _from_stored(path: str, stem: str, stored: StoredDescriptor) -> Source:
    descriptor = stored.descriptor.float()
    if not torch.isfinite(descriptor).all():
        raise ValueError(
            f"{path}: the descriptor must fit float32, got the largest magnitude {stored.descriptor.abs().max():g}"
        )
    return Source(path, stem, descriptor, stored.spec, stored.image_size, None)


def from_photo(path: str, stem: str, photo: Tensor, spec: HOGSpec, *, size: int, shrunk: bool = False) -> Source:
    """Computes the descriptor of a photograph (C, H, W) in 0…1, shrunk as in :func:`read_inputs`, or before."""
    small = limit_size(photo, size) if size else photo
    height, width = small.shape[-2:]
    try:
        spec.grid(height, width)
    except ValueError as error:
        how = f" after shrinking it to {size} pixels" if shrunk or small is not photo else ""
        raise ValueError(f"{path}: {error}{how}") from None
    return Source(path, stem, describe(small[None], spec)[0], spec, (height, width), small)
