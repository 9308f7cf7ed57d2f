"""Arrays of other libraries: the options ``--image-size`` and ``--key``, and the presets that fit an array."""

from __future__ import annotations

import math
from argparse import Namespace
from contextlib import suppress
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...hog import HOGSpec
from ...io.arrays import naming, read_array
from ...io.descriptor_file import Fit, StoredDescriptor, fit, is_row, shapes, stored
from ...io.input_file import Readable
from ..arguments.presets import PRESETS, SpecOptions, as_text, window_of

Size: TypeAlias = tuple[int, int]

SIZES = ((64, 64), (128, 64), (128, 128), (32, 32), (96, 96), (28, 28), (96, 48), (256, 256))
"""(height, width) of images to try for an array in one row, which does not tell the size."""
BLOCKS = ("2x2", "1x1")  # cells of scikit-image's blocks, beside the default
LARGEST = 2**12  # cells of a descriptor whose normalisation is compared with that of each dialect that fits
CLEARLY = 2.0  # a dialect this many times as near as the next one is the descriptor's


@dataclass(frozen=True)
class ArrayOptions:
    """The options that describe an array: the (height, width) of its image, and its name in a file of several."""

    image_size: Size | None = None
    key: str | None = None

    @classmethod
    def of(cls, arguments: Namespace) -> ArrayOptions:
        """Reads the options ``--image-size`` and ``--key``."""
        return cls(arguments.image_size, arguments.key)

    def check_unused(self) -> None:
        """Raises ValueError if an option is set; for commands whose inputs are not arrays."""
        for option, value in (("--image-size", self.image_size), ("--key", self.key)):
            if value is not None:
                raise ValueError(
                    f"{option} goes with arrays of other libraries, but no input is one (.npy, .npz, .mat)"
                )

    def read(self, path: Readable, options: SpecOptions) -> StoredDescriptor:
        """The descriptor in a .npy, .npz or .mat file."""
        array = read_array(path, self.key)
        with naming(path):
            if options.preset is None:
                raise ValueError(f"an array does not say which library it is from{self._which(array)}")
            return stored(array, *self.fitting(array.shape, options))

    def fitting(self, shape: tuple[int, ...], options: SpecOptions) -> tuple[HOGSpec, Fit]:
        """How an array of this shape is a descriptor of the preset in ``options``."""
        if options.preset is None:
            raise ValueError(
                f"an array does not say which library it is from: expected --preset NAME{self._suggested(shape)}"
            )
        parameters, spec = options.parameters(), options.spec()
        window = window_of(options.name, parameters)
        if self.image_size is not None and "win_size" in parameters and window != self.image_size:
            raise ValueError(
                f"--image-size {as_text(self.image_size)} (height x width) and --set "
                f"win_size={as_text(parameters['win_size'])} (width x height) contradict each other"
            )
        for size in (self.image_size,) if self.image_size else (None, window):  # rows and columns tell more
            how = fit(shape, spec, size)
            if how is not None:
                return spec, how
        if len(shape) > 1 and shape[0] > 1 and fit(shape[1:], spec, self.image_size or window) is not None:
            raise ValueError(f"expected one descriptor in a file, got {shape[0]} of them: save each in its own")
        raise ValueError(f"{self._mismatch(shape, spec, window)}{self._suggested(shape)}")

    def _mismatch(self, shape: tuple[int, ...], spec: HOGSpec, window: Size | None) -> str:
        size = (self.image_size or window) if is_row(shape) else self.image_size
        if size is None and is_row(shape):
            return (
                f"{math.prod(shape)} numbers in one row do not say how large their image was: expected --image-size HxW"
            )
        of = "" if size is None else f" of an image of {as_text(size)} pixels (height x width)"
        return f"the {spec.name} descriptor{of} has the shape {shapes(spec, size)}, got {shape}"

    def _suggested(self, shape: tuple[int, ...]) -> str:
        fitting = [each.options for each in presets_that_fit(shape, self.image_size)]
        if fitting:
            return f"; this fits {', or '.join(fitting)}"
        if is_row(shape):
            fitting = [each.options for each in presets_that_fit((math.prod(shape) - 1,), self.image_size)]
        return f"; with --template, a detector's weights and bias would fit {', or '.join(fitting)}" if fitting else ""

    def _which(self, array: NDArray[np.floating]) -> str:
        """The dialects that fit, the likeliest first: that of which an image comes nearest to the descriptor."""
        near = likeliest(array, self.image_size)
        if len(near) < 2:
            return f": expected --preset NAME{self._suggested(array.shape)}"
        each = [each.options if math.isinf(error) else f"{each.options} ({error:.3f})" for error, each in near]
        if CLEARLY * near[0][0] <= near[1][0] < math.inf:
            return f"; by the error of its normalisation it is {each[0]}, and not {', or '.join(each[1:])}"
        told = "" if math.isinf(near[0][0]) else ", and the error of its normalisation does not tell"
        return f"; its shape fits several{told}: expected {', or '.join(each)}"


@dataclass(frozen=True)
class FittingPreset:
    """A preset with parameters of which an array can be a descriptor.

    Attributes:
        dialect: the options.
        image_size: (height, width), if the command must be told.
        how: the layout in which the array is its descriptor.
    """

    dialect: SpecOptions
    image_size: Size | None
    how: Fit

    @property
    def options(self) -> str:
        """The options as on the command line."""
        settings = "".join(f" --set {key}={value}" for key, value in self.dialect.settings)
        size = f" --image-size {as_text(self.image_size)}" if self.image_size else ""
        return f"--preset {self.dialect.name}{settings}{size}"

    def error(self, array: NDArray[np.floating]) -> float:
        """Relative error of the dialect's normaliser; infinite if the descriptor is too large to check."""
        from ...invert.histograms import normalization_error

        of_array = stored(array, self.dialect.spec(), self.how)
        rows, cols, _ = of_array.descriptor.shape
        if rows * cols > LARGEST:
            return math.inf
        return float(normalization_error(of_array.descriptor.float()[None], of_array.spec, of_array.image_size)[0])


def likeliest(array: NDArray[np.floating], image_size: Size | None) -> list[tuple[float, FittingPreset]]:
    """The presets that fit an array, with the errors of their normalisers; the smallest first."""
    fitting = presets_that_fit(array.shape, image_size)
    errors = [each.error(array) for each in fitting] if len(fitting) > 1 else [math.inf] * len(fitting)
    return sorted(zip(errors, fitting, strict=True), key=lambda each: each[0])


def presets_that_fit(shape: tuple[int, ...], image_size: Size | None) -> list[FittingPreset]:
    """All presets of which an array of this shape is a descriptor, for an image of this size or, if none, a usual one.

    Parameters are the defaults, but for the cells of scikit-image's blocks and the window of OpenCV.  Presets with the
    array's layout come first.
    """
    fitting: list[FittingPreset] = []
    guessed = image_size is None and is_row(shape)
    for name in PRESETS:
        blocks = tuple((("cells_per_block", each),) for each in BLOCKS) if name == "skimage" else ()
        for settings in ((), *blocks):
            for size in SIZES if guessed else (image_size,):
                windows = name == "opencv" and size not in (None, window_of(name, {}))
                chosen = (("win_size", as_text(size[::-1])),) if windows and size else settings
                with suppress(ValueError):  # some are not a window of OpenCV
                    options = SpecOptions(name, chosen)
                    how = _own(shape, options.spec(), size)
                    if how is not None:
                        fitting.append(FittingPreset(options, size if guessed and name != "opencv" else None, how))
    return sorted(fitting, key=lambda each: each.how.layout != each.dialect.spec().layout)


def _own(shape: tuple[int, ...], spec: HOGSpec, image_size: Size | None) -> Fit | None:
    """How an array of this shape is a descriptor as libraries return it, if it is one."""
    how = fit(shape, spec, image_size)
    if how is None or (is_row(shape) and not spec.layout.endswith("vector")):  # no other library returns one row
        return None
    blocks = spec.pooling.has_blocks  # of OpenCV, whose windows are whole strides
    return how if not blocks or spec.image_size(*spec.grid(*how.image_size)) == how.image_size else None
