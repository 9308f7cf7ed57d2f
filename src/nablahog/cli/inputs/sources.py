"""What the command line works on: photographs and descriptor files, read and checked."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from ...hog import HOGSpec, hog
from ...io.arrays import is_raw
from ...io.descriptor_file import StoredDescriptor, is_descriptor_file, load_descriptor
from ...io.files import distinct_stems
from ...io.images import limit_size, read_image
from ..errors import as_user_error
from .arrays import ArrayOptions
from .spec import SpecOptions


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


def read_sources(
    paths: Sequence[str],
    wanted: SpecOptions,
    *,
    size: int,
    device: torch.device,
    keep_photos: bool,
    raw: ArrayOptions | None = None,
) -> list[Source]:
    """Reads and checks all inputs, computing the descriptors of the photographs among them.

    Args:
        paths: photographs, of any format Pillow reads, descriptor files, and arrays of other libraries.
        wanted: the spec for photographs and arrays, and what descriptor files must not contradict.
        size: photographs are shrunk to at most so many pixels on the longer side; 0 leaves them as they are.
        device: where descriptors are computed.
        keep_photos: whether the photographs are needed afterwards.
        raw: what was said of arrays; None if these are not wanted.

    Returns:
        One source for each path, in order.

    Raises:
        ValueError, FileNotFoundError: the first input that is wrong, with its path.
    """
    sources, arrays = [], 0
    for path, stem in zip(paths, distinct_stems([Path(path) for path in paths]), strict=True):
        if raw is not None and is_raw(path):
            sources.append(_from_stored(path, stem, raw.read(path, wanted)))
            arrays += 1
        elif is_descriptor_file(path):
            sources.append(_from_descriptor_file(path, stem, wanted))
        else:
            photo = read_image(path)
            sources.append(from_photo(path, stem, photo, wanted.spec(), size=size, device=device))
            if not keep_photos:
                sources[-1] = replace(sources[-1], photo=None)
    if raw is not None and not arrays:
        raw.check_unused()
    return sources


def sources_of(arguments: Namespace) -> list[Source]:
    """What :func:`read_sources` reads for a command with ``inputs`` and the options of their dialect and size.

    Raises:
        UserError: an input or an option is unusable.
        OSError: a file is missing.
    """
    with as_user_error():
        return read_sources(
            arguments.inputs,
            SpecOptions.of(arguments),
            size=arguments.size,
            device=torch.device(arguments.device),
            keep_photos=arguments.command == "invert",
            raw=None if arguments.command == "hog" else ArrayOptions.of(arguments),
        )


def _from_descriptor_file(path: str, stem: str, wanted: SpecOptions) -> Source:
    stored = load_descriptor(path)
    try:
        wanted.check(stored.spec)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return _from_stored(path, stem, stored)


def _from_stored(path: str, stem: str, stored: StoredDescriptor) -> Source:
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
