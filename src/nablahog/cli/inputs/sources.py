"""The inputs of a command: photographs, descriptor files and arrays of other libraries, read and checked."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from ...hog import HOGSpec
from ...hog.descriptor import describe
from ...io.arrays import is_raw
from ...io.descriptor_file import StoredDescriptor, is_descriptor_file, load_descriptor
from ...io.files import distinct_stems
from ...io.images import limit_size, read_image
from ...io.npz import naming
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


def read_sources(arguments: Namespace, *, arrays: bool = True, keep_photos: bool = False) -> list[Source]:
    """Reads and checks the ``inputs`` of a command; computes the descriptors of the photographs among them.

    Args:
        arguments: ``inputs``: photographs of any format that Pillow reads, descriptor files, arrays of other libraries;
            the options of their dialect; ``size``: photographs are shrunk to at most so many pixels on the longer side,
            0 for never; ``device``: computes the descriptors.
        arrays: whether inputs may be arrays of other libraries.
        keep_photos: whether the photographs are needed afterwards.

    Returns:
        One source for each input, in order.

    Raises:
        UserError: an option, or the first input that is wrong, with its path.
        OSError: a file is missing.
    """
    with as_user_error():
        spec_options = SpecOptions.of(arguments)
        array_options = ArrayOptions.of(arguments) if arrays else None
        stems = distinct_stems([Path(path) for path in arguments.inputs])
        sources, no_array = [], True
        for path, stem in zip(arguments.inputs, stems, strict=True):
            if array_options is not None and is_raw(path):
                source = _from_stored(path, stem, array_options.read(path, spec_options))
                no_array = False
            elif is_descriptor_file(path):
                source = _from_descriptor_file(path, stem, spec_options)
            else:
                photo, device = read_image(path), torch.device(arguments.device)
                source = from_photo(path, stem, photo, spec_options.spec(), size=arguments.size, device=device)
            sources.append(source if keep_photos else replace(source, photo=None))
        if array_options is not None and no_array:
            array_options.check_unused()
    return sources


def _from_descriptor_file(path: str, stem: str, options: SpecOptions) -> Source:
    of_file = load_descriptor(path)
    with naming(path):
        options.check(of_file.spec)
    return _from_stored(path, stem, of_file)


def _from_stored(path: str, stem: str, of_file: StoredDescriptor) -> Source:
    descriptor = of_file.descriptor.float()
    if not torch.isfinite(descriptor).all():
        raise ValueError(
            f"{path}: the descriptor must fit float32, its largest magnitude is {of_file.descriptor.abs().max():g}"
        )
    return Source(path, stem, descriptor, of_file.spec, of_file.image_size, None)


def from_photo(path: str, stem: str, photo: Tensor, spec: HOGSpec, *, size: int, device: torch.device) -> Source:
    """Computes the descriptor of a photograph (C, H, W) in 0…1, shrunk as in :func:`read_sources`.

    Raises:
        ValueError: the shrunk photograph is smaller than a cell; the message begins with ``path``.
    """
    small = limit_size(photo, size) if size else photo
    height, width = small.shape[-2:]
    try:
        spec.grid(height, width)
    except ValueError as error:
        shrunk = "" if small is photo else f" after shrinking it to {size} pixels"
        raise ValueError(f"{path}: {error}{shrunk}") from None
    descriptor = describe(small[None].to(device), spec)[0].cpu()
    return Source(path, stem, descriptor, spec, (height, width), small)
