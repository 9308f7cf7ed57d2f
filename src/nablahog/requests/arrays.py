"""Arrays of other libraries: which descriptors an array holds, and the presets that fit it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..hog import HOGSpec
from ..hog.layout import native_shape
from ..invert.candidates import fit_shape
from ..io.arrays import naming, read_array
from ..io.descriptor_file import FittedLayout, StoredDescriptor, find_layout, is_row, shapes, to_descriptor
from ..io.input_file import Readable
from ..runtime.errors import InputError, Topic
from ..runtime.text import counted
from .advice import Advice, advise, advise_on_preset, advise_on_swapped_size, complete, find_which, known_dialects
from .dialect import as_text, opencv_window_size
from .inversion import GlyphRequest

Size: TypeAlias = tuple[int, int]

MOST_SUGGESTED = 6
NEGATIVE = 0.1  # share of negative entries that no descriptor has


@dataclass(frozen=True)
class ArrayDescriptor:
    """A descriptor in an array, the request that reads it, and what tells that it is one, if nobody said so.

    Attributes:
        advice: what its numbers say against the request.
    """

    stored: StoredDescriptor
    request: GlyphRequest
    decided_by: str = ""
    advice: Advice | None = None


def read_stored(path: Readable, request: GlyphRequest) -> list[ArrayDescriptor]:
    """The descriptors in a .npy, .npz or .mat file, one or those in its rows; InputError if nothing says which."""
    array = read_array(path, request.key)
    with naming(path):
        if request.row is not None and not is_row(array.shape):  # else of windows, which become rows
            if array.ndim != 2:
                raise ValueError(f"rows are chosen of a matrix, got the shape {array.shape}: leave out the row")
            _check_row(len(array), request.row)
        with suggesting(array, request):
            asked = request
            request, how, decided_by = identify(array, request)
        advice = _advise_against(array, asked, how)
        if is_row(array.shape) and math.prod(how.shape) < array.size:
            array = array.reshape(-1, math.prod(how.shape))
        _check_row(array.size // math.prod(how.shape), request.row)
        if math.prod(how.shape) == array.size:
            return [ArrayDescriptor(to_descriptor(array, request.spec, how), request, decided_by, advice)]
        rows = range(len(array)) if request.row is None else [request.row]
        return [
            ArrayDescriptor(to_descriptor(array[row], request.spec, how), replace(request, row=row), decided_by, advice)
            for row in rows
        ]


def _advise_against(array: NDArray[np.floating], request: GlyphRequest, how: FittedLayout) -> Advice | None:
    """What the numbers say against a request that fits the array."""
    if not np.isfinite(array).all():
        return None
    # rows and columns say size and preset
    advice = advise_on_swapped_size(array, request) or advise_on_preset(array, request) if is_row(how.shape) else None
    if advice or request.preset is None or not array.any():  # 0 is the descriptor of a flat image
        return advice
    remark = find_which(array, request).remark
    return Advice(remark, None) if remark else None


def _check_row(count: int, row: int | None) -> None:
    if row is not None and row >= count:
        rows = f"{counted(count, 'row')}, counted from 0" if count > 1 else "1 row, which need not be chosen"
        raise ValueError(f"there is no row {row}: the array has {rows}")


def identify(array: NDArray[np.floating], request: GlyphRequest) -> tuple[GlyphRequest, FittedLayout, str]:
    """A request that says all, the layout of each descriptor, and the check that decided what was not asked for."""
    if request.preset is not None:
        by_rows = array.shape if request.row is None or is_row(array.shape) else array.shape[1:]
        try:
            return request, fit_array(by_rows, request)[1], ""
        except ValueError as error:
            refusal = error
        one_of_several = _window(array.size, request) if is_row(array.shape) else array.shape[1:]
        if len(one_of_several) == 1:
            with suppress(ValueError):
                return request, fit_array(one_of_several, request)[1], ""
    else:
        refusal = InputError("an array does not say which library it is from", "preset")
    answer = find_which(array, request)
    if request.preset is None and request.settings and not answer.candidates and not answer.remark:
        asked = ", ".join(f"{key}={value}" for key, value in request.settings.items())
        raise InputError(f"no preset with {asked} makes descriptors of the shape {array.shape}", "descriptor")
    if not answer.decided_by:
        raise refusal
    first = answer.candidates[0]
    decided_by = f"{answer.decided_by}; {answer.assumed}" if answer.assumed else answer.decided_by
    return complete(request, first, array.shape), first.how, decided_by


def _window(length: int, request: GlyphRequest) -> tuple[int, ...]:
    """The shape of each of several windows in one row, if a request says their size and they are of OpenCV's preset."""
    parameters = request.parameters()
    size = opencv_window_size(request.name, parameters)
    if size is None or (request.image_size is None and "win_size" not in parameters):
        return ()
    window = math.prod(native_shape(request.spec, request.image_size or size))
    return (window,) if length % window == 0 else ()


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
    if is_row(shape):
        size = size or window
        if size is None:
            raise InputError(
                f"{math.prod(shape)} numbers in one row do not say how large their image was", "image size"
            )
    of = "" if size is None else f" of an image of {as_text(size)} pixels (height x width)"
    raise ValueError(f"the {spec.name} descriptor{of} has the shape {shapes(spec, size)}, got {shape}")


@contextmanager
def suggesting(array: NDArray[np.floating], request: GlyphRequest) -> Iterator[None]:
    """Turns a ValueError of the block into an InputError with the requests that fit the array, as ``fitting``.

    Nothing fits an array that is not finite: its error stays.  The fact ``weights`` says whether the numbers may be
    those of a detector, and ``decided`` whether the checks decide on what fits.
    """
    try:
        yield
    except ValueError as error:
        if not np.isfinite(array).all():
            raise
        about: Topic = error.about if isinstance(error, InputError) else "descriptor"
        asked = request if about in ("image size", "preset") else replace(request, preset=None, settings={})
        advice = advise(array, request)
        fitting = [Suggestion(advice.request)] if advice and advice.request else suggest(array, asked)
        facts = {
            "shape": array.shape,
            "fitting": fitting,
            "weights": _may_be_weights(array),
            "decided": advice is not None,
        }
        remark = advice.remark if advice else _remark_on_numbers(array, request.row, fitting)
        raise InputError(f"{error}; {remark}" if remark else str(error), about, facts) from None


def _remark_on_numbers(array: NDArray[np.floating], row: int | None, fitting: Sequence[Suggestion]) -> str:
    """Why the checks do not tell what an array is, if they know."""
    remark = find_which(array, GlyphRequest(row=row)).remark
    if fitting or remark:
        return remark
    return "no preset with its usual parameters makes such an array: `settings` says other parameters"


def _may_be_weights(array: NDArray[np.floating]) -> bool:
    return bool(np.count_nonzero(array < 0) > NEGATIVE * array.size)


@dataclass(frozen=True)
class Suggestion:
    """What to ask for, and whether the array is then a detector's weights, perhaps with a bias after them."""

    request: GlyphRequest
    is_detector: bool = False


def suggest(array: NDArray[np.floating], request: GlyphRequest) -> list[Suggestion]:
    """The requests that fit an array, the likeliest first; if there are none, those that fit a detector's weights.

    A row that many negative numbers show to be no descriptor is taken for such weights first.
    """
    if is_row(array.shape) and _may_be_weights(array):
        detectors = _suggest_detectors((array.size, array.size - 1), request)
        if detectors:
            return detectors
    answer = find_which(array, request)
    if answer.candidates:
        likely = answer.candidates[: answer.likely or MOST_SUGGESTED]
        return [Suggestion(each) for each in _distinct(complete(request, each, array.shape) for each in likely)]
    return _suggest_detectors((array.size - 1,), request) if is_row(array.shape) else []


def _suggest_detectors(lengths: Iterable[int], request: GlyphRequest) -> list[Suggestion]:
    """The requests that fit so many weights of a detector: of these numbers, the first that any fit."""
    for length in lengths:
        candidates = fit_shape((length,), request.image_size, known_dialects(request))
        vectors = (each for each in candidates if each.count == 1 and each.spec.layout.endswith("vector"))
        asked = _distinct(complete(request, each, (length,)) for each in vectors)
        if asked:
            return [Suggestion(each, is_detector=True) for each in asked]
    return []


def _distinct(requests: Iterable[GlyphRequest]) -> list[GlyphRequest]:
    """The first few that differ."""
    different: list[GlyphRequest] = []
    for request in requests:
        if request not in different and len(different) < MOST_SUGGESTED:
            different.append(request)
    return different
