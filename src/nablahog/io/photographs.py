"""What Table 1 is made from: gray photographs of a folder, or those that scikit-image installs."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from torch import Tensor

from ..hog.gradient import gray
from ..runtime.errors import explain
from ..runtime.text import to_unicode
from .files import check_folder
from .images import SAMPLE_NAMES, image_endings, limit_size, read_image, sample_photograph


@dataclass
class Photographs:
    """Photographs (H, W) by name, float32 in 0…1, gray by Eq. 1; why others could not be read, by name.

    What is not an image file by its ending is ignored.  ``available`` counts all image files that there are.
    """

    images: dict[str, Tensor] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)
    ignored: list[str] = field(default_factory=list)
    available: int = 0

    @property
    def equally_large(self) -> bool:
        """Whether all have the same number of pixels."""
        return len({image.numel() for image in self.images.values()}) <= 1


def read_folder(folder: Path, *, size: int, limit: int | None = None, recursive: bool = False) -> Photographs:
    """The images of a folder, sorted by name.

    Files count as images if Pillow reads files of their ending.  Hidden files and folders are skipped.  Other folders
    are noted as ignored unless ``recursive``: then images in them count, too, with names like ``chairs/1.png``; links
    to folders are not followed.  The first ``limit`` images are read, and shrunk to at most ``size`` pixels on the
    longer side (0: not at all).

    Raises:
        FileNotFoundError, NotADirectoryError: there is no such folder.
        ValueError: it holds no image file.
    """
    check_folder(folder, "images")
    endings = image_endings()
    entries = sorted(_entries(folder, recursive))
    files = [entry for entry in entries if entry.suffix.lower() in endings and not entry.is_dir()]
    if not files:
        raise ValueError(f"{folder}: expected a folder of images, but it holds none{_advise(entries, endings)}")
    ignored = [_name(entry, folder) for entry in sorted(set(entries) - set(files))]
    result = Photographs(ignored=ignored, available=len(files))
    for path in files[:limit]:
        name = _name(path, folder)
        try:
            result.images[name] = _prepared(read_image(path, size), 0)
        except (OSError, ValueError) as error:
            result.failed[name] = explain(error).removeprefix(f"{path}: ")
    return result


def _entries(folder: Path, recursive: bool) -> Iterator[Path]:
    for entry in folder.iterdir():
        if entry.name.startswith("."):
            continue
        if recursive and entry.is_dir() and not entry.is_symlink():  # a link may lead back
            yield from _entries(entry, recursive)
        else:
            yield entry


def _advise(entries: Iterable[Path], endings: Collection[str]) -> str:
    """The first subfolder that has images, to be written instead."""
    for inner in entries:
        with suppress(OSError):  # it is no folder, or may not be read
            if any(path.suffix.lower() in endings for path in inner.iterdir()):
                return f", only its subfolders do: write {inner}"
    return ""


def sample_photographs(*, size: int, limit: int | None = None, whole: bool = False) -> Photographs:
    """The photographs :data:`SAMPLE_NAMES`, ``whole`` or their middle squares, otherwise as :func:`read_folder`."""
    photographs = {name: sample_photograph(name) for name in SAMPLE_NAMES[:limit]}
    images = {name: _prepared(p if whole else _square(p), size) for name, p in photographs.items()}
    return Photographs(images, available=len(SAMPLE_NAMES))


def _square(image: Tensor) -> Tensor:
    side = min(image.shape[1:])
    top, left = ((n - side) // 2 for n in image.shape[1:])
    return image[:, top : top + side, left : left + side]


def _prepared(image: Tensor, size: int) -> Tensor:
    small = limit_size(image, size) if size else image
    return gray(small[None])[0, 0].clamp(0, 1)  # the weights' sum may pass 1 by a rounding


def _name(path: Path, folder: Path) -> str:
    return to_unicode(path.relative_to(folder).as_posix())
