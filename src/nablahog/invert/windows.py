"""Descriptors of several windows of one image in one row, as OpenCV's ``compute`` returns them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import normalize

from ..hog import HOGSpec, presets
from .candidates import DEFAULT_WINDOW, MOST_ASPECT, WINDOWED, Candidate, Parameters, fit_windows, variants

MOST_COMPARED = 2**20  # numbers of windows
SHARED = 0.5  # of windows, at least, have blocks in common with the next, in the least of two in each row
RECURRING = 0.1  # of blocks, at least, recur in windows of an unknown size
MOST_PLACES = 8  # times as many places as the distance between equal blocks has a window: they share a column of 8
LEAST_BLOCKS = 3  # along each side of such a window
DISTINCT = 0.9  # of the blocks of a window, at least, else a pattern repeats itself in one image
MOST_DISTINCT = 16  # windows whose blocks are compared with each other
SEAM = 1.8  # times less alike are the lines of blocks on both sides of a seam between descriptors
OTHER_LENGTH = 1.33  # times more alike are lines of another length than the image's, if they may be a descriptor's


def find_windows(
    array: NDArray[np.floating], candidates: Sequence[Candidate], parameters: Parameters | None
) -> list[Candidate]:
    """The candidates of several windows that share blocks.

    Args:
        array: of one row.
        candidates: by its shape, with windows of the size that is known or else the default.
        parameters: those of OpenCV's preset that are known, if windows of other sizes are to be tried; else None.
    """
    overlapping = [each for each in candidates if each.count > 1 and _shared_axis(array, each)][:1]
    if overlapping or parameters is None:
        return overlapping
    return [each for known in variants(WINDOWED, parameters) for each in _of_other_sizes(array, known)]


def _shared_axis(array: NDArray[np.floating], candidate: Candidate) -> int:
    """The axis along which most windows in a row share blocks with the next, as OpenCV's stride; 0 if they do not."""
    most = max(2, MOST_COMPARED // math.prod(candidate.how.shape))
    windows = candidate.descriptors(array.reshape(candidate.count, -1)[:most])
    if not _are_distinct(windows.flatten(1, 2).numpy()[:MOST_DISTINCT]):
        return 0
    first, second = windows[:-1], windows[1:]
    for axis in (1, 2):
        side = windows.shape[axis]
        for shift in range(1, side):
            common = second.narrow(axis, 0, side - shift)
            shifted = (first.narrow(axis, start, side - shift) == common for start in (shift, 0))
            moved, unmoved = (equal.flatten(1).all(dim=1) for equal in shifted)
            if len(moved[~unmoved]) and float(moved[~unmoved].double().mean()) >= SHARED:  # the others are flat
                return axis
    return 0


def _are_distinct(windows: NDArray[np.float64]) -> bool:
    """Whether most blocks, of windows (n, blocks, channels), differ from all others of their window."""
    textured = [window[window.any(axis=1)] for window in windows]
    distinct = sum(len(np.unique(blocks, axis=0)) for blocks in textured)
    return distinct > DISTINCT * sum(map(len, textured))


def _of_other_sizes(array: NDArray[np.floating], parameters: Parameters) -> Iterator[Candidate]:
    """Windows that share blocks, of all sizes that the distance between equal blocks allows."""
    spec = presets.opencv(**parameters)
    blocks, remainder = divmod(array.size, spec.channels)
    if remainder:
        return
    distance = _distance_of_equals(array.reshape(blocks, -1)[: MOST_COMPARED // spec.channels])
    for places in range(distance + 1, MOST_PLACES * distance + 1):
        sides = range(LEAST_BLOCKS, places // LEAST_BLOCKS + 1) if blocks % places == 0 else ()
        for rows, cols in ((side, places // side) for side in sides if places % side == 0):
            fitting = _windows_of(array.size, parameters, spec, rows, cols)
            axis = next((_shared_axis(array, each) for each in fitting), 0)
            yield from fitting if axis else ()
            if axis == 1:  # or several windows side by side, with the next ones below them
                narrower = (k for k in range(LEAST_BLOCKS, cols) if cols % k == 0)
                yield from (each for k in narrower for each in _windows_of(array.size, parameters, spec, rows, k))


def _windows_of(length: int, parameters: Parameters, spec: HOGSpec, rows: int, cols: int) -> list[Candidate]:
    """Windows of so many blocks, unless they are too narrow."""
    size = spec.image_size(rows, cols)
    return [] if max(size) > MOST_ASPECT * min(size) else list(fit_windows(length, parameters, spec, size))


def _distance_of_equals(blocks: NDArray[np.floating]) -> int:
    """The commonest distance from a block to the next that equals it; 0 if few do."""
    _, kinds = np.unique(blocks, axis=0, return_inverse=True)
    order = np.argsort(kinds.ravel(), kind="stable")
    is_equal = (np.diff(kinds.ravel()[order]) == 0) & blocks[order[1:]].any(axis=1)
    if is_equal.sum() < RECURRING * len(blocks) or kinds.max() < LEAST_BLOCKS**2:
        return 0
    return int(np.bincount(np.diff(order)[is_equal]).argmax())


def describe_seams(array: NDArray[np.floating], candidate: Candidate) -> str:
    """How one descriptor in a row looks as if it were several of another size, as a sentence; empty if it does not."""
    if candidate.preset == WINDOWED and candidate.image_size == DEFAULT_WINDOW[::-1]:
        return ""  # the usual one
    order = candidate.descriptors(np.arange(array.size, dtype=np.float64))[0, ..., 0]
    if min(order.shape) < 2:
        return ""
    blocks = normalize(candidate.descriptors(array)[0], dim=2)  # else a few strong ones decide
    lines = blocks.transpose(0, 1) if order[0, 1] > order[1, 0] else blocks  # (S, F, channels), as they are stored
    places, whole = lines.flatten(0, 1), _difference_of_lines(lines)
    for length in range(LEAST_BLOCKS, len(places) // (2 * LEAST_BLOCKS) + 1):
        if len(places) % length:
            continue
        shorter = places.reshape(-1, length, places.shape[1])
        if length != lines.shape[1] and _difference_of_lines(shorter) * OTHER_LENGTH > whole:
            continue
        size = _size_between_seams(shorter)
        if size:
            parts = len(places) // (size * length)
            return f"its blocks change after every {size} rows of {length}, as if it were {parts} descriptors"
    return ""


def _size_between_seams(lines: Tensor) -> int:
    """The lines (S, F, channels) from one seam to the next, in a descriptor of no extreme shape; 0 without seams."""
    count, length = lines.shape[:2]
    steps = (lines[1:] - lines[:-1]).square().mean(dim=(1, 2))
    for size in range(LEAST_BLOCKS, count // 2 + 1):
        if count % size == 0 and max(size, length) <= MOST_ASPECT * min(size, length):
            at_seams = torch.arange(1, count) % size == 0
            if steps[at_seams].mean() > SEAM * steps[~at_seams].mean():
                return size
    return 0


def _difference_of_lines(lines: Tensor) -> float:
    return float((lines[1:] - lines[:-1]).square().mean())
