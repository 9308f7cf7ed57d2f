"""What the command line works on: photographs and descriptor files, read and checked."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from .descriptor_file import is_descriptor_file, load_descriptor
from .hog import HOGSpec, hog, presets
from .hog.spec import Vote
from .images import limit_size, read_image
from .output import distinct_stems

PRESETS: dict[str, Callable[..., HOGSpec]] = {
    "paper": presets.paper,
    "uoctti": presets.uoctti,
    "aubry": presets.aubry,
}
DEFAULT_DESCRIPTOR, DEFAULT_CELL = "uoctti", (8, 8)


@dataclass(frozen=True)
class Source:
    """One input, ready to be drawn or inverted.

    Attributes:
        path: as the user gave it.
        stem: for the names of result files; no two sources have the same.
        descriptor: (rows, cols, channels), float32, on the CPU.
        spec: its dialect.
        image_size: (height, width) of the image the descriptor was computed from.
        photo: that image, (C, H, W) float32 in 0…1, or None for a descriptor file.
    """

    path: str
    stem: str
    descriptor: Tensor
    spec: HOGSpec
    image_size: tuple[int, int]
    photo: Tensor | None


@dataclass(frozen=True)
class Wanted:
    """The conventions a user asked for; None where nothing was said.

    Attributes:
        descriptor: a key of :data:`PRESETS`.
        cell: (height, width) of a cell in pixels.
        vote: orientation votes, for ``"uoctti"`` and ``"aubry"`` only.
    """

    descriptor: str | None = None
    cell: tuple[int, int] | None = None
    vote: Vote | None = None

    @classmethod
    def of(cls, arguments: Namespace) -> Wanted:
        """By the options ``--descriptor``, ``--cell`` and ``--vote``."""
        return cls(arguments.descriptor, arguments.cell, arguments.vote)

    def __post_init__(self) -> None:
        if self.vote == "hard" and (self.descriptor or DEFAULT_DESCRIPTOR) == "paper":
            raise ValueError("the paper's descriptor has linear votes; --vote hard goes with --descriptor uoctti")

    def spec(self) -> HOGSpec:
        """The spec for photographs: what was asked for, completed by the defaults."""
        name, cell = self.descriptor or DEFAULT_DESCRIPTOR, self.cell or DEFAULT_CELL
        if name == "paper":
            return presets.paper(cell)
        return PRESETS[name](cell, vote=self.vote or "linear")

    def check(self, spec: HOGSpec) -> None:
        """Raises ValueError if ``spec``, that of a descriptor file, contradicts what was asked for."""
        asked = {"cell_size": self.cell, "vote": self.vote}
        wanted = vars(self.spec()) if self.descriptor else {}
        wanted = {**{k: v for k, v in wanted.items() if k not in asked}, **{k: v for k, v in asked.items() if v}}
        differing = [field for field, value in wanted.items() if getattr(spec, field) != value]
        if any(field != "name" for field in differing):  # the name itself decides nothing, but says it best
            field = differing[0]
            raise ValueError(
                f"a descriptor of another spec than asked for: its {field} is {getattr(spec, field)!r}, "
                f"not {wanted[field]!r}"
            )


def read_sources(
    paths: Sequence[str], wanted: Wanted, *, size: int, device: torch.device, keep_photos: bool
) -> list[Source]:
    """Reads and checks all inputs, computing the descriptors of the photographs among them.

    Args:
        paths: photographs, of any format Pillow reads, and descriptor files.
        wanted: the spec for photographs, and what descriptor files must not contradict.
        size: photographs are shrunk to at most so many pixels on the longer side; 0 leaves them as they are.
        device: where descriptors are computed.
        keep_photos: whether the photographs are needed afterwards.

    Returns:
        One source for each path, in order.

    Raises:
        ValueError, FileNotFoundError: the first input that is wrong, with its path.
    """
    sources = []
    for path, stem in zip(paths, distinct_stems([Path(path) for path in paths]), strict=True):
        if is_descriptor_file(path):
            sources.append(_from_descriptor_file(path, stem, wanted))
        else:
            photo = read_image(path)
            sources.append(from_photo(path, stem, photo, wanted.spec(), size=size, device=device))
            if not keep_photos:
                sources[-1] = replace(sources[-1], photo=None)
    return sources


def _from_descriptor_file(path: str, stem: str, wanted: Wanted) -> Source:
    stored = load_descriptor(path)
    try:
        wanted.check(stored.spec)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    descriptor = stored.descriptor.float()
    if not torch.isfinite(descriptor).all():
        raise ValueError(
            f"{path}: the descriptor must fit float32, its largest magnitude is {stored.descriptor.abs().max():g}"
        )
    return Source(path, stem, descriptor, stored.spec, stored.image_size, None)


def from_photo(path: str, stem: str, photo: Tensor, spec: HOGSpec, *, size: int, device: torch.device) -> Source:
    """A photograph (C, H, W) in 0…1, shrunk as in :func:`read_sources`, with its descriptor.

    Raises:
        ValueError: it is then smaller than a cell; the message begins with ``path``.
    """
    small = limit_size(photo, size) if size else photo
    height, width = small.shape[-2:]
    try:
        spec.grid(height, width)
    except ValueError as error:
        shrunk = "" if small is photo else f" after shrinking it to {size} pixels"
        raise ValueError(f"{path}: {error}{shrunk}") from None
    descriptor = hog(small[None].to(device), spec)[0].cpu()
    return Source(path, stem, descriptor, spec, (height, width), small)
