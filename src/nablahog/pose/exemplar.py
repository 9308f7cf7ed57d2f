"""The baseline of Section 3.2: Aubry et al. ("Seeing 3D chairs") detect renderings of all models in the image.

Their steps, with the constants of their released code: the elements of each rendering (:mod:`.exemplar_views`) are
scored at all cells and levels of the image's pyramid, each votes for where the rendering lies (:func:`star_match`),
and the view of the most confident detection is the pose.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from ..hog.box import Box
from ..runtime.compile import compiled
from .crop import ObjectCrop, crop_object
from .elements import all_patches
from .exemplar_views import CELL, LEVELS, ExemplarViews, concatenate_views, pyramid

FILL = 150.0  # pixels of the longer side of the object's box: no less than in renderings, so that all levels exist
SIDE = 200  # of the square that is searched: half an element around the box
AT_ONCE = 4096  # elements to score: 32 MiB of scores where an image has 2000 places
MARGIN = 10.0  # pixels around the box that the middle of an element may lie in
NOTHING = -1e9  # what an element scores where it cannot be
UNLIKE = 1e6  # taken off a detection whose box is not the object's: it is the best only where there is no other


@dataclass(frozen=True)
class Detection:
    """A rendering detected in an image.

    Attributes:
        model: its name.
        azimuth, elevation: from where it was rendered, degrees.
        box: of the model in the photograph, pixels.
        confidence: the sum of its elements' calibrated scores; Aubry et al. believe a detection above 0.5.
        inliers: how many elements score above 0.
    """

    model: str
    azimuth: float
    elevation: float
    box: Box
    confidence: float
    inliers: int


@torch.no_grad()
def detect(
    photograph: Tensor, box: Sequence[float], models: Mapping[str, ExemplarViews], *, agreement: float = 0.5
) -> Detection:
    """The most confident detection of any view of any model.

    Args:
        photograph: (C, H, W), float32 or float64 in 0…1, one channel or R, G, B.
        box: x0, y0, x1, y1 of the object, pixels.
        models: their views by name, at least one.
        agreement: detections whose box has less than this intersection over union with ``box`` come after all others.
            Aubry et al. know no box, which is 0; with PASCAL's criterion for a right detection, 0.5, their method is
            the stronger.

    Raises:
        ValueError: the photograph or the box is not as above, there are no models, or no element of any view scores
            above 0.
    """
    if not models:
        raise ValueError("expected models to detect, got none")
    if not 0 <= agreement <= 1:
        raise ValueError(f"agreement must lie in 0…1, got {agreement!r}")
    crop = crop_object(photograph, box, SIDE, FILL)
    images: dict[tuple[int, int], _Image] = {}
    best: tuple[float, str, list[float], list[float]] | None = None
    for size, names in _blocks(models):
        if size not in images:
            images[size] = _Image(crop, size)
        views = concatenate_views([models[name] for name in names])
        detections = images[size].match(views, agreement)
        view = int(detections[:, 0].argmax())
        rank, *detection = detections[view].tolist()
        if np.isfinite(rank) and (best is None or rank > best[0]):
            owners = [name for name in names for _ in models[name].viewpoints]
            best = rank, owners[view], views.viewpoints[view].tolist(), detection
    if best is None:
        raise ValueError("no element of any view is found in the image")
    _, name, (azimuth, elevation), (confidence, inliers, *corners) = best
    x, y = crop.middle
    sides = [middle + (side - SIDE / 2) / crop.zoom for middle, side in zip((x, y, x, y), corners, strict=True)]
    return Detection(name, azimuth, elevation, Box.of(sides), confidence, int(inliers))


def _blocks(models: Mapping[str, ExemplarViews]) -> Iterator[tuple[tuple[int, int], list[str]]]:
    """Models whose elements are scored at once: the size of these, and the models' names."""
    by_size: dict[tuple[int, int], list[str]] = {}
    for name, views in models.items():
        by_size.setdefault((views.weights.shape[1], views.weights.shape[2]), []).append(name)
    for size, names in by_size.items():
        block: list[str] = []
        for name in names:
            if block and sum(len(models[one].scale) for one in (*block, name)) > AT_ONCE:
                yield size, block
                block = []
            block.append(name)
        yield size, block


class _Image:
    """The patches of a pyramid, ready to be scored.

    Args:
        crop: the image to search.
        size: rows and columns of an element.
    """

    def __init__(self, crop: ObjectCrop, size: tuple[int, int]) -> None:
        width, height = crop.size
        self.box = (np.array([-width, -height, width, height]) + SIDE) / 2
        levels = [all_patches(cells, size) for cells in pyramid(crop.image[0, 0], size)]
        rows, cols = (np.array([level.shape[axis] for level in levels]) for axis in (0, 1))
        start = np.concatenate([[0], np.cumsum(rows * cols)])
        self.pyramid = Pyramid(rows, cols, start, float(CELL), float(LEVELS))
        near = [self._near(level, size, CELL * 2 ** (k / LEVELS)) for k, level in enumerate(levels)]
        self.places = torch.cat([mask.flatten() for mask in near]).nonzero()[:, 0]
        self.patches = torch.cat([level[mask].flatten(1) for level, mask in zip(levels, near, strict=True)])

    def _near(self, level: Tensor, size: tuple[int, int], pixels: float) -> Tensor:
        """Which patches of a level have their middle near the box, (rows, cols)."""
        y, x = ((torch.arange(level.shape[axis]) + size[axis] / 2) * pixels for axis in (0, 1))
        x0, y0, x1, y1 = self.box
        rows, cols = (y >= y0 - MARGIN) & (y <= y1 + MARGIN), (x >= x0 - MARGIN) & (x <= x1 + MARGIN)
        near: Tensor = rows[:, None] & cols
        return near

    def match(self, views: ExemplarViews, agreement: float) -> np.ndarray[Any, np.dtype[np.float64]]:
        """The best detection of each view, (V, 7), see :func:`star_match`."""
        scores = torch.full((len(views.scale), int(self.pyramid.start[-1])), NOTHING)
        weights = views.scale[:, None] * views.weights.flatten(1)
        scores[:, self.places] = torch.addmm(views.offset[:, None], weights, self.patches.T)
        detections = np.empty((len(views.viewpoints), 7))
        layout = Layout(views.level.numpy(), views.positions.numpy(), views.first.numpy(), views.boxes.double().numpy())
        star_match(scores.numpy(), self.pyramid, layout, self.box, agreement, detections)
        return detections


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
