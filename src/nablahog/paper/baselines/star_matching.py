"""Star matching (Aubry et al.): elements of a view in an image, where the view's layout expects them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating]
Integers = NDArray[np.int64]

NOTHING = -1e9  # what an element scores where it cannot be
UNLIKE = 1e6  # penalty of a detection whose box is not the object's: it wins only where there is no other
AT_ONCE = 10_000  # roots that are looked up together
AROUND = [(row, col) for row in (-1, 0, 1) for col in (-1, 0, 1)]  # of a cell, itself in the middle


class Pyramid(NamedTuple):
    """The levels of an image's pyramid.

    Attributes:
        rows, cols: (L,), of each level, how many positions an element has.
        start: (L + 1,), where the positions of each level begin, row by row.
        cell: pixels of a cell.
        octave: levels an octave.
    """

    rows: Integers
    cols: Integers
    start: Integers
    cell: float
    octave: float


class Layout(NamedTuple):
    """Where the elements of views lie: attributes of :class:`.exemplar_views.ExemplarViews`, as arrays."""

    level: Integers
    positions: Integers
    first: Integers
    boxes: Floats


class Roots(NamedTuple):
    """Elements that score highest at a place, each (R,)."""

    element: Integers
    level: Integers
    row: Integers
    col: Integers


def star_match(scores: Floats, pyramid: Pyramid, layout: Layout, expected: Floats, agreement: float) -> Floats:
    """The best detection of each view.

    Each element in turn is the root.  At each level, its local maxima above 0 say where the rendering lies in the
    image, and in what size; no two maxima are within a cell of each other.  Every other element of the view then has a
    place and a level, and adds its score, see :func:`_confidence`.

    Args:
        scores: (E, P), calibrated scores of elements at all positions of all levels; NOTHING where not computed.
        pyramid: of the image.
        layout: of the views' elements.
        expected: (4,): x0, y0, x1, y1 of the object, pixels of the image.
        agreement: the least intersection over union of its box with that of a detection.

    Returns:
        (V, 7): rank, confidence, number of elements that score above 0, and the detection's x0, y0, x1, y1; -inf if no
        element scores above 0 anywhere.
    """
    detections = np.full((len(layout.first) - 1, 7), -np.inf)
    roots = _local_maxima(scores, pyramid)
    for start in range(0, len(roots.element), AT_ONCE):
        some = Roots(*(part[start : start + AT_ONCE] for part in roots))
        view = np.searchsorted(layout.first, some.element, side="right") - 1
        larger = some.level - layout.level[some.element]  # levels by which the view is larger than it was rendered
        pixels = pyramid.cell * 2.0 ** (some.level / pyramid.octave)
        row, col = layout.positions[some.element].T
        x, y = (some.col - col) * pixels, (some.row - row) * pixels
        confidence, inliers = _confidence(scores, pyramid, layout, some, view, larger, x, y)
        boxes = layout.boxes[view] * 2.0 ** (larger / pyramid.octave)[:, np.newaxis] + np.stack([x, y, x, y], axis=1)
        rank = confidence + np.minimum(0, inliers - 5) - UNLIKE * ~_agree(boxes, expected, agreement)
        found = np.column_stack([rank, confidence, inliers, boxes])
        order = np.lexsort([-rank, view])
        views, best = np.unique(view[order], return_index=True)
        better = found[order[best]]
        detections[views] = np.where(better[:, :1] > detections[views, :1], better, detections[views])
    return detections


def _local_maxima(scores: Floats, pyramid: Pyramid) -> Roots:
    """The highest scores above 0 of each element at each level, none within a cell of a higher one; in this order."""
    element, place = np.divmod(np.flatnonzero(scores > 0), scores.shape[1])
    level = np.searchsorted(pyramid.start, place, side="right") - 1
    row, col = np.divmod(place - pyramid.start[level], pyramid.cols[level])
    # numbers of these places in levels with a border, and which of the places are around each of them
    width, sizes = pyramid.cols[level] + 2, (pyramid.rows + 2) * (pyramid.cols + 2)
    at = element * sizes.sum() + (sizes.cumsum() - sizes)[level] + (row + 1) * width + col + 1
    near = at[:, np.newaxis] + np.stack([down * width + right for down, right in AROUND], axis=1)
    around = np.searchsorted(at, near).clip(max=len(at) - 1)
    is_place = at[around] == near
    left = scores[element, place]
    highest = np.zeros(len(at), bool)
    while left.any():
        new = (left > 0) & (np.where(is_place, left[around], 0).argmax(axis=1) == len(AROUND) // 2)
        highest |= new
        left[around[new][is_place[new]]] = 0
    roots = Roots(*(part[highest] for part in (element, level, row, col)))
    order = np.lexsort([-scores[element, place][highest], roots.level, roots.element])
    return Roots(*(part[order] for part in roots))


def _confidence(
    scores: Floats,
    pyramid: Pyramid,
    layout: Layout,
    roots: Roots,
    view: Integers,
    larger: Integers,
    x: Floats,
    y: Floats,
) -> tuple[Floats, Integers]:
    """Sums (R,) of the scores of each view's elements, and how many are above 0, (R,).

    The roots say that the views (R,) lie at x, y, pixels of the image, ``larger`` levels larger than they were
    rendered.  An element counts with its best score within a cell of its place.  One that reaches beyond the image
    counts only if above 0, one beyond the pyramid not at all.
    """
    elements = layout.first[view, np.newaxis] + np.arange(np.diff(layout.first).max())  # (R, elements of a view)
    exists = elements < layout.first[view + 1, np.newaxis]
    elements = np.where(exists, elements, 0)
    level = layout.level[elements] + larger[:, np.newaxis]
    exists &= (level >= 0) & (level < len(pyramid.rows))
    level = np.where(exists, level, 0)
    cells = 2.0 ** (-level / pyramid.octave) / pyramid.cell
    row, col = (
        np.rint(layout.positions[elements, axis] + at[:, np.newaxis] * cells).astype(np.int64)
        for axis, at in enumerate((y, x))
    )
    best = np.full(elements.shape, NOTHING)
    for down, right in AROUND:
        inside, score = _looked_up(scores, pyramid, elements, level, row + down, col + right)
        best = np.where(inside, np.maximum(best, score), best)
    inside, _ = _looked_up(scores, pyramid, elements, level, row, col)
    _, own = _looked_up(scores, pyramid, *roots)
    best = np.where(elements == roots.element[:, np.newaxis], own[:, np.newaxis], best)
    best = np.where(inside & (best != NOTHING), best, best.clip(min=0)) * exists
    return best.sum(axis=1), (best > 0).sum(axis=1)


def _looked_up(
    scores: Floats, pyramid: Pyramid, elements: Integers, level: Integers, row: Integers, col: Integers
) -> tuple[NDArray[np.bool_], Floats]:
    """Whether places are inside of their levels, and the scores of elements there; anything elsewhere."""
    rows, cols = pyramid.rows[level], pyramid.cols[level]
    inside = (row >= 0) & (row < rows) & (col >= 0) & (col < cols)
    places = np.where(inside, pyramid.start[level] + row * cols + col, 0)
    return inside, scores[elements, places]


def _agree(boxes: Floats, expected: Floats, agreement: float) -> NDArray[np.bool_]:
    """Whether the intersections over union of boxes (R, 4) with the expected one are at least ``agreement``, (R,)."""
    wide, high = (np.minimum(boxes[:, 2:], expected[2:]) - np.maximum(boxes[:, :2], expected[:2])).clip(min=0).T
    of_both = (boxes[:, 2:] - boxes[:, :2]).prod(axis=1) + (expected[2:] - expected[:2]).prod()
    agree: NDArray[np.bool_] = wide * high >= agreement * (of_both - wide * high)
    return agree
