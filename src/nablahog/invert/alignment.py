"""Whether the places of a descriptor lie in lines of another length, or its axes in another order, than was found."""

from __future__ import annotations

import itertools

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import normalize

from .candidates import MOST_ASPECT, Candidate, fit_shape
from .exactness import find_tolerance, identities_that_hold

LEAST_ALIKE = 0.4  # correlation of the cells that blocks of neighbouring lines share
CLEARLY_MORE_ALIKE = 0.1  # by which the correlation of narrower images exceeds that of the image found
SAME = 1e-6  # difference of correlations by rounding
MOST_SHIFT = 2 / 3  # of all places; with a larger one too few are left for a correlation


def describe_lines(array: NDArray[np.floating], candidate: Candidate) -> str:
    """How the places seem to be in lines of another length, as a sentence; empty if they do not.

    Of blocks of which cells are shared, all lengths are compared, also those of no image, as part of a descriptor has.
    Of other histograms, the lengths of images that are too narrow to be tried.
    """
    length, alike = _compare_lines(array, candidate)
    count = len(alike)
    if not count:
        return ""
    normalizer = candidate.spec.normalizer
    if min(normalizer.layout_block or (1, 1)) > 1 and candidate.preset != "skimage":  # of which the identities tell
        others = [shift for shift in range(2, round(MOST_SHIFT * count)) if shift != length]
        least = max([LEAST_ALIKE, *(alike[shift] for shift in others)])
    else:
        sides = {side: candidate.spec.image_size(side, count // side) for side in range(2, count // 2 + 1)}
        others = [k for k, size in sides.items() if count % k == 0 and max(size) > MOST_ASPECT * min(size)]
        least = max([-np.inf, *(alike[shift] for shift in others)]) - CLEARLY_MORE_ALIKE
    if alike[length] >= least:
        return ""
    likeliest = max(others, key=alike.__getitem__, default=length)
    if alike[likeliest] > alike[length]:
        lines = f"in lines of {likeliest} than of {length}"
        return f"its places are more alike {lines}, as if the descriptor were cut off, or of a narrow image"
    return f"its places in lines of {length} are not alike, as if they were in another order"


def _compare_lines(array: NDArray[np.floating], candidate: Candidate) -> tuple[int, list[float]]:
    """The places in a line, as they are stored, and the correlations by distance; none for a single line."""
    indices = np.arange(array.size // candidate.count, dtype=np.float64)
    order = candidate.descriptors(indices)[0, ..., 0]
    if min(order.shape) < 2:
        return 0, []
    in_columns = bool(order[0, 1] > order[1, 0])
    return order.shape[0 if in_columns else 1], _correlations(candidate, array, in_columns=in_columns)


def _correlations(candidate: Candidate, array: NDArray[np.floating], *, in_columns: bool) -> list[float]:
    """Of the histograms at so many places from each other, in the order in which they are stored."""
    descriptors = candidate.descriptors(array)
    high, wide = candidate.spec.normalizer.layout_block or (1, 1)
    cells = descriptors.reshape(*descriptors.shape[:3], high, wide, -1)
    lines = (cells.transpose(1, 2) if in_columns else cells).flatten(1, 2)  # (B, places, high, wide, bins)
    axis = 3 if in_columns else 2
    common = max(lines.shape[axis] - 1, 1)
    first, second = (_normalize(lines.narrow(axis, start, common)) for start in (lines.shape[axis] - common, 0))
    count = lines.shape[1]
    spectra = [torch.fft.rfft(histograms, 2 * count, dim=1) for histograms in (first, second)]
    sums = torch.fft.irfft((spectra[0].conj() * spectra[1]).sum(dim=(0, 2)), 2 * count)[:count]
    energy = (first.square().sum() * second.square().sum()).sqrt() / count
    means: list[float] = (sums / torch.arange(count, 0, -1) / energy).tolist()
    return means


def _normalize(histograms: Tensor) -> Tensor:
    """Of cells (B, places, high, wide, bins), each of length 1, as they differ from the mean, (B, places, channels)."""
    of_length_1 = normalize(histograms, dim=4)
    return (of_length_1 - of_length_1.mean(dim=1, keepdim=True)).flatten(2)


def describe_axes(array: NDArray[np.floating], candidate: Candidate) -> str:
    """What more holds of than of the three axes as they were found, as a sentence; empty if there is nothing."""
    tolerance = find_tolerance(array)
    held = identities_that_hold(array, candidate, tolerance) or ()
    for axes in itertools.permutations(range(3)):
        turned = array.transpose(axes)
        for other in fit_shape(turned.shape, None, {candidate.preset: candidate.parameters}):
            if other.spec == candidate.spec and other.count == 1:
                holding = identities_that_hold(turned, other, tolerance)
                if holding is not None and len(holding) > len(held):
                    return f"more holds of its axes in another order: transpose{axes}"
    if candidate.spec.normalizer.layout_block:
        length, alike = _compare_lines(array, candidate)
        for other in fit_shape((array.size,), None, {candidate.preset: candidate.parameters}):
            flat_length, flat_alike = _compare_lines(array.reshape(-1), other)
            if other.count > 1 or not (alike and flat_alike) or other.image_size == candidate.image_size:
                continue
            if flat_alike[flat_length] > alike[length] - SAME:
                size = "x".join(map(str, other.image_size))
                return f"its places are as much alike as those of one row, ravel(), of {other.preset} of {size}"
    return ""
