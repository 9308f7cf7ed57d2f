"""Where in a photograph an object may be, if no box is given: its views at all places and scales."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from ..hog.box import Box
from ..hog.gradient import gray
from .background import coarse_background
from .crop import FILL, SIDE
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
from .problem import SMALL, allowed_azimuths, view_penalty
from .similarity import describe
from .surroundings import centred, places, turned
from .whitening import Background, whitener_of

LEVELS = 4  # of the pyramid, from one size of the object to the double
SMALLEST = 8  # ratio of the photograph's longer side to the smallest object that is looked for
BORDER = 4  # cells that an object may extend beyond the photograph
EVERY = 2  # every second view around a model is compared
PLACES, PLACES_OF_SEVERAL = 6, 2  # that are looked at closely, of one model or of several
DETECTORS = 8  # models, at most, whose views are compared with the whole photograph; more add time, hardly places
ELEVATIONS = (0.0, 20.0, 40.0, 65.0)  # degrees, where nothing is known of the pose
TILTS = (-30.0, 0.0, 30.0)  # degrees, where nothing is known of the pose
_PEAKS = 200  # best places, before overlapping ones are suppressed
_OVERLAP = 0.5  # of two boxes, at most: intersection in the box around both


@dataclass(frozen=True, eq=False)
class _Level:
    """The photograph at one scale and tilt."""

    weights: Tensor  # (C, rows, cols), its whitened descriptor
    middles: Tensor  # (down, across, 2), x, y in the photograph of the middles of windows, pixels
    inside: Tensor  # (down, across), whether they are in the photograph
    zoom: float  # pixels of the level for one of the photograph
    tilt: float  # degrees


def find_boxes(
    image: Tensor,
    models: Sequence[PreparedModel],
    initial: tuple[float, float] | None,
    within: float,
    own: Background | None,
) -> list[Box]:
    """Boxes around the views that are most similar to the photograph, the best first, none overlapping a better one.

    Args:
        image: (C, H, W), the photograph, in 0…1.
        models, initial, within: as in :class:`.problem.PoseProblem`.
        own: background of the coarse descriptor; None for the default one.

    Returns:
        At most :data:`PLACES` boxes, or :data:`PLACES_OF_SEVERAL` of several models, pixels of the photograph.
    """
    count = PLACES if len(models) == 1 else PLACES_OF_SEVERAL
    models = models[:: math.ceil(len(models) / DETECTORS)]
    background, shrink = coarse_background(own)
    elevations, tilts = (ELEVATIONS, TILTS) if initial is None else ((initial[1],), (0.0,))
    azimuths = equidistant_azimuths(VIEW_COUNT)[::EVERY]
    azimuth_of = azimuths.repeat(len(models) * len(elevations))
    elevation_of = torch.tensor(elevations, dtype=torch.float64).repeat_interleave(len(azimuths)).repeat(len(models))
    model_of = torch.arange(len(models)).repeat_interleave(len(elevations) * len(azimuths))
    searched = allowed_azimuths(azimuth_of, initial, within).nonzero()[:, 0]
    views = torch.cat([view_descriptors(model, each, own)[::EVERY] for model in models for each in elevations])
    views = views[searched]
    peaks: list[Tensor] = []  # similarity, view, x, y, zoom, tilt of each
    for level in _levels(image, background, shrink, tilts):
        penalty = torch.tensor(SMALL * math.log2(max(image.shape[1:]) * shrink * level.zoom / FILL))
        if initial is None:
            penalty = penalty + view_penalty(elevation_of[searched].float(), torch.tensor([level.tilt]))
        values, view = (_correlations(level.weights, views) - penalty).max(2)
        values = torch.where(level.inside, values, -torch.inf)
        around = functional.max_pool2d(values[None, None], 3, stride=1, padding=1)[0, 0]
        peak = (values >= around) & level.inside
        found = torch.stack([values[peak], searched[view[peak]].float()], 1).double()
        where = found.new_tensor([level.zoom, level.tilt]).expand(len(found), 2)
        peaks.append(torch.cat([found, level.middles[peak], where], 1))
    best = torch.cat(peaks)
    best = best[best[:, 0].argsort(descending=True)[:_PEAKS]]
    view = best[:, 1].long()
    poses = level_poses(azimuth_of[view], elevation_of[view])
    boxes = torch.empty(len(best), 4, dtype=torch.float64)
    for k, model in enumerate(models):
        mine = (model_of[view] == k).nonzero()[:, 0]
        if len(mine):
            placed = tilt_views(fit_to_box(poses[mine], model.hull, model.camera, FILL), best[mine, 5])
            boxes[mine] = bounding_boxes(placed, model.hull, model.camera)
    boxes = boxes / (shrink * best[:, 4])[:, None] + best[:, [2, 3, 2, 3]]
    return [Box.of(sides) for sides in boxes[suppress_overlaps(boxes, count, _OVERLAP)].tolist()]


def _levels(image: Tensor, background: Background, shrink: int, tilts: Sequence[float]) -> Iterator[_Level]:
    """The photograph at all scales and tilts, from the finest on."""
    spec = background.spec
    size = spec.grid(SIDE // shrink, SIDE // shrink)
    height, width = image.shape[1:]
    fill = FILL / shrink
    largest = float(max(height, width))
    smallest = min(max(largest / SMALLEST, fill), largest)
    photograph = gray(image[None].float())
    cell = spec.cell_size[0]
    for k in range(math.floor(LEVELS * math.log2(largest / smallest)), -1, -1):
        zoom = fill / (largest * 2 ** (-k / LEVELS))
        shape = max(2, round(height * zoom)), max(2, round(width * zoom))
        photograph = functional.interpolate(photograph, shape, mode="bilinear", antialias=True)
        for tilt in tilts:
            angle = math.radians(tilt)
            sine, cosine = abs(math.sin(angle)), math.cos(angle)
            needed = shape[0] * cosine + shape[1] * sine, shape[0] * sine + shape[1] * cosine
            cells = [max(math.ceil(side / cell) + 2 * BORDER, least) for side, least in zip(needed, size, strict=True)]
            canvas = turned(photograph[0, 0], [tilt], 1.0, spec.image_size(*cells))
            descriptor = describe(canvas[:, None], spec)
            whitener = whitener_of(background, *descriptor.shape[2:])
            _, valid = _cell_places(descriptor.shape[2:], cell, tilt, shape)
            weights = whitener(whitener.centred(descriptor) * valid)[0]
            windows = [n - least + 1 for n, least in zip(weights.shape[1:], size, strict=True)]
            at, inside = _cell_places(windows, cell, tilt, shape)
            middles = at / zoom + torch.tensor([width / 2, height / 2], dtype=torch.float64)
            yield _Level(weights, middles, inside, zoom, tilt)


def _cell_places(counts: Sequence[int], cell: int, tilt: float, shape: tuple[int, int]) -> tuple[Tensor, Tensor]:
    """x, y from the middle (rows, cols, 2) of a grid of cells on a turned image, and whether they are in the image."""
    turn = torch.ones(1, dtype=torch.float64), torch.tensor([tilt]).double()
    x, y = (part[0] for part in places(centred(counts, cell), *turn))
    return torch.stack([x, y], 2), (x.abs() <= shape[1] / 2) & (y.abs() <= shape[0] / 2)


def _correlations(weights: Tensor, views: Tensor) -> Tensor:
    """Products (down, across, V) of all windows of a descriptor (C, rows, cols) with views (V, C, r, c).

    A matrix product for each row of a view, so that no window is copied whole.
    """
    _, _, rows, cols = views.shape
    down, across = weights.shape[1] - rows + 1, weights.shape[2] - cols + 1
    strips = weights.unfold(2, cols, 1).permute(1, 2, 0, 3).reshape(weights.shape[1] * across, -1)
    of_rows = views.permute(2, 1, 3, 0).reshape(rows, -1, len(views))
    products = strips[: down * across] @ of_rows[0]
    for row in range(1, rows):
        products.addmm_(strips[row * across : (row + down) * across], of_rows[row])
    return products.reshape(down, across, -1)
