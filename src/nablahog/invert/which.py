"""Which HOG an array of unknown origin is: checks in order, from counting to inverting, until one decides."""

from __future__ import annotations

import inspect
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import normalize

from ..hog import HOGSpec, presets
from ..hog.layout import TOKEN_CELLS, from_layout
from ..hog.steps import split_colours
from ..inputs.arrays import as_array
from ..inputs.numbers import as_size, shortened
from ..io.descriptor_file import FittedLayout, find_layout, is_row
from .preimage import reconstruct

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
MOST_NAMED = 3  # candidates in a summary
MOST_ASPECT = 4  # of the sides of an image
MOST_ROWS = 64  # of a matrix of vectors, which are checked
MOST_CHECKED = 2**20  # numbers that are checked; of longer vectors, only the shape is
ROUNDING = 32  # units in the last place that a sum of entries may be off
CLEARLY_ALIKE, ALIKE_PLACES = 1.5, 64  # times less alike are neighbours in a wrong order, in 8x8 places of one image
CLEARLY_NEARER = 2.0  # times as far is the pre-image of the wrong dialect
MOST_INVERTED, MOST_INVERTED_PIXELS = 6, 2**15  # candidates, and pixels of each, that are inverted


@dataclass(frozen=True)
class Candidate:
    """A dialect, a layout and a size of which an array can be the descriptor, or several in its rows.

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
        return f"{self.preset}({parameters}) of {self.image_size[0]}x{self.image_size[1]}"

    def descriptors(self, array: NDArray[np.floating]) -> Tensor:
        """The array as descriptors (B, rows, cols, channels) in float64."""
        native = torch.from_numpy(np.ascontiguousarray(array, np.float64)).reshape(-1, *self.how.shape)
        return from_layout(native, replace(self.spec, layout=self.how.layout), self.image_size)


@dataclass(frozen=True)
class WhichHOG:
    """What an array is.

    Attributes:
        candidates: what it can be, the likeliest first; empty if no preset makes such an array.
        likely: the number of the first candidates between which no check decides; 0 if none was made.
        decided_by: the check that leaves only the first, as a sentence; empty if none does.
    """

    candidates: tuple[Candidate, ...]
    likely: int = 0
    decided_by: str = ""

    def __repr__(self) -> str:
        """The dialect and what decided, or all that the checks leave."""
        if self.decided_by:
            return f"<WhichHOG {self.candidates[0].summary}, because {self.decided_by}>"
        likely = self.candidates[: self.likely or MOST_NAMED]
        more = f", … ({len(self.candidates)} in all)" if len(self.candidates) > len(likely) else ""
        return f"<WhichHOG undecided: {', or '.join(each.summary for each in likely) or 'no preset fits'}{more}>"


def which_hog(
    array: NDArray[np.floating],
    image_size: Sequence[int] | None = None,
    *,
    dialects: Mapping[str, Parameters] | None = None,
) -> WhichHOG:
    """Finds the preset, layout and image size of a descriptor of unknown origin, by the first check that decides.

    1. The shape: which presets, with which usual parameters, orders of axes and sizes have so many numbers.
    2. What the normaliser of each makes hold exactly, such as lengths of blocks, clipped entries, sums of channels, and
       histograms that several blocks share.  One that does not hold excludes a dialect.
    3. The order: neighbouring entries are more alike in the right number of columns.
    4. A fast inversion by each that is left: the right one comes nearer to the descriptor.

    Args:
        array: one descriptor in the layout of a library or in one row, or a row for each of several; also a list, a
            tensor, or a column of a data frame.
        image_size: (height, width) of its image, if it is known.
        dialects: presets to try, with parameters that are known; by default all.  The size of cells cannot be told
            from an array: it is the preset's, unless it is given here.

    Returns:
        The candidates, the likeliest first, and the check that decided, if one did.

    Raises:
        TypeError: the array holds no real numbers, or vectors of different lengths; or ``dialects`` is no dict.
        ValueError: a parameter is none of its preset's, or the array holds NaN or Inf, or masks some entries.

    >>> vector = nablahog.hog(np.random.default_rng(0).random((64, 48), np.float32), "skimage", layout="native")
    >>> found = nablahog.which_hog(vector)
    >>> found.candidates[0].preset, found.candidates[0].image_size
    ('skimage', (64, 48))
    """
    array = as_array("the descriptor", array)
    if not array.ndim:
        raise ValueError("the descriptor must be an array of one axis or more, got one number: pass all of them")
    if not np.isfinite(array).all():
        raise ValueError("the descriptor must be finite, got NaN or Inf")
    if dialects is not None and not isinstance(dialects, Mapping):
        raise TypeError(
            "dialects must be a dict of known parameters by preset, got "
            f"{shortened(dialects)}: write {{'uoctti': {{}}}} of one"
        )
    size = None if image_size is None else as_size("image_size", image_size)
    fitting = sorted(fit_shape(array.shape, size, dialects), key=_strangeness)
    # no descriptor has negative entries, and one that is 0 satisfies all
    if not fitting or not array.any() or (array < 0).any() or array[:1].size > MOST_CHECKED:
        return WhichHOG(tuple(fitting))
    checked = array[:MOST_ROWS] if all(candidate.count > 1 for candidate in fitting) else array
    left, rest, told = _check_identities(checked, fitting)
    # numbers of which nothing exact holds may be another library's, unless the dialect is known
    sure, decided_by = bool(told) or len(dialects or ()) == 1, told or "no other size has so many numbers"
    for check in (_check_layout, _check_order, _check_distance):
        if len(left) == 1:
            break
        left, others, sentence = check(checked, left)
        rest, decided_by = [*others, *rest], f"{told}, and {sentence}" if told else sentence
    ranked = (*left, *rest)
    if not sure:
        return WhichHOG(ranked, len(ranked))
    return WhichHOG(ranked, len(left), decided_by if len(left) == 1 else "")


def fit_shape(
    shape: tuple[int, ...], image_size: tuple[int, int] | None, dialects: Mapping[str, Parameters] | None = None
) -> Iterator[Candidate]:
    """All candidates of which an array of this shape holds one descriptor, or in two axes one in each row."""
    for name, known in (dialects or {preset: {} for preset in presets.__all__}).items():
        for parameters in _variants(name, known):
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


def _strangeness(candidate: Candidate) -> tuple[bool, bool, int]:
    """A smaller one for a whole array in its library's own layout, with few parameters that are not defaults."""
    return candidate.count > 1, candidate.how.layout != candidate.spec.layout, len(candidate.parameters)


def _variants(name: str, known: Parameters) -> Iterator[Parameters]:
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


def _with_window(name: str, parameters: Parameters, size: tuple[int, int]) -> Parameters:
    """The parameters with OpenCV's window, (width, height), if it is not the default."""
    if name != "opencv" or "win_size" in parameters or size == (128, 64):
        return parameters
    return {**parameters, "win_size": size[::-1]}


Checked = tuple[list[Candidate], list[Candidate], str]
"""Candidates that are left after a check, those that it excludes, and what holds, as a sentence."""


def _check_identities(array: NDArray[np.floating], candidates: list[Candidate]) -> Checked:
    """Leaves those of which most identities of their normalisers hold, and none fails."""
    precision = np.finfo(np.float16 if array.dtype == np.float16 else np.float32).eps
    scores = [_identities_that_hold(array, candidate, ROUNDING * float(precision)) for candidate in candidates]
    best = max((len(score) for score in scores if score is not None), default=0)
    left = [each for each, score in zip(candidates, scores, strict=True) if score is not None and len(score) == best]
    possible = [each for each, score in zip(candidates, scores, strict=True) if score is not None]
    sentences = next((score for score in scores if score is not None and len(score) == best), [])
    exact = [sentence for sentence, share in sentences if share]
    told = ", and ".join(dict.fromkeys(exact))
    return left or candidates, [each for each in possible if each not in left], told


def _identities_that_hold(
    array: NDArray[np.floating], candidate: Candidate, tolerance: float
) -> list[tuple[str, float]] | None:
    """The sentences of the identities that hold, with their shares; None if one does not."""
    spec = candidate.spec.single_colour
    channels = split_colours(candidate.descriptors(array), candidate.spec).permute(0, 3, 1, 2)
    holding: list[tuple[str, float]] = []
    for identity in spec.normalizer.identities(channels, spec.bins, spec.signed, tolerance):
        if not identity.errors.numel():
            continue
        share = float((identity.errors.abs() <= tolerance).double().mean())
        if share < identity.share:
            return None
        if share and not identity.is_bound:
            holding.append((identity.sentence, identity.share))
    return holding


def _check_layout(array: NDArray[np.floating], candidates: list[Candidate]) -> Checked:
    """Leaves those whose libraries return this array, or else this order of axes."""
    own = [each for each in candidates if each.how.layout == each.spec.layout]
    own = [each for each in own if each.how.shape == array.shape and not is_row(array.shape)] or own
    if not own:
        return candidates, [], ""
    others = [each for each in candidates if each not in own]
    return own, others, f"the order of the axes is that of {own[0].preset}" if others else ""


def _check_order(array: NDArray[np.floating], candidates: list[Candidate]) -> Checked:
    """Leaves those numbers of columns in which neighbours are clearly alike."""
    alike = [_difference_of_neighbours(each, array) for each in candidates]
    order = sorted(range(len(candidates)), key=alike.__getitem__)
    places = array.size / candidates[0].spec.channels
    clearly = CLEARLY_ALIKE ** math.sqrt(ALIKE_PLACES / places)  # as the scatter of means falls
    left = [candidates[k] for k in order if alike[k] < clearly * alike[order[0]]]
    others = [candidates[k] for k in order if candidates[k] not in left]
    return left, others, f"neighbours are most alike in an image of {'x'.join(map(str, left[0].image_size))} pixels"


def _difference_of_neighbours(candidate: Candidate, array: NDArray[np.floating]) -> float:
    """The mean squared difference of neighbouring histograms, of their variance, along the axis where it is larger.

    Of blocks, those of the cells that two blocks share.  Inf for a single row or column.
    """
    descriptors = normalize(candidate.descriptors(array), dim=3)  # else a few strong ones decide
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
    return max(differences) / max(float(varying.square().mean()), 1e-30)


def _check_distance(array: NDArray[np.floating], candidates: list[Candidate]) -> Checked:
    """Leaves that whose pre-image is clearly the nearest."""
    if len(candidates) > MOST_INVERTED or any(math.prod(each.image_size) > MOST_INVERTED_PIXELS for each in candidates):
        return candidates, [], ""
    distances = [_distance(array, each) for each in candidates]
    order = sorted(range(len(candidates)), key=distances.__getitem__)
    ranked = [candidates[k] for k in order]
    first, second = (distances[k] for k in order[:2])
    if second < CLEARLY_NEARER * first:
        return ranked, [], ""
    return ranked[:1], ranked[1:], f"its pre-image comes as near as {first:.3f}, and that of the next {second:.3f}"


def _distance(array: NDArray[np.floating], candidate: Candidate) -> float:
    """The relative distance of the descriptor of a pre-image, found fast, of the first of an array's descriptors."""
    descriptor = candidate.descriptors(array)[:1].float()
    return float(reconstruct(descriptor, candidate.spec, candidate.image_size, quality="fast", prior=None).distance[0])
