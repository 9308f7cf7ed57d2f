"""Where an object may be: around its box, or, if none is given, anywhere in the photograph.

The surroundings of the box, or the photograph, are described and whitened at every scale and in-plane rotation; views
of a model, which fill a crop, are compared with all windows by products of matrices.  The photograph is turned instead
of the model: that serves all models and views at once.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from ..hog.box import Box
from .background import coarse_background
from .crop import FILL, SIDE
from .crop_view import blur, gray_means, reduction, resample
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
from .photograph import PreparedPhotograph, suppress_overlaps
from .problem import SMALL_PENALTY, allowed_azimuths, elevations_around, view_penalty
from .similarity import describe
from .whitening import Background, whitener_of


class Reach(NamedTuple):
    """How far the object may be from its box."""

    octaves: int  # quarters of an octave that it may be larger or smaller; one moves its border by about a cell
    cells: int  # of the coarse descriptor that it may be off in each direction

    @property
    def scales(self) -> NDArray[np.float64]:
        """Sizes of the object, as parts of the longer side of its box."""
        return 2.0 ** (np.arange(-self.octaves, self.octaves + 1) / 4)


ROUGH = Reach(2, 3)  # of a box that someone gave
FOUND = Reach(1, 2)  # of one that :func:`find_boxes` found
DIAGONAL = math.sqrt(2)  # side of the square that holds a turned square of side 1
_OFFSET_PENALTY = (
    0.05  # penalty, as a fraction of the similarity, for a view of twice the box's size or half a side beside it
)
OCTAVE_LEVELS = 4  # of the pyramid, per octave of the object's size
SMALLEST = 8  # ratio of the photograph's longer side to the smallest object that is looked for
BORDER = 4  # cells that an object may extend beyond the photograph
VIEW_STEP = 2  # every second view around a model is compared
PLACES, PLACES_OF_SEVERAL = 6, 2  # that are looked at closely, for one model or for several
DETECTORS = 8  # models, at most, whose views are compared with the whole photograph; more add time, hardly places
DETECTION_ELEVATIONS = (0.0, 20.0, 40.0, 65.0)  # degrees, where nothing is known of the pose
DETECTION_TILTS = (-30.0, 0.0, 30.0)  # degrees, where nothing is known of the pose
_PEAKS = 200  # best places, before overlapping ones are suppressed
_OVERLAP = 0.5  # of two boxes, at most: intersection in the box around both


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Windows of the photograph's whitened descriptor, each as large as that of a view."""

    windows: Tensor  # (P, N), of all levels and places
    scales: Tensor  # (P,), float64: size of an object that fills the window, as part of the box's longer side
    tilts: Tensor  # (P,), float64: degrees of in-plane rotation of an object that is upright in the window
    centres: Tensor  # (P, 2), float64: x, y of the window's middle in the crop, from the middle of that, pixels


def describe_surroundings(
    photograph: PreparedPhotograph, image: Tensor, tilts: Sequence[float], reach: Reach
) -> Surroundings:
    """The windows around an object's box in an image (C, H, W), at all scales of ``reach`` and tilts, degrees."""
    crop = photograph.crop
    background, shrink = coarse_background(photograph.own_background)
    spec = background.spec
    rows, cols = spec.grid(*(side // shrink for side in crop.image.shape[2:]))
    side = spec.image_size(rows + 2 * reach.cells, cols + 2 * reach.cells)[0]
    scales = reach.scales
    # a base image of the finest level's resolution, which the other levels subsample
    zoom = crop.zoom / shrink / float(scales.min())
    steps = scales / scales.min()
    widened = DIAGONAL if any(tilts) else 1.0
    base_side = 2 * math.ceil(side * widened * steps.max() / 2) + 4
    base = resample(image, replace(crop, zoom=zoom), base_side)
    levels = []
    for step in steps.tolist():
        smooth = blur(base, 0.5 * math.sqrt(step**2 - 1)) if step > 1 else base
        levels.append(turn_image(smooth[0, 0], tilts, step, (side, side)))
    descriptors = describe(torch.cat(levels)[:, None], spec)
    grid = descriptors.shape[2:]
    whitener = whitener_of(background, *grid)
    cells = spec.cell_size[0]
    of_levels = torch.cartesian_prod(torch.from_numpy(scales), torch.tensor(tilts, dtype=torch.float64))
    level_scales, level_tilts = of_levels.unbind(1)
    x, y = map_grid(
        centre_coordinates(grid, cells), level_scales * shrink, level_tilts
    )  # of cells on the turned photograph
    low, high = crop.valid[:2], crop.valid[2:]
    half = crop.image.shape[-1] / 2
    valid = (x + half >= low[0]) & (x + half <= high[0]) & (y + half >= low[1]) & (y + half <= high[1])
    weights = whitener(whitener.centre_coordinates(descriptors) * valid[:, None])
    windows = weights.unfold(2, rows, 1).unfold(3, cols, 1)  # (levels, C, down, across, rows, cols)
    down, across = windows.shape[2:4]
    x, y = map_grid(centre_coordinates((down, across), cells), level_scales * shrink, level_tilts)
    count = down * across
    return Surroundings(
        windows.permute(0, 2, 3, 1, 4, 5).reshape(len(weights) * count, -1),
        level_scales.repeat_interleave(count),
        level_tilts.repeat_interleave(count),
        torch.stack([x, y], dim=-1).flatten(0, 2),
    )


def find_views(
    model: PreparedModel,
    photograph: PreparedPhotograph,
    around: Surroundings,
    elevations: Sequence[float],
    allowed: Tensor,
    count: int,
) -> tuple[Tensor, Tensor]:
    """At most ``count`` views that are more similar than those at neighbouring azimuths, elevations and tilts.

    ``allowed``, (VIEW_COUNT,), bool, says which azimuths count.  Returns poses (K, 6) for the crop, angles in degrees,
    and their similarities (K,), the highest first.
    """
    own = photograph.own_background
    views = torch.stack([view_descriptors(model, elevation, own).flatten(1) for elevation in elevations])
    off = around.scales.log2().square() + 4 * (around.centres / FILL).square().sum(1)
    similarities = (views @ around.windows.T).double() * (1 - _OFFSET_PENALTY * off)  # (E, VIEW_COUNT, P)
    tilts, which = torch.unique(around.tilts, return_inverse=True)
    best = similarities.new_full((len(elevations), VIEW_COUNT, len(tilts)), -torch.inf)
    at = torch.zeros_like(best, dtype=torch.int64)
    for k in range(len(tilts)):
        places = (which == k).nonzero()[:, 0]
        values, index = similarities[:, :, places].max(2)
        best[:, :, k], at[:, :, k] = values, places[index]
    best[:, ~allowed] = -torch.inf
    beside = functional.pad(best.permute(1, 0, 2)[None, None], (1, 1, 1, 1, 0, 0), value=-torch.inf)
    beside = torch.cat([beside[:, :, -1:], beside, beside[:, :, :1]], 2)
    highest = best >= functional.max_pool3d(beside, 3, stride=1)[0, 0].permute(1, 0, 2)
    chosen = (highest & best.isfinite()).flatten().nonzero()[:, 0]
    values, order = best.flatten()[chosen].sort(descending=True)
    chosen = chosen[order[:count]]
    elevation, azimuth = chosen // (VIEW_COUNT * len(tilts)), chosen // len(tilts) % VIEW_COUNT
    scale, tilt, centre = (part[at.flatten()[chosen]] for part in (around.scales, around.tilts, around.centres))
    seen_from = torch.tensor(elevations, dtype=torch.float64)[elevation]
    poses = level_poses(equidistant_azimuths(VIEW_COUNT)[azimuth], seen_from)
    poses = tilt_views(fit_to_box(poses, model.hull, photograph.crop.camera, FILL * scale), tilt)
    poses[:, 4:] += centre
    return poses, values[:count]


def centre_coordinates(counts: Sequence[int], spacing: float = 1.0) -> list[Tensor]:
    """Coordinates from the middle of ``count`` points in a row, (count,), float64, for each of the counts."""
    return [(torch.arange(count, dtype=torch.float64) - (count - 1) / 2) * spacing for count in counts]


def map_grid(grid: Sequence[Tensor], scales: Tensor, tilts: Tensor) -> tuple[Tensor, Tensor]:
    """Places in a photograph of the points of a grid on L scaled and tilted copies of it, each (L, rows, cols).

    Args:
        grid: y (rows,) and x (cols,) on the copies, from the middle, as are the x and y that are returned.
        scales: (L,), pixels of the photograph for one of the copy.
        tilts: (L,), degrees that the copies are turned clockwise.
    """
    angle = torch.deg2rad(tilts)
    cosine, sine = ((scales * part)[:, None, None] for part in (angle.cos(), angle.sin()))
    y, x = grid[0][:, None], grid[1]
    return cosine * x + sine * y, cosine * y - sine * x


def turn_image(image: Tensor, tilts: Sequence[float], step: float, size: tuple[int, int]) -> Tensor:
    """Samples (T, *size) of an image (H, W), float32, around its middle, ``step`` pixels apart.

    The image is turned clockwise by each of T tilts, degrees; its border repeats.
    """
    grid = [coordinates.to(image.dtype) for coordinates in centre_coordinates(size)]
    x, y = map_grid(grid, image.new_full((len(tilts),), step), image.new_tensor(tilts))
    height, width = image.shape
    at = torch.stack([x * (2 / width), y * (2 / height)], dim=-1)  # coordinates are -1 and 1 at the borders
    images = image.expand(len(tilts), 1, -1, -1)
    return functional.grid_sample(images, at, padding_mode="border", align_corners=False)[:, 0]


def find_boxes(
    image: Tensor,
    models: Sequence[PreparedModel],
    initial: tuple[float, float] | None,
    within: float,
    own: Background | None,
) -> list[Box]:
    """Boxes around the views most similar to an image (C, H, W), the best first, none overlapping a better one.

    At most :data:`PLACES`, or :data:`PLACES_OF_SEVERAL` for several models, in pixels.  ``initial`` and ``within``
    are as in :class:`.problem.PoseProblem`, ``own`` is the background of the coarse descriptor; None for the default.
    """
    count = PLACES if len(models) == 1 else PLACES_OF_SEVERAL
    models = models[:: math.ceil(len(models) / DETECTORS)]
    background, shrink = coarse_background(own)
    elevations, tilts = (
        (DETECTION_ELEVATIONS, DETECTION_TILTS) if initial is None else (elevations_around(initial), (0.0,))
    )
    azimuths = equidistant_azimuths(VIEW_COUNT)[::VIEW_STEP]
    azimuth_of = azimuths.repeat(len(models) * len(elevations))
    elevation_of = torch.tensor(elevations, dtype=torch.float64).repeat_interleave(len(azimuths)).repeat(len(models))
    model_of = torch.arange(len(models)).repeat_interleave(len(elevations) * len(azimuths))
    searched = allowed_azimuths(azimuth_of, initial, within).nonzero()[:, 0]
    views = torch.cat(
        [view_descriptors(model, elevation, own)[::VIEW_STEP] for model in models for elevation in elevations]
    )
    views = views[searched]
    peaks: list[Tensor] = []  # similarity, view, x, y, zoom, tilt of each
    for zoom, tilt, weights, middles, inside in _levels(image, background, shrink, tilts):
        penalty = torch.tensor(SMALL_PENALTY * math.log2(max(image.shape[1:]) * shrink * zoom / FILL))
        penalty = penalty + view_penalty(elevation_of[searched].float(), torch.tensor([tilt]), initial)
        values, view = (_correlations(weights, views) - penalty).max(2)
        values = torch.where(inside, values, -torch.inf)
        around = functional.max_pool2d(values[None, None], 3, stride=1, padding=1)[0, 0]
        peak = (values >= around) & inside
        found = torch.stack([values[peak], searched[view[peak]].float()], 1).double()
        where = found.new_tensor([zoom, tilt]).expand(len(found), 2)
        peaks.append(torch.cat([found, middles[peak], where], 1))
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


def _levels(
    image: Tensor, background: Background, shrink: int, tilts: Sequence[float]
) -> Iterator[tuple[float, float, Tensor, Tensor, Tensor]]:
    """The photograph at all scales and tilts, from the finest on.

    Yields pixels of the level per pixel of the photograph, tilt, whitened descriptor (C, rows, cols), and of all
    windows x, y of the middle in the photograph, (down, across, 2), pixels, and whether it is inside, (down, across).
    """
    spec = background.spec
    size = spec.grid(SIDE // shrink, SIDE // shrink)
    height, width = image.shape[1:]
    fill = FILL / shrink
    largest = float(max(height, width))
    smallest = min(max(largest / SMALLEST, fill), largest)
    finest = math.floor(OCTAVE_LEVELS * math.log2(largest / smallest))
    factor = reduction(fill / (largest * 2 ** (-finest / OCTAVE_LEVELS)))
    photograph = gray_means(image, factor)[None]
    height, width = (side * factor for side in photograph.shape[2:])
    cell = spec.cell_size[0]
    for k in range(finest, -1, -1):
        zoom = fill / (largest * 2 ** (-k / OCTAVE_LEVELS))
        shape = max(2, round(height * zoom)), max(2, round(width * zoom))
        photograph = functional.interpolate(photograph, shape, mode="bilinear", antialias=True)
        for tilt in tilts:
            angle = math.radians(tilt)
            sine, cosine = abs(math.sin(angle)), math.cos(angle)
            needed = shape[0] * cosine + shape[1] * sine, shape[0] * sine + shape[1] * cosine
            cells = [max(math.ceil(side / cell) + 2 * BORDER, least) for side, least in zip(needed, size, strict=True)]
            canvas = turn_image(photograph[0, 0], [tilt], 1.0, spec.image_size(*cells))
            descriptor = describe(canvas[:, None], spec)
            whitener = whitener_of(background, *descriptor.shape[2:])
            _, valid = _cell_places(descriptor.shape[2:], cell, tilt, shape)
            weights = whitener(whitener.centre_coordinates(descriptor) * valid)[0]
            windows = [n - least + 1 for n, least in zip(weights.shape[1:], size, strict=True)]
            at, inside = _cell_places(windows, cell, tilt, shape)
            middles = at / zoom + torch.tensor([width / 2, height / 2], dtype=torch.float64)
            yield zoom, tilt, weights, middles, inside


def _cell_places(counts: Sequence[int], cell: int, tilt: float, shape: tuple[int, int]) -> tuple[Tensor, Tensor]:
    """x, y (rows, cols, 2) of a grid of cells on a turned image, from its middle, and whether they are in the image."""
    turn = torch.ones(1, dtype=torch.float64), torch.tensor([tilt]).double()
    x, y = (part[0] for part in map_grid(centre_coordinates(counts, cell), *turn))
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
