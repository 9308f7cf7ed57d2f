"""Suggests parameters with which an array is a descriptor, if it does not fit the options of the command."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from typing import Any, TypeAlias, get_args, get_origin

from ...hog import HOGSpec
from ...io.layouts import Fit, fit, is_row
from ..arguments.preset_parameters import PRESETS, as_text, defaults_of, parameters_of, window_of
from .spec import CELLS, make_spec

Size: TypeAlias = tuple[int, int]
Changes: TypeAlias = dict[str, Any]  # of parameters, and of the "image_size"

MOST = 3  # suggestions of either kind
# the most usual values first
_BINS = (9, 8, 6, 12, 18, 4, 3, 5, 7, 10, 11, 13, 14, 15, 16, 17)
_CELL_SIDES = (8, 16, 4, 6, 5, 10)
_BLOCK_SIDES = (2, 3, 1, 4)  # in cells
_SIDES = (64, 128, 32, 256, 96, 224, 48, 28, 512, 100, 112, 200, 300, 80, 40, 50, 36, 24, 20, 16)
_IMAGE_SIZES = (
    *((128, 64), (96, 48), (160, 96), (64, 32), (64, 128), (32, 64), (240, 320), (480, 640)),
    *((side, side) for side in _SIDES),
)


def parameters_that_fit(
    shape: tuple[int, ...], name: str, options_set: Mapping[str, Any], image_size: Size | None
) -> list[str]:
    """Options with which an array of this shape is a descriptor of the preset: at most three, the least changes first.

    Args:
        shape: of the array.
        name: of the preset.
        options_set: the parameters that the user set.
        image_size: (height, width) of the option, or None.
    """
    in_one_row = is_row(shape)
    size = image_size or (window_of(name, options_set) if in_one_row else None)
    fitting: list[Changes] = []
    for changes, spec in _trials(name, options_set):
        for how in _fits(shape, spec, size):
            if how.image_size == size or (size is None and not in_one_row):
                fitting.append(changes)
            elif in_one_row or not {*CELLS} & changes.keys():  # rows and columns fit cells of any size
                fitting.append({**changes, "image_size": how.image_size})
    least: list[Changes] = []
    for changes in sorted(fitting, key=len):  # stable: of those that change as much, the most usual first
        if not any(fewer.items() <= changes.items() for fewer in least):
            least.append(changes)
    return [_options(name, changes, image_size) for changes in least[:MOST]]


def presets_that_fit(shape: tuple[int, ...], but: str | None, image_size: Size | None) -> list[str]:
    """Options of other presets, with their defaults, of which an array of this shape is a descriptor: at most three.

    Args:
        shape: of the array.
        but: the preset of the options, which is left out.
        image_size: (height, width) of the option, or None.
    """
    suggestions = []
    for name in PRESETS:
        spec = make_spec(name, {})
        if name == but or (is_row(shape) and not spec.layout.endswith("vector")):  # which no library lays in one row
            continue
        how = next(_fits(shape, spec, image_size or window_of(name, {})), None)
        if how is not None:
            is_known = how.image_size == image_size or (image_size is None and not is_row(shape))
            options = _options(name, {} if is_known else {"image_size": how.image_size}, image_size)
            suggestions.append((how.layout != spec.layout, f"--preset {name} {options}".strip()))
    return [options for _, options in sorted(suggestions, key=lambda each: each[0])[:MOST]]


def _fits(shape: tuple[int, ...], spec: HOGSpec, image_size: Size | None) -> Iterator[Fit]:
    """How an array fits a spec, for the image size ``image_size``, if any, first."""
    count = math.prod(shape)
    sizes: list[Size | None] = [] if image_size is None else [image_size]
    if is_row(shape):
        square = spec.image_size(*[math.isqrt(count // spec.channels)] * 2)
        sizes += [*_IMAGE_SIZES, square]
    else:
        sizes.append(None)
    for size in dict.fromkeys(sizes):
        try:
            if size is not None and math.prod(spec.grid(*size)) * spec.channels != count:  # far faster than fit
                continue
        except ValueError:  # the image would hold no cell
            continue
        how = fit(shape, spec, size)
        if how is not None and _suits(spec, how.image_size):
            yield how


def _suits(spec: HOGSpec, image_size: Size) -> bool:
    """Whether an image is a window of OpenCV, which must be whole strides."""
    return not spec.pooling.has_blocks or spec.image_size(*spec.grid(*image_size)) == image_size


def _trials(name: str, options_set: Mapping[str, Any]) -> Iterator[tuple[Changes, HOGSpec]]:
    """Specs of the preset, each with the parameters that differ from the options and defaults."""
    base = {**defaults_of(name), **options_set}
    axes = [[{}, *(each for each in axis if not _within(each, base))] for axis in _axes(name)]
    for choice in itertools.product(*axes):
        merged: Changes = {key: value for part in choice for key, value in part.items()}
        changes = {key: value for key, value in merged.items() if not _within({key: value}, base)}
        parameters = {**options_set, **changes}
        if "win_size" in base:  # is not part of the spec, but must suit it
            parameters["win_size"] = parameters.get("block_size", base["block_size"])
        try:
            yield changes, make_spec(name, parameters)
        except ValueError:
            continue


def _within(changes: Changes, base: Mapping[str, Any]) -> bool:
    def pair(value: object) -> object:
        return (value, value) if isinstance(value, int) else value

    return all(pair(base[key]) == pair(value) for key, value in changes.items())


def _axes(name: str) -> Iterator[list[Changes]]:
    """Values of parameters that are independent of each other."""
    hints = parameters_of(name)
    for key, hint in hints.items():
        if key in ("bins", "orientations", "nbins"):
            yield [{key: bins} for bins in _BINS]
        elif key == "cells_per_block":
            yield [{key: (side, side)} for side in _BLOCK_SIDES]
        elif key == "variant":
            yield [{key: variant} for variant in get_args(hint)]
        elif key in CELLS and "block_size" not in hints:
            yield [{key: (side, side) if get_origin(hint) is tuple else side} for side in _CELL_SIDES]
    if "block_size" in hints:  # OpenCV's, in pixels
        yield [
            {"cell_size": (cell, cell), "block_size": (cells * cell,) * 2, "block_stride": (step, step)}
            for cell, cells in itertools.product(_CELL_SIDES, _BLOCK_SIDES)
            for step in dict.fromkeys((cell, cells * cell))
        ]


def _options(name: str, changes: Changes, image_size: Size | None) -> str:
    """The changes as options of the command line."""
    options = []
    for key, value in changes.items():
        if key == "image_size":
            by_window = image_size is None and window_of(name, {}) is not None
            options.append(f"--set win_size={as_text(value[::-1])}" if by_window else f"--image-size {as_text(value)}")
        elif key in CELLS:
            options.append(f"--cell {value if isinstance(value, int) else value[0]}")
        else:
            options.append(f"--set {key}={as_text(value)}")
    return " ".join(options)
