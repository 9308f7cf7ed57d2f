"""Arrays of other libraries: the options ``--image-size`` and ``--key``, and the presets that fit an array."""

from __future__ import annotations

import math
from argparse import Namespace
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

from ...hog import HOGSpec
from ...io.arrays import naming, read_array
from ...io.descriptor_file import Fit, StoredDescriptor, fit, is_row, shapes, stored
from ..arguments.preset_parameters import PRESETS, as_text, window_of
from .spec import SpecOptions, make_spec

Size: TypeAlias = tuple[int, int]

MOST = 3  # presets that are suggested
_SIDES = (64, 128, 32, 256, 96, 224, 48, 28, 512, 100, 112, 200, 300)  # the most usual first
_USUAL_SIZES: tuple[Size, ...] = (
    *((128, 64), (96, 48), (160, 96), (64, 128), (240, 320), (480, 640)),
    *((side, side) for side in _SIDES),
)


@dataclass(frozen=True)
class ArrayOptions:
    """The options that describe an array; None where an option is not set.

    Attributes:
        image_size: (height, width) in pixels of the images.
        key: the name of the array in files of several.
    """

    image_size: Size | None = None
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
        """The descriptor in a .npy, .npz or .mat file."""
        array = read_array(path, self.key)
        with naming(path):
            return stored(array, *self.fitting(array.shape, options))

    def fitting(self, shape: tuple[int, ...], options: SpecOptions) -> tuple[HOGSpec, Fit]:
        """How an array of this shape is a descriptor of the preset in ``options``."""
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

    def _mismatch(self, shape: tuple[int, ...], spec: HOGSpec, window: Size | None) -> str:
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


class FittingPreset(NamedTuple):
    """A preset with its defaults, and the (height, width) of the image if it has to be given."""

    name: str
    image_size: Size | None

    @property
    def options(self) -> str:
        """As options of the command line."""
        size = "" if self.image_size is None else f" --image-size {as_text(self.image_size)}"
        return f"--preset {self.name}{size}"


def presets_that_fit(shape: tuple[int, ...], image_size: Size | None) -> list[FittingPreset]:
    """The presets, with their defaults, that an array of this shape can be a descriptor of: at most :data:`MOST`.

    Of an array in one row, whose (height, width) is not known, usual sizes are tried.
    """
    in_one_row, fitting = is_row(shape), []
    sizes = _USUAL_SIZES if in_one_row else (None,)
    for name in PRESETS:
        spec = make_spec(name, {})
        if in_one_row and not spec.layout.endswith("vector"):  # no library returns it in one row
            continue
        for size in (image_size, *sizes) if image_size else sizes:
            how = fit(shape, spec, size)
            if how is not None and _is_whole(spec, how.image_size):
                known = how.image_size == image_size or (image_size is None and not in_one_row)
                fitting.append((how.layout != spec.layout, FittingPreset(name, None if known else how.image_size)))
                break
    return [preset for _, preset in sorted(fitting, key=lambda each: each[0])[:MOST]]


def _is_whole(spec: HOGSpec, image_size: Size) -> bool:
    """Whether an image can be a window of OpenCV, which must be whole strides."""
    return not spec.pooling.has_blocks or spec.image_size(*spec.grid(*image_size)) == image_size
