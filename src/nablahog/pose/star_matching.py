"""Star matching (Aubry et al.): elements of a view in an image, where the view's layout expects them."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..runtime.compile import compiled

NOTHING = -1e9  # what an element scores where it cannot be
UNLIKE = 1e6  # taken off a detection whose box is not the object's: it is the best only where there is no other


@compiled
def star_match(
    scores: Any,
    rows: Any,
    cols: Any,
    start: Any,
    level: Any,
    positions: Any,
    first: Any,
    boxes: Any,
    cell: float,
    octave: float,
    expected: Any,
    agreement: float,
    detections: Any,
) -> None:
    """The best detection of each view.

    Each element in turn is the root.  At each level, its local maxima above 0 say where the rendering lies in the
    image, and in what size; no two maxima are within a cell of each other.  Every other element of the view then has a
    place and a level, and adds its score, see :func:`_confidence`.

    Args:
        scores: (E, P), calibrated scores of elements at all positions of all levels; NOTHING where not computed.
        rows, cols, start: (L,), of each level the positions, and where they begin in P, row by row.
        level, positions, first, boxes: of :class:`.exemplar_views.ExemplarViews`.
        cell: pixels of a cell.
        octave: levels an octave.
        expected: (4,): x0, y0, x1, y1 of the object, pixels of the image.
        agreement: the least intersection over union of its box with that of a detection.
        detections: (V, 7), output: rank, confidence, number of elements that score above 0, and the detection's x0, y0,
            x1, y1; a rank of -inf if no element scores above 0 anywhere.
    """
    free = np.empty(scores.shape[1], scores.dtype)
    for view in range(len(first) - 1):
        detections[view, 0] = -np.inf
        for root in range(first[view], first[view + 1]):
            for at in range(len(rows)):
                n = cols[at]
                places = scores[root, start[at] : start[at] + rows[at] * n]
                left = free[: len(places)]
                left[:] = places
                larger = at - level[root]
                zoom = 2.0 ** (larger / octave)
                while True:
                    best = np.argmax(left)
                    if left[best] <= 0:
                        break
                    y, x = best // n, best % n
                    for row in range(max(0, y - 1), min(rows[at], y + 2)):
                        left[row * n + max(0, x - 1) : row * n + min(n, x + 2)] = NOTHING
                    pixels = cell * 2.0 ** (at / octave)
                    top, side = (y - positions[root, 0]) * pixels, (x - positions[root, 1]) * pixels
                    members = first[view], first[view + 1]
                    confidence, inliers = _confidence(
                        scores, rows, cols, start, level, positions, members, cell, octave, root, places[best], larger,
                        top, side,
                    )  # fmt: skip
                    box = boxes[view] * zoom
                    x0, y0, x1, y1 = box[0] + side, box[1] + top, box[2] + side, box[3] + top
                    rank = confidence + min(0, inliers - 5)
                    if not _agrees(x0, y0, x1, y1, expected, agreement):
                        rank -= UNLIKE
                    if rank > detections[view, 0]:
                        detections[view, 0], detections[view, 1], detections[view, 2] = rank, confidence, inliers
                        detections[view, 3], detections[view, 4] = x0, y0
                        detections[view, 5], detections[view, 6] = x1, y1


@compiled
def _confidence(
    scores: Any,
    rows: Any,
    cols: Any,
    start: Any,
    level: Any,
    positions: Any,
    members: Any,
    cell: float,
    octave: float,
    root: int,
    root_score: float,
    larger: int,
    top: float,
    side: float,
) -> Any:
    """Sum of the scores of a view's elements, and how many are above 0.

    An element counts with its best score within a cell of its place.  One that reaches beyond the image counts only if
    above 0, one beyond the pyramid not at all.

    Args:
        members: first element of the view, and of the next view.
        root: the element that says where the view lies, with its score.
        larger: levels that the view is larger than it was rendered.
        top, side: y and x of the view's upper left corner, pixels of the image.
    """
    confidence, inliers = 0.0, 0
    for element in range(members[0], members[1]):
        there = level[element] + larger
        if there < 0 or there >= len(rows):
            continue
        cells = 2.0 ** (-there / octave) / cell
        row = int(np.rint(positions[element, 0] + top * cells))
        col = int(np.rint(positions[element, 1] + side * cells))
        score = NOTHING
        for i in range(max(0, row - 1), min(rows[there], row + 2)):
            for j in range(max(0, col - 1), min(cols[there], col + 2)):
                score = max(score, scores[element, start[there] + i * cols[there] + j])
        if element == root:
            score = root_score
        inside = 0 <= row < rows[there] and 0 <= col < cols[there]
        if score == NOTHING or not inside:
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
