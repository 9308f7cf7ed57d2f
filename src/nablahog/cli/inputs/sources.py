"""The inputs of a command: photographs, descriptor files and arrays of other libraries, read and checked."""

from __future__ import annotations

import math
from argparse import Namespace
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from ...hog import HOGSpec, hog
from ...io.arrays import Fit, fit, is_raw, is_row, read_array, shapes, stored
from ...io.descriptor_file import StoredDescriptor, is_descriptor_file, load_descriptor
from ...io.files import distinct_stems
from ...io.images import limit_size, read_image
from ...io.npz import naming
from ..arguments.preset_parameters import as_text, window_of
from ..errors import as_user_error
from .spec import SpecOptions
from .suggestions import parameters_that_fit, presets_that_fit


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
    descriptor = hog(small[None].to(device), spec)[0].cpu()
    return Source(path, stem, descriptor, spec, (height, width), small)


@dataclass(frozen=True)
class ArrayOptions:
    """The options that describe an array; None where an option is not set.

    Attributes:
        image_size: (height, width) in pixels of the images.
        key: the name of the array in files of several.
    """

    image_size: tuple[int, int] | None = None
    key: str | None = None

    @classmethod
    def of(cls, arguments: Namespace) -> ArrayOptions:
        """By the options ``--image-size`` and ``--key``."""
        return cls(arguments.image_size, arguments.key)

    def check_unused(self) -> None:
        """Raises ValueError if an option is set, for commands none of whose inputs is an array."""
        for option, value in (("--image-size", self.image_size), ("--key", self.key)):
            if value is not None:
                raise ValueError(
                    f"{option} goes with arrays of other libraries, and no input is one (.npy, .npz, .mat)"
                )

    def read(self, path: str, options: SpecOptions) -> StoredDescriptor:
        """The descriptor in a .npy, .npz or .mat file.

        Raises:
            FileNotFoundError: there is no such file.
            ValueError: it holds no such array, or one that is no descriptor of the dialect; the message suggests
                parameters that fit.
        """
        array = read_array(path, self.key)
        with naming(path):
            return stored(array, *self.fitting(array.shape, options))

    def fitting(self, shape: tuple[int, ...], options: SpecOptions) -> tuple[HOGSpec, Fit]:
        """How an array of this shape is a descriptor of the dialect in ``options``.

        Raises:
            ValueError: it is none, or there is no ``--preset``; the message suggests options.
        """
        if options.descriptor is None:
            others = presets_that_fit(shape, None, self.image_size)
            raise ValueError(
                f"an array does not say of which library it is: expected --preset NAME{_suggested(others)}"
            )
        parameters, spec = options.parameters(), options.spec()
        window = window_of(options.name, parameters)
        if self.image_size is not None and "win_size" in parameters and window != self.image_size:
            raise ValueError(
                f"--image-size {as_text(self.image_size)} (height x width) and --set "
                f"win_size={as_text(parameters['win_size'])} (width x height) contradict each other"
            )
        for size in (self.image_size,) if self.image_size else (None, window):  # rows and columns say more
            how = fit(shape, spec, size)
            if how is not None:
                return spec, how
        if len(shape) > 1 and shape[0] > 1 and fit(shape[1:], spec, self.image_size or window) is not None:
            raise ValueError(f"expected one descriptor in a file, got {shape[0]} of them")
        reason = self._mismatch(shape, spec, window)
        own = parameters_that_fit(shape, options.name, parameters, self.image_size)
        others = presets_that_fit(shape, options.name, self.image_size)
        raise ValueError(f"{reason}{_suggested(own + others)}")

    def _mismatch(self, shape: tuple[int, ...], spec: HOGSpec, window: tuple[int, int] | None) -> str:
        size = (self.image_size or window) if is_row(shape) else self.image_size
        if size is None and is_row(shape):
            return (
                f"{math.prod(shape)} numbers in one row do not say how large their image was: expected --image-size HxW"
            )
        of = "" if size is None else f" of an image of {as_text(size)} pixels (height x width)"
        return f"the {spec.name} descriptor{of} has the shape {shapes(spec, size)}, got {shape}"


def _suggested(fitting: list[str]) -> str:
    return f"; this fits {', or '.join(fitting)}" if fitting else "; no parameters were found that fit"
