"""The presets that an array can be a descriptor of."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

from ...hog import HOGSpec
from ...io.layouts import fit, is_row
from ..arguments.preset_parameters import PRESETS, as_text
from .spec import make_spec

Size: TypeAlias = tuple[int, int]

MOST = 3
_SIDES = (64, 128, 32, 256, 96, 224, 48, 28, 512, 100, 112, 200, 300)  # the most usual first
_USUAL_SIZES: tuple[Size, ...] = (
    *((128, 64), (96, 48), (160, 96), (64, 128), (240, 320), (480, 640)),
    *((side, side) for side in _SIDES),
)


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
    """The presets, with their defaults, that an array of this shape can be a descriptor of: at most three.

    Args:
        shape: of the array.
        image_size: (height, width) of the image if it is known.  An array in one row does not tell it: then usual sizes
            are tried.
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
