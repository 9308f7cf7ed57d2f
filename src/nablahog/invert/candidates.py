"""The dialects, layouts and image sizes of which an array can be the descriptor, by its shape alone."""

from __future__ import annotations

import inspect
import itertools
import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..hog import HOGSpec, presets
from ..hog.layout import TOKEN_CELLS, from_layout, native_shape
from ..inputs.numbers import as_square_or_size, check_choice, shortened
from ..io.descriptor_file import FittedLayout, find_layout, is_row

Parameters = Mapping[str, Any]

ORIENTATIONS = (9, 8, 6, 12, 18)
VARIANTS: dict[str, dict[str, tuple[Any, ...]]] = {
    "dalal_triggs": {"norm": ("L2-Hys", "L2", "L1", "L1-sqrt")},
    "maskfeat": {"layout": ("colour-planes", "tokens")},
    "paper": {"global_form": ("printed", "robust")},
    "skimage": {
        "cells_per_block": ((3, 3), (2, 2), (1, 1)),
        "block_norm": ("L2-Hys", "L2", "L1", "L1-sqrt"),
    },
    "vlfeat": {"variant": ("uoctti", "dalaltriggs")},
}
"""Parameters that are tried with their values, beside orientations; the default first."""
_ORIENTATION_NAMES = ("bins", "nbins", "orientations")
MOST_ASPECT = 4  # of the sides of an image
WINDOWED = "opencv"  # the preset whose library returns all windows of an image in one row
DEFAULT_WINDOW = (64, 128)  # OpenCV's, (width, height)


@dataclass(frozen=True)
class Candidate:
    """A dialect, a layout and a size of which an array can be the descriptor, or several in its rows.

    Windows of OpenCV's may also be one after the other in one row, as ``cv2.HOGDescriptor.compute`` returns them.

    Attributes:
        preset: its name in :mod:`nablahog.presets`.
        parameters: of the preset, those that are not its defaults.
        spec: the preset with these parameters.
        how: the layout, the shape of one descriptor in it, and (height, width) of its image, of whole cells.
        count: the number of descriptors.
    """

    preset: str
    parameters: Parameters
    spec: HOGSpec
    how: FittedLayout
    count: int = 1

    @property
    def image_size(self) -> tuple[int, int]:
        """(height, width) in pixels."""
        return self.how.image_size

    @property
    def summary(self) -> str:
        """The preset with its parameters, and the size of the image, such as ``skimage(orientations=8) of 64x64``."""
        parameters = ", ".join(f"{name}={value!r}" for name, value in self.parameters.items())
        count = f", {self.count} of them" if self.count > 1 else ""
        return f"{self.preset}({parameters}) of {self.image_size[0]}x{self.image_size[1]}{count}"

    def descriptors(self, array: NDArray[np.floating]) -> Tensor:
        """The array as descriptors (B, rows, cols, channels) in float64."""
        native = torch.from_numpy(np.ascontiguousarray(array, np.float64)).reshape(-1, *self.how.shape)
        return from_layout(native, self._native_spec, self.image_size)

    @cached_property
    def _native_spec(self) -> HOGSpec:
        """The spec with the layout of the array."""
        return replace(self.spec, layout=self.how.layout)


def check_dialects(dialects: Mapping[str, Parameters]) -> None:
    """Raises TypeError or ValueError unless all are presets with their parameters, and values that they can have."""
    for name, known in dialects.items():
        check_choice("a preset in dialects", name, presets.__all__)
        if not isinstance(known, Mapping):
            raise TypeError(
                f"dialects[{name!r}] must be a dict, got {shortened(known)}: write {{}} if nothing is known"
            )
        preset = getattr(presets, name)
        for parameter in known:
            check_choice(f"a parameter in dialects[{name!r}]", parameter, inspect.signature(preset).parameters)
        possible = False
        for parameters in variants(name, known):
            with suppress(ValueError):
                possible |= bool(preset(**parameters))
        if not possible:
            preset(**known)


def fit_shape(
    shape: tuple[int, ...], image_size: tuple[int, int] | None, dialects: Mapping[str, Parameters] | None = None
) -> Iterator[Candidate]:
    """All candidates of which an array of this shape holds one descriptor, or in two axes one in each row."""
    for name, known in (dialects or {preset: {} for preset in presets.__all__}).items():
        for parameters in variants(name, known):
            with suppress(ValueError):  # not all values go together
                spec = getattr(presets, name)(**parameters)
                if not is_row(shape):
                    for size in _token_sizes(shape, spec) if spec.layout == "tokens" else (image_size,):
                        how = find_layout(shape, spec, image_size or size)
                        if how is not None:
                            yield Candidate(name, parameters, spec, how)
                rows = shape if is_row(shape) else shape[1:] if len(shape) == 2 else ()
                if rows:
                    count = 1 if is_row(shape) else shape[0]
                    if rows is not shape and math.prod(rows) == spec.channels and image_size is None:
                        continue  # rather the places of one image than images of one place
                    for how in _fit_row(math.prod(rows), spec, image_size):
                        named = _with_window(name, parameters, how.image_size)
                        yield Candidate(name, named, spec, how, count)
                if is_row(shape) and name == WINDOWED:
                    yield from fit_windows(math.prod(shape), parameters, spec, image_size)


def variants(name: str, known: Parameters) -> Iterator[Parameters]:
    """The parameters of a preset to try, without defaults."""
    signature = inspect.signature(getattr(presets, name)).parameters
    values = dict(VARIANTS.get(name, {}))
    values |= {parameter: ORIENTATIONS for parameter in _ORIENTATION_NAMES if parameter in signature}
    free = {parameter: choices for parameter, choices in values.items() if parameter not in known}
    for chosen in itertools.product(*free.values()):
        tried = dict(zip(free, chosen, strict=True))
        yield {**known, **{key: value for key, value in tried.items() if value != signature[key].default}}


def _token_sizes(shape: tuple[int, ...], spec: HOGSpec) -> Iterator[tuple[int, int]]:
    """The sizes of images with so many patches of 2x2 cells, which rows and columns do not tell."""
    patches = shape[-2]
    for rows in range(1, patches + 1):
        if patches % rows == 0:
            size = spec.image_size(TOKEN_CELLS * rows, TOKEN_CELLS * patches // rows)
            if max(size) <= MOST_ASPECT * min(size):
                yield size


def _fit_row(length: int, spec: HOGSpec, image_size: tuple[int, int] | None) -> Iterator[FittedLayout]:
    """The sizes of images whose descriptor has so many numbers, in the library's own layout; the squarest first."""
    places, remainder = divmod(length, spec.channels)
    if remainder or not places:
        return
    grids = [(rows, places // rows) for rows in range(1, places + 1) if places % rows == 0]
    sizes = [spec.image_size(*grid) for grid in grids] if image_size is None else [image_size]
    # photographs are rarely narrow, and windows of pedestrians upright
    for size in sorted(sizes, key=lambda size: (max(size) / min(size), size[1])):
        if image_size is None and max(size) > MOST_ASPECT * min(size):
            continue
        how = find_layout((length,), spec, size)
        if how is not None:
            yield how


def fit_windows(
    length: int, parameters: Parameters, spec: HOGSpec, image_size: tuple[int, int] | None
) -> Iterator[Candidate]:
    """Several windows, of the size that is known or else the default, one after the other in so many numbers."""
    width, height = as_square_or_size("win_size", parameters.get("win_size", DEFAULT_WINDOW), "width, height")
    size = image_size or (height, width)
    window = math.prod(native_shape(spec, size))
    how = find_layout((window,), spec, size)
    if how is not None and length > window and length % window == 0:
        yield Candidate(WINDOWED, _with_window(WINDOWED, parameters, size), spec, how, length // window)


def _with_window(name: str, parameters: Parameters, size: tuple[int, int]) -> Parameters:
    """The parameters with OpenCV's window, (width, height), if it is not the default."""
    if name != WINDOWED or "win_size" in parameters or size == DEFAULT_WINDOW[::-1]:
        return parameters
    return {**parameters, "win_size": size[::-1]}
