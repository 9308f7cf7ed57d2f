"""The baseline of Section 3.2: Aubry et al. ("Seeing 3D chairs") detect renderings of all models in the image.

Their steps, with the constants of their released code: the elements of each rendering (:mod:`.exemplar_views`) are
scored at all cells and levels of the image's pyramid, each votes for where the rendering lies (:func:`star_match`),
and the view of the most confident detection is the pose.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...inputs.boxes import Box
from ...pose.crop import ObjectCrop, crop_object
from ...pose.photograph import all_patches
from .exemplar_views import CELL_SIDE, OCTAVE_LEVELS, ExemplarViews, concatenate_views, pyramid

Floats = NDArray[np.floating]
Integers = NDArray[np.int64]

BOX_SIDE = 150.0  # pixels of the longer side of the object's box: no less than in renderings, so that all levels exist
SEARCH_SIDE = 200  # of the square that is searched: half an element around the box
AT_ONCE = 4096  # elements that are scored together: 32 MiB of scores for an image of 2000 places
BOX_MARGIN = 10.0  # pixels by which the middle of an element may lie outside the box
NOTHING = -1e9  # the score of an element where it cannot lie
UNLIKE = 1e6  # penalty of a detection whose box is not the object's: it wins only where there is no other
ROOTS = 10_000  # roots that are looked up together
NEIGHBOURS = [(row, col) for row in (-1, 0, 1) for col in (-1, 0, 1)]  # of a cell, itself in the middle


@dataclass(frozen=True)
class Detection:
    """A rendering of a model, from an azimuth and an elevation in degrees, detected in the box of a photograph.

    The confidence is the sum of its elements' calibrated scores: Aubry et al. believe one above 0.5.  Inliers are the
    elements that score above 0.
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
    """The most confident detection of any view of any model, by name, in a photograph (C, H, W) with an object's box.

    Detections whose box has less than ``agreement``, an intersection over union, with this one come after all others.
    Aubry et al. know no box, which is an agreement of 0; with PASCAL's criterion for a right detection, 0.5, their
    method is stronger.

    Raises:
        ValueError: the photograph or the box is unusable, or no element of any view scores above 0.
    """
    crop = crop_object(photograph, box, SEARCH_SIDE, BOX_SIDE)
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
    sides = [middle + (side - SEARCH_SIDE / 2) / crop.zoom for middle, side in zip((x, y, x, y), corners, strict=True)]
    return Detection(name, azimuth, elevation, Box(*sides), confidence, int(inliers))


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
    """The patches of a pyramid of the image to search, of the rows and columns of an element, ready to be scored."""

    def __init__(self, crop: ObjectCrop, size: tuple[int, int]) -> None:
        width, height = crop.size
        self.box = (np.array([-width, -height, width, height]) + SEARCH_SIDE) / 2
        levels = [all_patches(cells, size) for cells in pyramid(crop.image[0, 0], size)]
        rows, cols = (np.array([level.shape[axis] for level in levels]) for axis in (0, 1))
        start = np.concatenate([[0], np.cumsum(rows * cols)])
        self.pyramid = Pyramid(rows, cols, start, float(CELL_SIDE), float(OCTAVE_LEVELS))
        near = [self._near(level, size, CELL_SIDE * 2 ** (k / OCTAVE_LEVELS)) for k, level in enumerate(levels)]
        self.places = torch.cat([mask.flatten() for mask in near]).nonzero()[:, 0]
        self.patches = torch.cat([level[mask].flatten(1) for level, mask in zip(levels, near, strict=True)])

    def _near(self, level: Tensor, size: tuple[int, int], pixels: float) -> Tensor:
        """Which patches of a level have their middle near the box, (rows, cols)."""
        y, x = ((torch.arange(level.shape[axis]) + size[axis] / 2) * pixels for axis in (0, 1))
        x0, y0, x1, y1 = self.box
        rows, cols = (y >= y0 - BOX_MARGIN) & (y <= y1 + BOX_MARGIN), (x >= x0 - BOX_MARGIN) & (x <= x1 + BOX_MARGIN)
        near: Tensor = rows[:, None] & cols
        return near

    def match(self, views: ExemplarViews, agreement: float) -> NDArray[np.floating]:
        """The best detection of each view, (V, 7), see :func:`star_match`."""
        scores = torch.full((len(views.scale), int(self.pyramid.start[-1])), NOTHING)
        weights = views.scale[:, None] * views.weights.flatten(1)
        scores[:, self.places] = torch.addmm(views.offset[:, None], weights, self.patches.T)
        layout = Layout(views.level.numpy(), views.positions.numpy(), views.first.numpy(), views.boxes.double().numpy())
        return star_match(scores.numpy(), self.pyramid, layout, self.box, agreement)


class Pyramid(NamedTuple):
    """Levels of a pyramid: rows and columns of an element's positions, (L,); where those of a level begin, (L + 1,).

    Also the pixels of a cell, and the levels of an octave.
    """

    rows: Integers
    cols: Integers
    start: Integers
    cell: float
    octave: float


class Layout(NamedTuple):
    """Where the elements of views lie: attributes of :class:`.ExemplarViews`, as arrays."""

    level: Integers
    positions: Integers
    first: Integers
    boxes: Floats


class Roots(NamedTuple):
    """Elements and the places of their highest scores, each (R,)."""

    element: Integers
    level: Integers
    row: Integers
    col: Integers


def star_match(scores: Floats, pyramid: Pyramid, layout: Layout, expected: Floats, agreement: float) -> Floats:
    """The best detection of each view, (V, 7): rank, confidence, number of elements above 0, x0, y0, x1, y1.

    Each element in turn is the root.  At each level, its local maxima above 0 say where the rendering lies in the
    image, and in what size; no two maxima are within a cell of each other.  Every other element of the view then has a
    place and a level, and adds its score, see :func:`_confidence`.

    Args:
        scores: (E, P), calibrated scores of elements at all positions of all levels; NOTHING where not computed.
        pyramid, layout: of the image, and of the views' elements.
        expected: (4,): x0, y0, x1, y1 of the object, pixels of the image.
        agreement: as for :func:`detect`.
    """
    detections = np.full((len(layout.first) - 1, 7), -np.inf)
    roots = _local_maxima(scores, pyramid)
    for start in range(0, len(roots.element), ROOTS):
        some = Roots(*(part[start : start + ROOTS] for part in roots))
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
    near = at[:, np.newaxis] + np.stack([down * width + right for down, right in NEIGHBOURS], axis=1)
    around = np.searchsorted(at, near).clip(max=len(at) - 1)
    is_place = at[around] == near
    left = scores[element, place]
    highest = np.zeros(len(at), bool)
    while left.any():
        new = (left > 0) & (np.where(is_place, left[around], 0).argmax(axis=1) == len(NEIGHBOURS) // 2)
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
    for down, right in NEIGHBOURS:
        inside, score = _look_up(scores, pyramid, elements, level, row + down, col + right)
        best = np.where(inside, np.maximum(best, score), best)
    inside, _ = _look_up(scores, pyramid, elements, level, row, col)
    _, own = _look_up(scores, pyramid, *roots)
    best = np.where(elements == roots.element[:, np.newaxis], own[:, np.newaxis], best)
    best = np.where(inside & (best != NOTHING), best, best.clip(min=0)) * exists
    return best.sum(axis=1), (best > 0).sum(axis=1)


def _look_up(
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
