"""The inputs of a command: photographs, descriptor files and arrays of other libraries, read and checked."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..hog.descriptor import makes_colours_gray
from ..hog.spec import COLOURS
from ..invert import template_descriptor
from ..io.arrays import is_archive, is_raw, naming, refuse_pickle
from ..io.descriptor_file import load_descriptor
from ..io.dpm_file import is_dpm_file
from ..io.images import image_endings, longer_side, read_image
from ..io.input_file import InputFile
from ..io.pixels import MAX_IMAGE_BYTES
from ..requests.arrays import read_stored
from ..requests.dialect import Dialect
from ..requests.inversion import LONGER_SIDE, GlyphRequest, HogRequest
from ..requests.options import words
from ..requests.sources import STDIN, Source, from_photo, from_stored
from ..requests.templates import OPENCV_ENDINGS, is_opencv_file, read_templates
from ..runtime.extras import extra
from .input_files import DATASET, Inputs, expand
from .terminal import inform

if TYPE_CHECKING:
    from ..io.descriptor_dataset import DescriptorDataset

ARRAY_OPTIONS = ("image_size", "key", "row")  # of requests, about arrays of other libraries
SIGNS = {"positive": 1, "negative": -1}  # of the weights of a template
MADE_GRAY = (
    "colour photographs are made gray for this descriptor; scikit-image refuses them, or uses their colours: "
    "write --set channel_axis=-1 for that"
)


def _read_stdin() -> InputFile:
    if sys.stdin.isatty():
        raise ValueError("-: expected a file on stdin, got a terminal")
    content = sys.stdin.buffer.read(MAX_IMAGE_BYTES + 1)
    if not 0 < len(content) <= MAX_IMAGE_BYTES:
        got = "more" if content else "nothing"
        raise ValueError(f"-: expected a file of 1 … {MAX_IMAGE_BYTES:,} bytes on stdin, got {got}")
    return InputFile(STDIN, content)


def read_inputs(
    arguments: Namespace,
    request: HogRequest,
    *,
    keep_photos: bool = False,
    check: Callable[[Source], None] = lambda source: None,
    datasets: bool = False,
) -> Inputs:
    """Reads and checks the ``inputs`` of a command; computes the descriptors of the photographs among them.

    After the last one, lines on stderr say whether photographs were shrunk to a size that speed asks for, and whether
    colours were lost that scikit-image uses.

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
    array_endings = [".npz", *([".npy", ".mat"] if request.preset else [])] if isinstance(request, GlyphRequest) else []
    expanded = expand(files, arguments, {*image_endings(), *array_endings})
    expanded.skipping.count += sum(map(len, data))
    reader = _Reader(request)

    def read(file: InputFile, stem: str) -> list[Source]:
        sources = reader.read(file, stem)
        for source in sources:
            check(source)
        return [source if keep_photos else replace(source, photo=None) for source in sources]

    def read_all() -> Iterator[Source]:
        array_option = next((name for name in ARRAY_OPTIONS if getattr(request, name, None) is not None), None)
        readable = read_files(expanded, read)
        yield from readable if array_option is None else _with_array(readable, reader, array_option)
        if reader.shrunk:
            which = "1 photograph is" if reader.shrunk == 1 else f"{reader.shrunk} photographs are"
            inform(f"{which} shrunk to {LONGER_SIDE} pixels; --size 0 keeps the full size")
        if reader.loses_colours:
            inform(MADE_GRAY)

    many, sources = expanded.many or bool(data), read_all()
    if not many and isinstance(request, GlyphRequest):  # one file, which may hold a matrix
        descriptors = list(sources)
        many, sources = len(descriptors) > 1, iter(descriptors)
    return replace(expanded, many=many, sources=sources, datasets=data)


def read_files(expanded: Inputs, read: Callable[[InputFile, str], list[Source]]) -> Iterator[Source]:
    """The sources of all files by ``read``, called with each file and its stem; skips files that it cannot read."""
    for path, stem in zip(expanded.paths, expanded.stems, strict=True):
        sources: list[Source] = []
        with expanded.skipping.guard(path):
            sources = read(_read_stdin() if path == STDIN else InputFile(path), stem)
        yield from sources
    expanded.skipping.check()


def _with_array(sources: Iterable[Source], reader: _Reader, option: str) -> list[Source]:
    """All sources, read at once; raises ValueError if none is an array, which the option is about."""
    readable = list(sources)
    if not reader.arrays:
        raise ValueError(
            f"--{option.replace('_', '-')} goes with arrays of other libraries, but no input is one (.npy, .npz, .mat)"
        )
    return readable


def _dataset(name: str, dialect: Dialect) -> DescriptorDataset:
    """A data set of descriptors; raises ValueError if there is none, or its spec contradicts the dialect."""
    with extra("dataset", "a data set of descriptors"):
        from ..io.descriptor_dataset import DescriptorDataset
    data = DescriptorDataset(name)
    with naming(Path(name)):
        dialect.check(data.spec)
    return data


@dataclass
class _Reader:
    """Reads inputs; counts arrays, and photographs that were shrunk for speed; knows whether any lost its colours."""

    request: HogRequest
    arrays: int = 0
    shrunk: int = 0
    loses_colours: bool = False

    def read(self, file: InputFile, stem: str) -> list[Source]:
        request = self.request
        refuse_pickle(file)
        if isinstance(request, GlyphRequest) and is_raw(file):
            if is_dpm_file(file):
                raise ValueError(f"{file}: expected a descriptor, got a detector: see `nablahog invert --template`")
            self.arrays += 1
            return self._read_array(file, stem, request)
        if is_archive(file):
            stored = load_descriptor(file)
            with naming(file):
                request.check(stored.spec)
            return [from_stored(file.name, stem, stored)]
        try:
            photo = read_image(file, request.size)
        except ValueError as error:
            if not isinstance(request, GlyphRequest) or file.ending in image_endings():
                raise
            if is_opencv_file(file):
                raise ValueError(
                    f"{file}: expected a photograph or descriptor; `nablahog invert --template` reads a "
                    "HOGDescriptor that OpenCV saved with its detector, no SVM of cv2.ml"
                ) from None
            raise ValueError(f"{error}; arrays are read from .npy, .npz and .mat files") from None
        shrunk = longer_side(file) > max(photo.shape)
        self.shrunk += shrunk and request.size == LONGER_SIDE
        self.loses_colours |= len(photo) == COLOURS and makes_colours_gray(request.spec)
        return [from_photo(file.name, stem, photo, request.spec, size=request.size, shrunk=shrunk)]

    @staticmethod
    def _read_array(file: InputFile, stem: str, request: GlyphRequest) -> list[Source]:
        """The descriptors in an array, one or those of its rows; a line on stderr says what decided which they are."""
        descriptors = read_stored(file, request)
        first, advice, remark = descriptors[0], descriptors[0].advice, ""
        if first.decided_by:
            asked = " ".join(words(replace(first.request, row=None), GlyphRequest))
            inform(f"{file}: {asked}, because {first.decided_by}")
        if advice is not None:
            write = f": write {' '.join(words(advice.request, GlyphRequest))}" if advice.request else ""
            remark = f"{advice.remark}{write}"
        sources = []
        for descriptor in descriptors:
            row = descriptor.request.row
            source = from_stored(file.name, f"{stem}_{row:06d}" if len(descriptors) > 1 else stem, descriptor.stored)
            sources.append(replace(source, part="" if row is None else f"row {row}", remark=remark))
        if remark:
            inform(f"{file}: {remark}")
        return sources


def read_template_inputs(arguments: Namespace, request: GlyphRequest) -> Inputs:
    """The templates in the ``inputs`` of a command, each as two sources: its weights, and their negatives."""
    expanded = expand(arguments.inputs, arguments, (".mat", ".npy", ".npz", ".gz", *OPENCV_ENDINGS[:3]))

    def read(file: InputFile, stem: str) -> list[Source]:
        return [
            _signed(template, f"{stem}_{number}" if template.part else stem, sign)
            for number, template in enumerate(read_templates(file, request), start=1)
            for sign in SIGNS
        ]

    return replace(expanded, many=True, sources=read_files(expanded, read))


def _signed(template: Source, stem: str, sign: str) -> Source:
    """Raises ValueError if the template has no weights of this sign."""
    template_descriptor(template.descriptor[None], template.spec, template.image_size, negative=sign == "negative")
    part = f"{template.part}, {sign} weights" if template.part else f"{sign} weights"
    return replace(template, stem=f"{stem}_{sign}", descriptor=SIGNS[sign] * template.descriptor, part=part)
