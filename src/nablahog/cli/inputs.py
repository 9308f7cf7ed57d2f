"""The inputs of a command: photographs, descriptor files and arrays of other libraries, read and checked."""

from __future__ import annotations

import glob
import os
import sys
from argparse import Namespace
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..hog.descriptor import makes_colours_gray
from ..hog.spec import COLOURS
from ..invert import template_descriptor
from ..io.arrays import is_archive, is_raw, naming, refuse_pickle
from ..io.descriptor_file import load_descriptor
from ..io.dpm_file import is_dpm_file
from ..io.files import distinct_stems, local_name, natural_order
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
from ..runtime.groups import split_by_weight
from ..runtime.text import counted
from .errors import Skipping, WrongArguments
from .terminal import inform

if TYPE_CHECKING:
    from ..io.descriptor_dataset import DescriptorDataset

DATASET = ".parquet"
ARRAY_OPTIONS = ("image_size", "key", "row")  # of requests, about arrays of other libraries
SIGNS = {"positive": 1, "negative": -1}  # of the weights of a template
MADE_GRAY = (
    "colour photographs are made gray for this descriptor; scikit-image refuses them, or uses their colours: "
    "write --set channel_axis=-1 for that"
)
ROWS_IN_MEMORY = 1000  # of a data set, at a time
ROW_BYTES = 1 << 28  # of their descriptors


def expand(names: Sequence[str], arguments: Namespace, endings: Collection[str]) -> Inputs:
    """The files that ``names`` stand for, in the inputs of a command.

    A folder stands for the files in it with one of the ``endings``, in natural order, without hidden files and
    subfolders; a pattern (``*``, ``?``, ``[…]``, ``**``) for the files that match, unless it is the name of a file.
    """
    paths: list[str] = []
    empty: list[tuple[str, str]] = []
    if names.count(STDIN) > 1:
        raise WrongArguments("stdin can be read once: expected one - among the inputs")
    for name in names:
        if os.path.isdir(name):
            if os.path.realpath(name) == os.path.realpath(arguments.output):
                raise ValueError(f"results in the folder {name} would be its inputs next time: expected another -o")
            items = list(os.scandir(name))
            files = _select_files(items, endings)
            folders = [item.path for item in items if item.is_dir()]
            own = os.path.realpath(arguments.output)
            others = [folder for folder in folders if os.path.realpath(folder) != own]
            tell_of_subfolders(name, others, os.path.join(glob.escape(name), "**", "*.jpg"))
            array_endings = sorted({*endings} - image_endings())
            kinds = ", ".join((["images"] if len(array_endings) < len(endings) else []) + array_endings)
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
        with skipping.guard(name):
            raise ValueError(f"{name}: {reason}")
    return Inputs(paths, skipping, many=len(names) > 1 or paths != [*names])


def tell_of_subfolders(name: str, folders: Iterable[str], pattern: str) -> None:
    """A line on stderr if some of a folder's subfolders are neither hidden nor data sets.

    Args:
        name: of the folder.
        folders: the paths of its subfolders.
        pattern: what takes the files in them, too.
    """
    names = sorted((Path(folder).name for folder in folders), key=natural_order)
    left_out = [folder for folder in names if not folder.startswith(".") and not folder.endswith(DATASET)]
    if left_out:
        count = counted(len(left_out), "subfolder")
        inform(f"{name}: {count} left out, such as {left_out[0]}: a pattern takes them, '{pattern}'")


def _select_files(items: Iterable[os.DirEntry[str]], endings: Collection[str]) -> list[str]:
    visible = (entry for entry in items if not entry.name.startswith(".") and not entry.is_dir())
    return sorted((each.path for each in visible if Path(each.name).suffix.lower() in endings), key=natural_order)


def _read_stdin() -> InputFile:
    if sys.stdin.isatty():
        raise ValueError("-: expected a file on stdin, got a terminal")
    content = sys.stdin.buffer.read(MAX_IMAGE_BYTES + 1)
    if not 0 < len(content) <= MAX_IMAGE_BYTES:
        got = "more" if content else "nothing"
        raise ValueError(f"-: expected a file of 1 … {MAX_IMAGE_BYTES:,} bytes on stdin, got {got}")
    return InputFile(STDIN, content)


@dataclass(frozen=True)
class Inputs:
    """The inputs of a command: files, or :data:`STDIN`, and what is read.

    Attributes:
        many: whether results go to a folder: those of several inputs, of a folder or pattern, even for one file, or of
            the rows of a matrix.
        sources: of files, each read when it is its turn, once: descriptors of many photographs may not fit in memory.
        datasets: their rows are read when needed.
    """

    paths: list[str]
    skipping: Skipping
    many: bool
    sources: Iterator[Source] = field(default_factory=lambda: iter(()))
    datasets: list[DescriptorDataset] = field(default_factory=list)

    @property
    def stems(self) -> list[str]:
        """The stem of each file, with which the names of its results begin."""
        return distinct_stems([Path("stdin" if path == STDIN else path) for path in self.paths])

    def rows(self, check: Callable[[Source], None]) -> Iterator[list[Source]]:
        """The sources of data sets that ``check`` allows, as many at a time as fit in memory."""
        for data in self.datasets:
            numbered = split_by_weight(
                enumerate(data), lambda item: item[1].bytes, most=ROW_BYTES, count=ROWS_IN_MEMORY
            )
            for rows in numbered:
                sources = []
                for number, row in rows:
                    with self.skipping.guard(row.path):
                        if row.stored is None:
                            raise ValueError(f"{row.path}: {row.error}")
                        source = from_stored(row.path, f"{number:06d}_{local_name(Path(row.path).stem)}", row.stored)
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
        found = read_files(expanded, read)
        yield from found if array_option is None else _with_array(found, reader, array_option)
        if reader.shrunk:
            which = "1 photograph is" if reader.shrunk == 1 else f"{reader.shrunk} photographs are"
            inform(f"{which} shrunk to {LONGER_SIDE} pixels; --size 0 keeps the full size")
        if reader.loses_colours:
            inform(MADE_GRAY)

    many, sources = expanded.many or bool(data), read_all()
    if not many and isinstance(request, GlyphRequest):  # one file, which may hold a matrix
        found = list(sources)
        many, sources = len(found) > 1, iter(found)
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
    found = list(sources)
    if not reader.arrays:
        raise ValueError(
            f"--{option.replace('_', '-')} goes with arrays of other libraries, but no input is one (.npy, .npz, .mat)"
        )
    return found


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
                    f"{file}: expected a photograph or descriptor; `nablahog invert --template` reads what OpenCV's "
                    "HOGDescriptor saved"
                ) from None
            raise ValueError(
                f"{error}; arrays are read from .npy, .npz and .mat files (of a table of numbers, numpy.save('m.npy', "
                "numpy.loadtxt('m.csv', delimiter=',')) writes one)"
            ) from None
        shrunk = longer_side(file) > max(photo.shape)
        self.shrunk += shrunk and request.size == LONGER_SIDE
        self.loses_colours |= len(photo) == COLOURS and makes_colours_gray(request.spec)
        return [from_photo(file.name, stem, photo, request.spec, size=request.size, shrunk=shrunk)]

    @staticmethod
    def _read_array(file: InputFile, stem: str, request: GlyphRequest) -> list[Source]:
        """The descriptors in an array, one or those of its rows; a line on stderr says what decided which they are."""
        found = read_stored(file, request)
        if found[0].decided_by:
            asked = " ".join(words(replace(found[0].request, row=None), GlyphRequest))
            inform(f"{file}: {asked}, because {found[0].decided_by}")
        advice = found[0].advice
        if advice is not None:
            asked = " ".join(words(advice.request, GlyphRequest))
            inform(f"{file}: {advice.remark}: write {asked}")
        sources = []
        for each in found:
            row = each.request.row
            source = from_stored(file.name, f"{stem}_{row:06d}" if len(found) > 1 else stem, each.stored)
            sources.append(source if row is None else replace(source, part=f"row {row}"))
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
    weights = SIGNS[sign] * template.descriptor
    template_descriptor(weights[None], template.spec, template.image_size)
    part = f"{template.part}, {sign} weights" if template.part else f"{sign} weights"
    return replace(template, stem=f"{stem}_{sign}", descriptor=weights, part=part)
