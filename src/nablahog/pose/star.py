"""Star matching (Aubry et al.): elements of a view found in an image where the view's layout expects them."""

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
    found: Any,
) -> None:
    """The best detection of each view.

    Each element in turn is the root: at each level, where it scores above 0, best first and never within a cell of a
    better place, it says where the rendering lies in the image, and in what size.  Every other element of the view
    then has a place and a level, and counts with its best score within a cell of it.  One that reaches beyond the image
    counts only if above 0, one that no level is left for not at all.

    Args:
        scores: (E, P), calibrated scores of elements at all positions of all levels; NOTHING where not computed.
        rows, cols, start: (L,), of each level the positions, and where they begin in P, row by row.
        level, positions, first, boxes: of :class:`.views.Views`.
        cell: pixels of a cell.
        octave: levels an octave.
        expected: (4,): x0, y0, x1, y1 of the object, pixels of the image.
        agreement: the least intersection over union of its box with that of a detection.
        found: (V, 7), to be filled: rank, confidence, number of elements that score above 0, and the detection's x0,
            y0, x1, y1; a rank of -inf if no element scores above 0 anywhere.
    """
    levels = len(rows)
    free = np.empty(scores.shape[1], scores.dtype)
    for view in range(len(first) - 1):
        found[view, 0] = -np.inf
        for root in range(first[view], first[view + 1]):
            for at in range(levels):
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
                    confidence, inliers = 0.0, 0
                    for element in range(first[view], first[view + 1]):
                        there = level[element] + larger
                        if there < 0 or there >= levels:
                            continue
                        cells = 2.0 ** (-there / octave) / cell
                        row = int(np.rint(positions[element, 0] + top * cells))
                        col = int(np.rint(positions[element, 1] + side * cells))
                        score = NOTHING
                        for i in range(max(0, row - 1), min(rows[there], row + 2)):
                            for j in range(max(0, col - 1), min(cols[there], col + 2)):
                                score = max(score, scores[element, start[there] + i * cols[there] + j])
                        if element == root:
                            score = places[best]
                        inside = 0 <= row < rows[there] and 0 <= col < cols[there]
                        if score == NOTHING or not inside:
                            score = max(score, 0.0)
                        confidence += score
                        inliers += score > 0
                    box = boxes[view] * zoom
                    x0, y0, x1, y1 = box[0] + side, box[1] + top, box[2] + side, box[3] + top
                    high = max(0.0, min(y1, expected[3]) - max(y0, expected[1]))
                    wide = max(0.0, min(x1, expected[2]) - max(x0, expected[0]))
                    union = (y1 - y0) * (x1 - x0) - high * wide
                    union += (expected[3] - expected[1]) * (expected[2] - expected[0])
                    rank = confidence + min(0, inliers - 5)
                    if high * wide < agreement * union:
                        rank -= UNLIKE
                    if rank > found[view, 0]:
                        found[view, 0], found[view, 1], found[view, 2] = rank, confidence, inliers
                        found[view, 3], found[view, 4], found[view, 5], found[view, 6] = x0, y0, x1, y1
