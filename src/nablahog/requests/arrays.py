"""Arrays of other libraries: which descriptor an array is, and the presets that fit it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..hog import HOGSpec
from ..io.arrays import naming, read_array
from ..io.descriptor_file import FittedLayout, StoredDescriptor, find_layout, is_row, shapes, to_descriptor
from ..io.input_file import Readable
from ..runtime.errors import InputError, Topic
from .dialect import PRESETS, as_text, opencv_window_size
from .inversion import GlyphRequest

Size: TypeAlias = tuple[int, int]

GUESSED_IMAGE_SIZES = ((64, 64), (128, 64), (128, 128), (32, 32), (96, 96), (28, 28), (96, 48), (256, 256))
"""(height, width) of images to try for an array in one row, which does not tell the size."""
SKIMAGE_BLOCK_SIZES = ("2x2", "1x1")  # cells of scikit-image's blocks, beside the default
MOST_COMPARED_CELLS = 2**12  # cells of a descriptor whose normalisation is compared with that of each dialect that fits


def read_stored(path: Readable, request: GlyphRequest) -> StoredDescriptor:
    """The descriptor in a .npy, .npz or .mat file; InputError if the request does not say which it is."""
    array = read_array(path, request.key)
    with naming(path):
        with suggesting(array, request.image_size):
            spec, how = fit_array(array.shape, request)
        return to_descriptor(array, spec, how)


def fit_array(shape: tuple[int, ...], request: GlyphRequest) -> tuple[HOGSpec, FittedLayout]:
    """How an array of this shape is a descriptor of the preset that was asked for."""
    if request.preset is None:
        raise InputError("an array does not say which library it is from", "preset")
    parameters, spec, size = request.parameters(), request.spec, request.image_size
    window = opencv_window_size(request.name, parameters)
    if size is not None and "win_size" in parameters and window != size:
        raise ValueError(
            f"the image size {as_text(size)} (height x width) and win_size={as_text(parameters['win_size'])} "
            "(width x height) contradict each other"
        )
    for known in (size,) if size else (None, window):  # rows and columns tell more
        how = find_layout(shape, spec, known)
        if how is not None:
            return spec, how
    if len(shape) > 1 and shape[0] > 1 and find_layout(shape[1:], spec, size or window) is not None:
        raise ValueError(f"expected one descriptor in a file, got {shape[0]} of them: save each in its own")
    if is_row(shape):
        size = size or window
        if size is None:
            raise InputError(
                f"{math.prod(shape)} numbers in one row do not say how large their image was", "image size"
            )
    of = "" if size is None else f" of an image of {as_text(size)} pixels (height x width)"
    raise ValueError(f"the {spec.name} descriptor{of} has the shape {shapes(spec, size)}, got {shape}")


@contextmanager
def suggesting(array: NDArray[np.floating], image_size: Size | None) -> Iterator[None]:
    """Turns a ValueError of the block into an InputError with the presets that fit the array, as ``fitting``."""
    try:
        yield
    except ValueError as error:
        about: Topic = error.about if isinstance(error, InputError) else "descriptor"
        facts = {"shape": array.shape, "fitting": likeliest(array, image_size)}
        raise InputError(str(error), about, facts) from None


@dataclass(frozen=True)
class FittingPreset:
    """A preset with parameters of which an array can be a descriptor.

    Attributes:
        request: what to ask for; the image's size only if it must be told.
        how: the layout in which the array is its descriptor.
        error: the relative error of the dialect's normaliser; infinite if it was not computed.
        is_detector: whether the array is a detector's weights, with a bias after them.
    """

    request: GlyphRequest
    how: FittedLayout
    error: float = math.inf
    is_detector: bool = False


def likeliest(array: NDArray[np.floating], image_size: Size | None) -> list[FittingPreset]:
    """The presets that fit an array, with the errors of their normalisers; the smallest first.

    If there is none, those that fit the weights of a detector without the bias after them.
    """
    fitting = presets_that_fit(array.shape, image_size)
    if not fitting and is_row(array.shape):
        weights = presets_that_fit((array.size - 1,), image_size)
        return [FittingPreset(preset.request, preset.how, is_detector=True) for preset in weights]
    if len(fitting) > 1:
        fitting = [FittingPreset(preset.request, preset.how, _error(preset, array)) for preset in fitting]
    return sorted(fitting, key=lambda preset: preset.error)


def _error(preset: FittingPreset, array: NDArray[np.floating]) -> float:
    """The error of the normaliser; infinite if the descriptor is too large to check, or holds NaN or Inf."""
    from ..invert.histograms import normalization_error

    rows, cols = preset.request.spec.grid(*preset.how.image_size)
    if rows * cols > MOST_COMPARED_CELLS:
        return math.inf
    try:
        descriptor = to_descriptor(array, preset.request.spec, preset.how)
    except ValueError:
        return math.inf
    error = normalization_error(descriptor.descriptor.float()[None], descriptor.spec, descriptor.image_size)
    return float(error.nan_to_num(math.inf)[0])  # NaN where all is 0


def presets_that_fit(shape: tuple[int, ...], image_size: Size | None) -> list[FittingPreset]:
    """All presets of which an array of this shape is a descriptor, for an image of this size or, if none, a usual one.

    Parameters are the defaults, but for the cells of scikit-image's blocks and the window of OpenCV.  Presets with the
    array's layout come first.
    """
    fitting: list[FittingPreset] = []
    guessed = image_size is None and is_row(shape)
    for name in PRESETS:
        blocks = tuple({"cells_per_block": cells} for cells in SKIMAGE_BLOCK_SIZES) if name == "skimage" else ()
        for settings in ({}, *blocks):
            for size in GUESSED_IMAGE_SIZES if guessed else (image_size,):
                windows = name == "opencv" and size not in (None, opencv_window_size(name, {}))
                chosen = {"win_size": as_text(size[::-1])} if windows and size else settings
                with suppress(ValueError):  # some are not a window of OpenCV
                    needed = size if guessed and name != "opencv" else None
                    request = GlyphRequest(preset=name, settings=chosen, image_size=needed)
                    how = _fit_own_layout(shape, request.spec, size)
                    if how is not None:
                        fitting.append(FittingPreset(request, how))
    return sorted(fitting, key=lambda preset: preset.how.layout != preset.request.spec.layout)


def _fit_own_layout(shape: tuple[int, ...], spec: HOGSpec, image_size: Size | None) -> FittedLayout | None:
    """How an array of this shape is a descriptor as libraries return it, if it is one."""
    how = find_layout(shape, spec, image_size)
    if how is None or (is_row(shape) and not spec.layout.endswith("vector")):  # no other library returns one row
        return None
    blocks = spec.pooling.has_blocks  # of OpenCV, whose windows are whole strides
    return how if not blocks or spec.image_size(*spec.grid(*how.image_size)) == how.image_size else None
