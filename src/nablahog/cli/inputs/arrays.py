"""The options ``--image-size`` and ``--key``, and arrays of other libraries."""

from __future__ import annotations

import math
from argparse import Namespace
from dataclasses import dataclass

from ...hog import HOGSpec
from ...io.arrays import read_array
from ...io.descriptor_file import StoredDescriptor
from ...io.layouts import Fit, fit, is_row, shapes, stored
from ...io.npz import naming
from ..arguments.preset_parameters import as_text, window_of
from .spec import SpecOptions
from .suggestions import presets_that_fit


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
        """Raises ValueError if an option is set; for commands whose inputs are no arrays."""
        for option, value in (("--image-size", self.image_size), ("--key", self.key)):
            if value is not None:
                raise ValueError(
                    f"{option} goes with arrays of other libraries, and no input is one (.npy, .npz, .mat)"
                )

    def read(self, path: str, options: SpecOptions) -> StoredDescriptor:
        """The descriptor in a .npy, .npz or .mat file.

        Raises:
            FileNotFoundError: there is no such file.
            ValueError: it holds no such array, or one that is no descriptor of the preset; the message names presets
                that fit.
        """
        array = read_array(path, self.key)
        with naming(path):
            return stored(array, *self.fitting(array.shape, options))

    def fitting(self, shape: tuple[int, ...], options: SpecOptions) -> tuple[HOGSpec, Fit]:
        """How an array of this shape is a descriptor of the preset in ``options``.

        Raises:
            ValueError: it is none, or there is no ``--preset``; the message names presets that fit.
        """
        if options.preset is None:
            raise ValueError(
                f"an array does not say of which library it is: expected --preset NAME{self._suggested(shape)}"
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
        raise ValueError(f"{self._mismatch(shape, spec, window)}{self._suggested(shape)}")

    def _mismatch(self, shape: tuple[int, ...], spec: HOGSpec, window: tuple[int, int] | None) -> str:
        size = (self.image_size or window) if is_row(shape) else self.image_size
        if size is None and is_row(shape):
            return (
                f"{math.prod(shape)} numbers in one row do not say how large their image was: expected --image-size HxW"
            )
        of = "" if size is None else f" of an image of {as_text(size)} pixels (height x width)"
        return f"the {spec.name} descriptor{of} has the shape {shapes(spec, size)}, got {shape}"

    def _suggested(self, shape: tuple[int, ...]) -> str:
        fitting = presets_that_fit(shape, self.image_size)
        return f"; this fits {', or '.join(preset.options for preset in fitting)}" if fitting else ""
