"""Where an object may be around its box, of which nobody knows how exact it is.

The surroundings of the box are described and whitened at every scale and in-plane rotation; views of a model, which
fill a crop, are compared with all windows by products of matrices.  The photograph is turned instead of the model: that
serves all models and views at once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from .crop import CROP_FILL
from .crop_view import blur, resample
from .model import (
    VIEW_COUNT,
    PreparedModel,
    equidistant_azimuths,
    fit_to_box,
    level_poses,
    select_different,
    tilt_views,
    view_descriptors,
)
from .photograph import PreparedPhotograph
from .similarity import coarse_background, describe
from .whitening import cached_whitener


class Reach(NamedTuple):
    """How far the object may be from its box."""

    quarters: int  # of an octave that it may be larger or smaller; one moves its border by about a cell
    cells: int  # of the coarse descriptor that it may be off in each direction

    @property
    def scales(self) -> NDArray[np.float64]:
        """Sizes of the object, as parts of the longer side of its box."""
        return 2.0 ** (np.arange(-self.quarters, self.quarters + 1) / 4)


ROUGH = Reach(2, 3)  # of a box that someone gave
FOUND = Reach(1, 2)  # of one that :func:`.detection.find_boxes` found
# penalty, as a fraction of the similarity, for a view of twice the box's size or half a side beside it
_OFFSET_PENALTY = 0.05
_SAME_VIEW = 15.0  # degrees: of views whose rotations are closer only the best counts
_CANDIDATES = 3  # times as many views are looked at, because some are the same


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
    steps = scales / scales.min()
    # a base image of the finest level's resolution, which the other levels subsample, with room for turned ones
    base_side = 2 * math.ceil(side * (math.sqrt(2) if any(tilts) else 1.0) * steps.max() / 2) + 4
    base = resample(image, replace(crop, zoom=crop.zoom / shrink / float(scales.min())), base_side)
    level_images = []
    for step in steps.tolist():
        smooth = blur(base, 0.5 * math.sqrt(step**2 - 1)) if step > 1 else base
        level_images.append(turn_image(smooth[0, 0], tilts, step, (side, side)))
    descriptors = describe(torch.cat(level_images)[:, None], spec)
    grid, spacing = descriptors.shape[2:], spec.cell_size[0]
    whitener = cached_whitener(background, *grid)
    scales_and_tilts = torch.cartesian_prod(torch.from_numpy(scales), torch.tensor(tilts, dtype=torch.float64))
    level_scales, level_tilts = scales_and_tilts.unbind(1)
    turned_cells = map_grid(centre_coordinates(grid, spacing), level_scales * shrink, level_tilts)
    x, y = (middles + crop.image.shape[-1] / 2 for middles in turned_cells)
    valid = (x >= crop.valid.x0) & (x <= crop.valid.x1) & (y >= crop.valid.y0) & (y <= crop.valid.y1)
    weights = whitener(whitener.subtract_mean(descriptors) * valid[:, None])
    windows = weights.unfold(2, rows, 1).unfold(3, cols, 1)  # (levels, C, down, across, rows, cols)
    down, across = windows.shape[2:4]
    x, y = map_grid(centre_coordinates((down, across), spacing), level_scales * shrink, level_tilts)
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
    off = around.scales.log2().square() + 4 * (around.centres / CROP_FILL).square().sum(1)
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
    chosen = chosen[order[: _CANDIDATES * count]]
    elevation, azimuth = chosen // (VIEW_COUNT * len(tilts)), chosen // len(tilts) % VIEW_COUNT
    seen_from = torch.tensor(elevations, dtype=torch.float64)[elevation]
    poses, place = level_poses(equidistant_azimuths(VIEW_COUNT)[azimuth], seen_from), at.flatten()[chosen]
    rotated = torch.cat([poses[:, :3], around.tilts[place, None], poses[:, 4:]], 1)
    different = select_different(rotated, _SAME_VIEW, count)  # seen from above, a turn and a tilt are one rotation
    poses, place = poses[different], place[different]
    scale, tilt, centre = (part[place] for part in (around.scales, around.tilts, around.centres))
    poses = tilt_views(fit_to_box(poses, model.hull, photograph.crop.camera, CROP_FILL * scale), tilt)
    poses[:, 4:] += centre
    return poses, values[different]


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
