"""Which of several candidates an array is, by the order of its numbers, and by inverting it."""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn.functional import normalize

from ..io.descriptor_file import is_row
from .candidates import Candidate
from .preimage import reconstruct

CLEARLY_ALIKE, ALIKE_PLACES = 1.5, 64  # times less alike are neighbours in a wrong order, in 8x8 places of one image
CLEARLY_NEARER = 2.0  # times as far is the pre-image of the wrong dialect
MOST_INVERTED, MOST_INVERTED_PIXELS = 6, 2**15  # candidates, and pixels of each, that are inverted

Checked = tuple[list[Candidate], list[Candidate], str]
"""Candidates that remain after a check, those that it excludes, and what holds, as a sentence."""


def check_layout(array: NDArray[np.floating], candidates: list[Candidate]) -> Checked:
    """Leaves those whose libraries return this array, or else this order of axes."""
    in_own_layout = [each for each in candidates if each.how.layout == each.spec.layout]
    of_own_shape = [each for each in in_own_layout if each.how.shape == array.shape and not is_row(array.shape)]
    remaining = of_own_shape or in_own_layout
    if not remaining:
        return candidates, [], ""
    excluded = [each for each in candidates if each not in remaining]
    return remaining, excluded, f"the order of the axes is that of {remaining[0].preset}" if excluded else ""


def check_order(array: NDArray[np.floating], candidates: list[Candidate]) -> Checked:
    """Leaves those numbers of columns in which neighbours are clearly alike."""
    differences = [_difference_of_neighbours(each, array) for each in candidates]
    order = sorted(range(len(candidates)), key=differences.__getitem__)
    places = array.size / candidates[0].spec.channels
    least, clearly = differences[order[0]], CLEARLY_ALIKE ** math.sqrt(ALIKE_PLACES / places)  # the scatter of means
    channels = candidates[order[0]].spec.channels
    # histograms of another length are alike by another measure, however many there are
    factors = [clearly if each.spec.channels == channels else max(clearly, CLEARLY_ALIKE) for each in candidates]
    remaining = [candidates[k] for k in order if differences[k] <= least or differences[k] < factors[k] * least]
    excluded = [candidates[k] for k in order if candidates[k] not in remaining]
    size = "x".join(map(str, remaining[0].image_size))
    return remaining, excluded, f"neighbours are most alike in an image of {size} pixels"


def _difference_of_neighbours(candidate: Candidate, array: NDArray[np.floating]) -> float:
    """The mean squared difference of neighbouring histograms, of their variance, along the axis where it is larger.

    Of blocks, those of the cells that two blocks share.  Inf for a single row or column, or for numbers too large.
    """
    descriptors = normalize(candidate.descriptors(array), dim=3)  # else a few strong ones decide
    if is_row(array.shape):  # several windows, or one
        descriptors = torch.cat(tuple(descriptors), dim=1)[None]
    varying = descriptors - descriptors.mean(dim=(1, 2), keepdim=True)
    high, wide = candidate.spec.normalizer.layout_block or (1, 1)
    histograms = varying.reshape(*varying.shape[:3], high, wide, -1)
    differences = []
    for axis, side in ((1, high), (2, wide)):
        places = histograms.shape[axis] - 1
        if places < 1:
            return math.inf
        first, second = (histograms.narrow(axis, start, places) for start in (0, 1))
        if side > 1:
            first, second = (x.narrow(2 + axis, start, side - 1) for x, start in ((first, 1), (second, 0)))
        differences.append(float((first - second).square().mean()))
    difference = max(differences) / max(float(varying.square().mean()), 1e-30)
    return math.inf if math.isnan(difference) else difference


def check_distance(array: NDArray[np.floating], candidates: list[Candidate]) -> Checked:
    """Leaves that whose pre-image is clearly the nearest."""
    if len(candidates) > MOST_INVERTED or any(math.prod(each.image_size) > MOST_INVERTED_PIXELS for each in candidates):
        return candidates, [], ""
    distances = [_distance(array, each) for each in candidates]
    order = sorted(range(len(candidates)), key=distances.__getitem__)
    ranked = [candidates[k] for k in order]
    first, second = (distances[k] for k in order[:2])
    if not second >= CLEARLY_NEARER * first:  # NaN: the numbers are too large
        return ranked, [], ""
    return ranked[:1], ranked[1:], f"its pre-image comes as near as {first:.3f}, and that of the next {second:.3f}"


def _distance(array: NDArray[np.floating], candidate: Candidate) -> float:
    """The relative distance of the descriptor of a pre-image, found fast, of the first of an array's descriptors."""
    descriptor = candidate.descriptors(array)[:1].float()
    return float(reconstruct(descriptor, candidate.spec, candidate.image_size, quality="fast", prior=None).distance[0])
