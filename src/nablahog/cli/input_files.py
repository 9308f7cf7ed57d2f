"""The files and data sets among the inputs of a command."""

from __future__ import annotations

import glob
import os
from argparse import Namespace
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from ..io.files import distinct_stems, local_name, natural_order
from ..io.images import image_endings
from ..requests.sources import STDIN, Source, from_stored
from ..runtime.groups import split_by_weight
from ..runtime.text import counted
from .errors import Skipping, WrongArguments
from .terminal import inform

if TYPE_CHECKING:
    from ..io.descriptor_dataset import DescriptorDataset

DATASET = ".parquet"
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
            matching = (path for path in glob.iglob(name, recursive=True) if os.path.isfile(path))
            files = sorted(matching, key=natural_order)
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
