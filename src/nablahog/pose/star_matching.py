"""Star matching (Aubry et al.): elements of a view in an image, where the view's layout expects them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..runtime.compile import compiled

NOTHING = -1e9  # what an element scores where it cannot be
UNLIKE = 1e6  # taken off a detection whose box is not the object's: it is the best only where there is no other


class Pyramid(NamedTuple):
    """The levels of an image's pyramid.

    Attributes:
        rows, cols: (L,), of each level, how many positions an element has.
        start: (L + 1,), where the positions of each level begin, row by row.
        cell: pixels of a cell.
        octave: levels an octave.
    """

    rows: Any
    cols: Any
    start: Any
    cell: float
    octave: float


class Layout(NamedTuple):
    """Where the elements of views lie: attributes of :class:`.exemplar_views.ExemplarViews`, as arrays."""

    level: Any
    positions: Any
    first: Any
    boxes: Any


@compiled
def star_match(scores: Any, pyramid: Pyramid, layout: Layout, expected: Any, agreement: float, detections: Any) -> None:
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
        detections: (V, 7), output: rank, confidence, number of elements that score above 0, and the detection's x0, y0,
            x1, y1; a rank of -inf if no element scores above 0 anywhere.
    """
    free = np.empty(scores.shape[1], scores.dtype)
    for view in range(len(layout.first) - 1):
        detections[view, 0] = -np.inf
        for root in range(layout.first[view], layout.first[view + 1]):
            for level in range(len(pyramid.rows)):
                n = pyramid.cols[level]
                root_scores = scores[root, pyramid.start[level] : pyramid.start[level] + pyramid.rows[level] * n]
                left = free[: len(root_scores)]
                left[:] = root_scores
                larger = level - layout.level[root]
                box = layout.boxes[view] * 2.0 ** (larger / pyramid.octave)
                pixels = pyramid.cell * 2.0 ** (level / pyramid.octave)
                while True:
                    best = np.argmax(left)
                    if left[best] <= 0:
                        break
                    row, col = best // n, best % n
                    for near in range(max(0, row - 1), min(pyramid.rows[level], row + 2)):
                        left[near * n + max(0, col - 1) : near * n + min(n, col + 2)] = NOTHING
                    x, y = (col - layout.positions[root, 1]) * pixels, (row - layout.positions[root, 0]) * pixels
                    confidence, inliers = _confidence(
                        scores, pyramid, layout, view, root, root_scores[best], larger, x, y
                    )
                    x0, y0, x1, y1 = box[0] + x, box[1] + y, box[2] + x, box[3] + y
                    rank = confidence + min(0, inliers - 5)
                    if not _agrees(x0, y0, x1, y1, expected, agreement):
                        rank -= UNLIKE
                    if rank > detections[view, 0]:
                        best_detection = detections[view]
                        best_detection[0], best_detection[1], best_detection[2] = rank, confidence, inliers
                        best_detection[3], best_detection[4], best_detection[5], best_detection[6] = x0, y0, x1, y1


@compiled
def _confidence(
    scores: Any,
    pyramid: Pyramid,
    layout: Layout,
    view: int,
    root: int,
    root_score: float,
    larger: int,
    x: float,
    y: float,
) -> tuple[float, int]:
    """Sum of the scores of a view's elements, and how many are above 0.

    The root says that the view lies at x, y, pixels of the image, ``larger`` levels larger than it was rendered.  An
    element counts with its best score within a cell of its place.  One that reaches beyond the image counts only if
    above 0, one beyond the pyramid not at all.
    """
    confidence, inliers = 0.0, 0
    for element in range(layout.first[view], layout.first[view + 1]):
        level = layout.level[element] + larger
        if level < 0 or level >= len(pyramid.rows):
            continue
        rows, cols, start = pyramid.rows[level], pyramid.cols[level], pyramid.start[level]
        cells = 2.0 ** (-level / pyramid.octave) / pyramid.cell
        row = int(np.rint(layout.positions[element, 0] + y * cells))
        col = int(np.rint(layout.positions[element, 1] + x * cells))
        score = NOTHING
        for i in range(max(0, row - 1), min(rows, row + 2)):
            for j in range(max(0, col - 1), min(cols, col + 2)):
                score = max(score, scores[element, start + i * cols + j])
        if element == root:
            score = root_score
        if score == NOTHING or not (0 <= row < rows and 0 <= col < cols):
            score = max(score, 0.0)
        confidence += score
        inliers += score > 0
    return confidence, inliers


@compiled
def _agrees(x0: float, y0: float, x1: float, y1: float, expected: Any, agreement: float) -> bool:
    """Whether the intersection over union with the expected box is at least ``agreement``."""
    high = max(0.0, min(y1, expected[3]) - max(y0, expected[1]))
    wide = max(0.0, min(x1, expected[2]) - max(x0, expected[0]))
    union = (y1 - y0) * (x1 - x0) - high * wide
    union += (expected[3] - expected[1]) * (expected[2] - expected[0])
    agrees: bool = high * wide >= agreement * union
    return agrees
