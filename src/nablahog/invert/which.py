"""Which HOG an array of unknown origin is: checks in order, from counting to inverting, until one decides."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..inputs.arrays import as_array
from ..inputs.numbers import as_size, shortened
from ..io.descriptor_file import is_row
from .alignment import describe_axes, describe_lines
from .assumptions import describe_assumptions
from .candidates import WINDOWED, Candidate, Parameters, check_dialects, fit_shape
from .exactness import COARSEST, check_identities, describe_rearranged, find_parts, find_step, restore
from .orders import check_distance, check_layout, check_order
from .windows import describe_seams, find_windows

CONSTANT = "its numbers are all equal, which says nothing about where they are from"
ROUNDED = "its numbers are rounded, to steps in which nothing exact shows: save five decimals or more"
MOST_NAMED = 3  # candidates in a summary
NOTHING_FITS = "no preset fits; `dialects` tries other parameters, such as {'skimage': {'pixels_per_cell': (16, 16)}}"
MOST_ROWS = 64  # of a matrix of vectors, which are checked
MOST_CHECKED = 2**20  # numbers that are checked; of longer vectors, only the shape is


@dataclass(frozen=True)
class WhichHOG:
    """What an array is.

    Attributes:
        candidates: what it can be, the likeliest first; empty if no preset makes such an array.
        likely: the number of the first candidates between which no check decides; 0 if none was made.
        decided_by: the check that leaves only the first, as a sentence; empty if none does.
        assumed: what no check tells of the first, as a clause, if it was decided and there is something.
        remark: why nothing was decided, as a sentence, of numbers that are scaled, in reverse order, rounded or all
            equal, that look like several descriptors in one row, that are more alike in lines of another length, or
            that are a descriptor if they are flattened, transposed or without a column.  Of scaled and reversed ones,
            the candidates are those of the numbers as they were before.
    """

    candidates: tuple[Candidate, ...]
    likely: int = 0
    decided_by: str = ""
    assumed: str = ""
    remark: str = ""

    def __repr__(self) -> str:
        """The dialect, what decided and what is assumed; or the first few of what the checks leave."""
        if self.decided_by:
            assumed = f"; {self.assumed}" if self.assumed else ""
            return f"<WhichHOG {self.candidates[0].summary}, because {self.decided_by}{assumed}>"
        likely = self.candidates[: min(self.likely or MOST_NAMED, MOST_NAMED)]
        more = f", … ({len(self.candidates)} in all)" if len(self.candidates) > len(likely) else ""
        remark = f"; {self.remark}" if self.remark else ""
        if not likely:
            return f"<WhichHOG undecided: {self.remark or NOTHING_FITS}>"
        return f"<WhichHOG undecided: {', or '.join(each.summary for each in likely)}{more}{remark}>"


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
        ValueError: there is no such preset, or it has no such parameter or value; or the array holds NaN or Inf, or
            masks some entries.

    >>> vector = nablahog.hog(np.random.default_rng(0).random((64, 48), np.float32), "skimage", layout="native")
    >>> found = nablahog.which_hog(vector)
    >>> found.candidates[0].preset, found.candidates[0].image_size
    ('skimage', (64, 48))
    """
    array = as_array("the descriptor", array)
    if not array.ndim:
        raise ValueError("the descriptor must be an array of one axis or more, got one number: pass all of them")
    if not array.size:  # NumPy takes forever for 10¹⁰ rows of no numbers
        return WhichHOG(())
    if not np.isfinite(array).all():
        raise ValueError("the descriptor must be finite, got NaN or Inf")
    if dialects is not None and not isinstance(dialects, Mapping):
        raise TypeError(
            "dialects must be a dict of known parameters by preset, got "
            f"{shortened(dialects)}: write {{'uoctti': {{}}}} of one"
        )
    check_dialects(dialects or {})
    if array.size > 1 and (array == array.flat[0]).all():
        return WhichHOG((), remark=CONSTANT)
    size = None if image_size is None else as_size("image_size", image_size)
    found = _find(array, size, dialects)
    if found.decided_by or found.remark or array.ndim != 2 or is_row(array.shape):
        return found
    return replace(found, remark=describe_rearranged(array, size, dialects))


def _find(
    array: NDArray[np.floating], size: tuple[int, int] | None, dialects: Mapping[str, Parameters] | None
) -> WhichHOG:
    """Makes the checks in order."""
    fitting = sorted(fit_shape(array.shape, size, dialects), key=_rank_by_shape)
    # no descriptor has negative entries, and one that is 0 satisfies all
    if not array.any() or (array < 0).any() or array[:1].size > MOST_CHECKED:
        return WhichHOG(tuple(fitting))
    windows = [each for each in fitting if each.count > 1] if is_row(array.shape) else []
    known = ({WINDOWED: {}} if dialects is None else dialects).get(WINDOWED)
    any_size = None if size is not None or "win_size" in (known or ()) else known
    overlapping = find_windows(array, fitting, any_size) if is_row(array.shape) else []
    if not fitting and not overlapping:
        return WhichHOG(())
    checked = array.reshape(overlapping[0].count, -1) if len(overlapping) == 1 else array
    if not is_row(checked.shape) and all(each.count > 1 for each in overlapping or fitting):
        checked = checked[:MOST_ROWS]
    if find_step(checked) > COARSEST:
        return WhichHOG(tuple(overlapping or fitting), remark=ROUNDED)
    remaining, excluded, identities = check_identities(checked, overlapping or fitting)
    if not identities and not overlapping and size is None and is_row(array.shape):
        parts, remark = find_parts(array, dialects)
        if parts:
            return WhichHOG((*parts, *fitting), len(parts), remark=remark)
    is_contradicted = not remaining
    # numbers of which nothing exact holds may be another library's, unless the dialect is known
    is_known = bool(identities or overlapping) or (len(dialects or ()) == 1 and not is_contradicted)
    remaining = remaining or overlapping or fitting
    decided_by = identities or "no other size has so many numbers"
    # windows side by side have pre-images as another size of image has
    for check in (check_layout, check_order) if windows else (check_layout, check_order, check_distance):
        if len(remaining) == 1:
            break
        remaining, excluded_now, sentence = check(checked, remaining)
        excluded = [*excluded_now, *excluded]
        decided_by = f"{identities}, and {sentence}" if identities else sentence
    if overlapping:
        excluded += [each for each in fitting if each not in overlapping]
        count, length = remaining[0].count, math.prod(remaining[0].how.shape)
        shared = f"its {count} windows have blocks in common: reshape({count}, {length})"
        decided_by = f"{decided_by}, and {shared}" if identities or len(overlapping) > 1 else shared
    ranked = (*remaining, *excluded)
    if not is_known:
        remark, original = restore(array, checked, fitting)
        if original is None:
            if is_contradicted:
                names = dict.fromkeys(each.preset for each in fitting)
                remark = ", and ".join(filter(None, (f"its numbers contradict {' and '.join(names)}", remark)))
            return WhichHOG(ranked, len(ranked), remark=remark)
        # something exact holds of it, so that nothing is restored again
        return replace(_find(original, size, dialects), decided_by="", assumed="", remark=remark)
    # windows without blocks in common look like one image of all their columns
    is_sure = len(remaining) == 1 and (bool(overlapping) or size is not None or remaining[0] not in windows)
    single = is_row(checked.shape) and remaining[0].count == 1
    doubts = describe_seams(checked, remaining[0]) if is_sure and single and size is None else ""
    if is_sure and not doubts and not overlapping and size is None:
        doubts = describe_lines(checked, remaining[0])
    if is_sure and not doubts and array.ndim == 3:
        doubts = describe_axes(array, remaining[0])
    if doubts or not is_sure:
        return WhichHOG(ranked, len(remaining), remark=doubts)
    return WhichHOG(ranked, 1, decided_by, describe_assumptions(ranked[0], is_size_known=size is not None))


def _rank_by_shape(candidate: Candidate) -> tuple[bool, bool, int]:
    """Smaller for a whole array in its library's own layout, with few parameters that are not defaults."""
    return candidate.count > 1, candidate.how.layout != candidate.spec.layout, len(candidate.parameters)
