"""Where in a whole photograph an object may be, if no box is given.

The photograph is described and whitened at every scale and in-plane rotation, and views of the models, which fill a
crop, are compared with all its windows by products of matrices.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import torch
from torch import Tensor
from torch.nn import functional

from ..inputs.boxes import Box
from .crop import CROP_FILL, CROP_SIDE, SMALLEST_SIDE
from .crop_view import gray_means, reduction_factor
from .model import (
    VIEW_COUNT,
    PreparedModel,
    bounding_boxes,
    equidistant_azimuths,
    fit_to_box,
    level_poses,
    tilt_views,
    view_descriptors,
)
from .photograph import suppress_overlaps
from .problem import SMALL_PENALTY, allowed_azimuths, elevations_around, view_penalty
from .similarity import coarse_background, describe
from .surroundings import centre_coordinates, map_grid, turn_image
from .whitening import Background, cached_whitener

LEVELS_PER_OCTAVE = 4  # of the pyramid, per octave of the object's size
SMALLEST_RATIO = 8  # ratio of the photograph's longer side to the smallest object that is looked for
BORDER_CELLS = 4  # cells that an object may extend beyond the photograph
VIEW_STEP = 2  # every second view around a model is compared
PLACES, PLACES_OF_SEVERAL = 6, 2  # that are looked at closely, for one model or for several
DETECTORS = 8  # models, at most, whose views are compared with the whole photograph; more add time, hardly places
DETECTION_ELEVATIONS = (0.0, 20.0, 40.0, 65.0)  # degrees, where nothing is known of the pose
DETECTION_TILTS = (-30.0, 0.0, 30.0)  # degrees, where nothing is known of the pose
_PEAKS = 200  # best places, before overlapping ones are suppressed
_OVERLAP = 0.5  # of two boxes, at most: intersection in the box around both


def find_boxes(
    image: Tensor,
    models: Sequence[PreparedModel],
    initial: tuple[float, float] | None,
    within: float,
    own: Background | None,
) -> list[Box]:
    """Boxes around the views most similar to an image (C, H, W), the best first, none overlapping a better one.

    At most :data:`PLACES`, or :data:`PLACES_OF_SEVERAL` for several models, in pixels, and large enough to be given to
    a search.  ``initial`` and ``within`` are as in :class:`.problem.PoseProblem`, ``own`` is the background of the
    coarse descriptor; None for the default.
    """
    count = PLACES if len(models) == 1 else PLACES_OF_SEVERAL
    models = models[:: math.ceil(len(models) / DETECTORS)]
    background, shrink = coarse_background(own)
    elevations, tilts = (
        (DETECTION_ELEVATIONS, DETECTION_TILTS) if initial is None else (elevations_around(initial), (0.0,))
    )
    azimuths = equidistant_azimuths(VIEW_COUNT)[::VIEW_STEP]
    view_azimuths = azimuths.repeat(len(models) * len(elevations))
    view_elevations = torch.tensor(elevations, dtype=torch.float64).repeat_interleave(len(azimuths)).repeat(len(models))
    view_models = torch.arange(len(models)).repeat_interleave(len(elevations) * len(azimuths))
    searched = allowed_azimuths(view_azimuths, initial, within).nonzero()[:, 0]
    views = torch.cat(
        [view_descriptors(model, elevation, own)[::VIEW_STEP] for model in models for elevation in elevations]
    )
    views = views[searched]
    peaks: list[Tensor] = []  # similarity, view, x, y, zoom, tilt of each
    for zoom, tilt, weights, middles, inside in _describe_levels(image, background, shrink, tilts):
        smallness, tilted = torch.tensor(
            [[SMALL_PENALTY * math.log2(max(image.shape[1:]) * shrink * zoom / CROP_FILL)], [tilt]], dtype=torch.float32
        )
        penalty = smallness + view_penalty(view_elevations[searched].float(), tilted, initial)
        values, view = (_correlate(weights, views) - penalty).max(2)
        values = torch.where(inside, values, -torch.inf)
        around = functional.max_pool2d(values[None, None], 3, stride=1, padding=1)[0, 0]
        peak = (values >= around) & inside
        found = torch.stack([values[peak], searched[view[peak]].float()], 1).double()
        where = found.new_tensor([zoom, tilt]).expand(len(found), 2)
        peaks.append(torch.cat([found, middles[peak], where], 1))
    best = torch.cat(peaks)
    best = best[best[:, 0].argsort(descending=True)[:_PEAKS]]
    view = best[:, 1].long()
    poses = level_poses(view_azimuths[view], view_elevations[view])
    boxes = torch.empty(len(best), 4, dtype=torch.float64)
    for k, model in enumerate(models):
        own_peaks = (view_models[view] == k).nonzero()[:, 0]
        if len(own_peaks):
            placed = tilt_views(fit_to_box(poses[own_peaks], model.hull, model.camera, CROP_FILL), best[own_peaks, 5])
            boxes[own_peaks] = bounding_boxes(placed, model.hull, model.camera)
    boxes = boxes / (shrink * best[:, 4])[:, None] + best[:, [2, 3, 2, 3]]
    different = suppress_overlaps(boxes, count, _OVERLAP)
    return [Box(*sides).widen(SMALLEST_SIDE) for sides in boxes[different].tolist()]


def _describe_levels(
    image: Tensor, background: Background, shrink: int, tilts: Sequence[float]
) -> Iterator[tuple[float, float, Tensor, Tensor, Tensor]]:
    """The photograph at all scales and tilts, from the finest on.

    Yields pixels of the level per pixel of the photograph, tilt, whitened descriptor (C, rows, cols), and of all
    windows x, y of the middle in the photograph, (down, across, 2), pixels, and whether it is inside, (down, across).
    """
    spec = background.spec
    size = spec.grid(CROP_SIDE // shrink, CROP_SIDE // shrink)
    height, width = image.shape[1:]
    fill = CROP_FILL / shrink
    largest = float(max(height, width))
    smallest = min(max(largest / SMALLEST_RATIO, fill), largest)
    finest = math.floor(LEVELS_PER_OCTAVE * math.log2(largest / smallest))
    factor = reduction_factor(fill / (largest * 2 ** (-finest / LEVELS_PER_OCTAVE)))
    photograph = gray_means(image, factor)[None]
    height, width = (side * factor for side in photograph.shape[2:])
    cell = spec.cell_size[0]
    for k in range(finest, -1, -1):
        zoom = fill / (largest * 2 ** (-k / LEVELS_PER_OCTAVE))
        shape = max(2, round(height * zoom)), max(2, round(width * zoom))
        photograph = functional.interpolate(photograph, shape, mode="bilinear", antialias=True)
        for tilt in tilts:
            angle = math.radians(tilt)
            sine, cosine = abs(math.sin(angle)), math.cos(angle)
            needed = shape[0] * cosine + shape[1] * sine, shape[0] * sine + shape[1] * cosine
            cells = [math.ceil(side / cell) + 2 * BORDER_CELLS for side in needed]
            canvas = turn_image(photograph[0, 0], [tilt], 1.0, spec.image_size(*map(max, cells, size)))
            descriptor = describe(canvas[:, None], spec)
            whitener = cached_whitener(background, *descriptor.shape[2:])
            _, valid = _place_cells(descriptor.shape[2:], cell, tilt, shape)
            weights = whitener(whitener.subtract_mean(descriptor) * valid)[0]
            windows = [n - least + 1 for n, least in zip(weights.shape[1:], size, strict=True)]
            at, inside = _place_cells(windows, cell, tilt, shape)
            middles = at / zoom + torch.tensor([width / 2, height / 2], dtype=torch.float64)
            yield zoom, tilt, weights, middles, inside


def _place_cells(counts: Sequence[int], cell: int, tilt: float, shape: tuple[int, int]) -> tuple[Tensor, Tensor]:
    """x, y (rows, cols, 2) of a grid of cells on a turned image, from its middle, and whether they are in the image."""
    turn = torch.ones(1, dtype=torch.float64), torch.tensor([tilt], dtype=torch.float64)
    x, y = (part[0] for part in map_grid(centre_coordinates(counts, cell), *turn))
    return torch.stack([x, y], 2), (x.abs() <= shape[1] / 2) & (y.abs() <= shape[0] / 2)


def _correlate(weights: Tensor, views: Tensor) -> Tensor:
    """Products (down, across, V) of all windows of a descriptor (C, rows, cols) with views (V, C, r, c).

    A matrix product for each row of a view, so that no window is copied whole.
    """
    _, _, rows, cols = views.shape
    down, across = weights.shape[1] - rows + 1, weights.shape[2] - cols + 1
    strips = weights.unfold(2, cols, 1).permute(1, 2, 0, 3).reshape(weights.shape[1] * across, -1)
    view_rows = views.permute(2, 1, 3, 0).reshape(rows, -1, len(views))
    products = strips[: down * across] @ view_rows[0]
    for row in range(1, rows):
        products.addmm_(strips[row * across : (row + down) * across], view_rows[row])
    return products.reshape(down, across, -1)
