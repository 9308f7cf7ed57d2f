"""What is drawn or inverted: a descriptor with its spec, from a photograph or a file."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import torch
from torch import Tensor

from ..hog import HOGSpec
from ..hog.descriptor import describe
from ..hog.gradient import gray
from ..io.descriptor_file import StoredDescriptor
from ..io.images import limit_size
from ..runtime.text import to_unicode

STDIN = "-"


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
        remark: what its numbers say against what was asked for, as a clause; empty if nothing.
    """

    path: str
    stem: str
    descriptor: Tensor
    spec: HOGSpec
    image_size: tuple[int, int]
    photo: Tensor | None
    part: str = ""
    remark: str = ""

    @property
    def name(self) -> str:
        """The name of the file without its folders, printable, and the part."""
        file = to_unicode(Path(self.path).name) if self.path != STDIN else "stdin"
        return f"{file}, {self.part}" if self.part else file

    @cached_property
    def gray_photo(self) -> Tensor | None:
        """The photograph in gray (Eq. 1), (H, W), if it is known."""
        return None if self.photo is None else gray(self.photo[None])[0, 0]


def from_stored(path: str, stem: str, stored: StoredDescriptor) -> Source:
    """A stored descriptor as a source; ValueError if it does not fit float32."""
    descriptor = stored.descriptor.float()
    if not torch.isfinite(descriptor).all():
        raise ValueError(
            f"{path}: the descriptor must fit float32, got the largest magnitude {stored.descriptor.abs().max():g}"
        )
    return Source(path, stem, descriptor, stored.spec, stored.image_size, None)


def from_photo(path: str, stem: str, photo: Tensor, spec: HOGSpec, *, size: int, shrunk: bool = False) -> Source:
    """Computes the descriptor of a photograph (C, H, W) in 0…1, shrunk to ``size`` pixels on the longer side.

    Without ``size`` it keeps its own; ``shrunk`` says that it was shrunk before.  ValueError if it holds no cell.
    """
    small = limit_size(photo, size) if size else photo
    height, width = small.shape[-2:]
    try:
        spec.grid(height, width)
    except ValueError as error:
        how = f" after shrinking it to {size} pixels" if shrunk or small is not photo else ""
        raise ValueError(f"{path}: {error}{how}") from None
    return Source(path, stem, describe(small[None], spec)[0], spec, (height, width), small)
