"""What the numbers of an array say against a request, and what to ask for in its place."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..invert.candidates import Candidate
from ..invert.which import WhichHOG, which_hog
from ..io.descriptor_file import is_row
from .dialect import (
    as_text,
    make_spec,
    opencv_window_size,
    other_defaults,
    preset_defaults,
    preset_parameters,
    presets_with,
)
from .inversion import GlyphRequest

OTHER_CELLS = (16, 4, 6, 5, 10, 12, 20, 24, 32)  # pixels along a side, the likeliest first
_CELL_NAMES = ("pixels_per_cell", "cell_size")


@dataclass(frozen=True)
class Advice:
    """What the numbers say, as a clause, and what to ask for, if the checks decide on that."""

    remark: str
    request: GlyphRequest | None


def advise(array: NDArray[np.floating], request: GlyphRequest) -> Advice | None:
    """What to ask for in place of a request that does not fit an array, if the checks decide on one."""
    for check in (advise_on_swapped_size, _advise_on_cells, _advise_on_size, advise_on_preset):
        advice = check(array, request)
        if advice is not None:
            return advice
    return None


def advise_on_swapped_size(array: NDArray[np.floating], request: GlyphRequest) -> Advice | None:
    """Height and width exchanged, if the checks decide for that."""
    size = request.image_size
    if size is None or size[0] == size[1]:
        return None
    answer = find_which(array, replace(request, image_size=None))
    if not answer.decided_by or answer.candidates[0].image_size != size[::-1]:
        return None
    remark = f"its numbers hold for {as_text(size[::-1])} pixels (height x width), so the sides seem to be exchanged"
    asked = complete(replace(request, image_size=None), answer.candidates[0], array.shape)
    return Advice(remark, replace(asked, image_size=size[::-1]))


def _advise_on_cells(array: NDArray[np.floating], request: GlyphRequest) -> Advice | None:
    for dialects in _other_cells(request) if array.ndim <= 2 else ():
        answer = which_hog(_select_row(array, request), request.image_size, dialects=dialects)
        if answer.decided_by:
            asked = complete(request, answer.candidates[0], array.shape)
            return Advice("its numbers hold for cells of another size", asked)
    return None


def _other_cells(request: GlyphRequest) -> Iterator[dict[str, Mapping[str, Any]]]:
    """The presets that were asked for, with the parameters that are set, and cells of another size than the default."""
    names = [request.preset] if request.preset else list(presets_with(request.settings))
    if request.image_size is None:
        return
    for cell in OTHER_CELLS:
        dialects: dict[str, Mapping[str, Any]] = {}
        for name in names:
            own, settings = preset_parameters(name), replace(request, preset=name).parameters()
            key = next((key for key in _CELL_NAMES if key in own), "")
            if key and key not in settings:
                sides: dict[str, Any] = {key: cell if own[key] is int else (cell, cell)}
                if "block_size" in own:
                    window = request.image_size[::-1]
                    sides |= {"win_size": window, "block_size": (2 * cell, 2 * cell), "block_stride": (cell, cell)}
                with suppress(ValueError):  # a window of no whole cells
                    make_spec(name, {**sides, **settings})
                    dialects[name] = {**sides, **settings}
        if dialects:
            yield dialects


def _advise_on_size(array: NDArray[np.floating], request: GlyphRequest) -> Advice | None:
    if request.image_size is None:
        return None
    unsized = replace(request, image_size=None)
    answer = find_which(array, unsized)
    if not answer.decided_by:
        return None
    asked = complete(unsized, answer.candidates[0], array.shape)
    return Advice(f"its numbers hold for {as_text(answer.candidates[0].image_size)} pixels (height x width)", asked)


def advise_on_preset(array: NDArray[np.floating], request: GlyphRequest) -> Advice | None:
    """Another preset than the one that was asked for, if its numbers hold for that alone."""
    if request.preset is None:
        return None
    free = replace(request, preset=None, settings={})
    answer = find_which(array, free)
    if not answer.decided_by or answer.candidates[0].preset == request.preset:
        return None
    return Advice(
        f"its numbers hold for {answer.candidates[0].preset}", complete(free, answer.candidates[0], array.shape)
    )


def find_which(array: NDArray[np.floating], request: GlyphRequest) -> WhichHOG:
    """Which HOG of those that were asked for an array is, or the row of it that was."""
    return which_hog(_select_row(array, request), request.image_size, dialects=known_dialects(request))


def _select_row(array: NDArray[np.floating], request: GlyphRequest) -> NDArray[np.floating]:
    is_matrix = array.ndim == 2 and not is_row(array.shape)
    return array[request.row : request.row + 1] if is_matrix and request.row is not None else array


def known_dialects(request: GlyphRequest) -> dict[str, Mapping[str, Any]]:
    """The presets that were asked for, or all that have the parameters that are set, with these."""
    asked = {request.preset: request.parameters()} if request.preset else presets_with(request.settings)
    return {name: {**other_defaults(name), **parameters} for name, parameters in asked.items()}


def complete(request: GlyphRequest, candidate: Candidate, shape: tuple[int, ...]) -> GlyphRequest:
    """The request with what a candidate adds to it, in as few words as say it."""
    defaults = preset_defaults(candidate.preset)
    settings = {key: as_text(value) for key, value in candidate.parameters.items() if value != defaults[key]}
    settings = {**settings, **request.settings}
    untold = is_row(candidate.how.shape) or candidate.how.layout == "tokens"  # by rows and columns
    size = candidate.image_size if untold and "win_size" not in settings else request.image_size
    in_one_row = candidate.count > 1 and is_row(shape)
    if candidate.preset == "opencv" and not in_one_row and size == opencv_window_size("opencv", {}):
        size = request.image_size
    return replace(request, preset=candidate.preset, settings=settings, image_size=size)
