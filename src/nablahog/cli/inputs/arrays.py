"""Arrays of other libraries: the options ``--image-size`` and ``--key``, and the presets that fit an array."""

from __future__ import annotations

import math
from argparse import Namespace
from dataclasses import dataclass
from typing import TypeAlias

from ...hog import HOGSpec
from ...io.arrays import naming, read_array
from ...io.descriptor_file import Fit, StoredDescriptor, fit, is_row, shapes, stored
from ..arguments.presets import PRESETS, SpecOptions, as_text, make_spec, window_of

Size: TypeAlias = tuple[int, int]

MOST = 3  # presets that are suggested


@dataclass(frozen=True)
class ArrayOptions:
    """The options that describe an array: the (height, width) of its image, and its name in a file of several."""

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
        return f"; this fits {', or '.join(f'--preset {name}' for name in fitting)}" if fitting else ""


def presets_that_fit(shape: tuple[int, ...], image_size: Size | None) -> list[str]:
    """At most :data:`MOST` presets that, with their defaults, have an array of this shape, of an image of this size.

    Those whose own layout it is come first.
    """
    specs = {name: make_spec(name, {}) for name in PRESETS}
    fits = {name: fit(shape, spec, image_size) for name, spec in specs.items()}
    in_one_row = is_row(shape)
    fitting = [
        (how.layout != specs[name].layout, name)
        for name, how in fits.items()
        if how is not None
        and _is_whole(specs[name], how.image_size)
        and (not in_one_row or specs[name].layout.endswith("vector"))  # no other library returns it in one row
    ]
    return [name for _, name in sorted(fitting, key=lambda each: each[0])[:MOST]]


def _is_whole(spec: HOGSpec, image_size: Size) -> bool:
    """Whether an image can be a window of OpenCV, which must be whole strides."""
    return not spec.pooling.has_blocks or spec.image_size(*spec.grid(*image_size)) == image_size
