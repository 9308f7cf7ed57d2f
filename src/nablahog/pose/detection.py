"""Where in a photograph an object may be, if no box is given: its views at all places and scales."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from ..hog.gradient import gray
from .crop import FILL, SIDE
from .elements import suppress_overlaps
from .placement import bounding_boxes, equidistant_azimuths, fit_to_box, level_poses
from .prepared import PreparedModel, whitener_of
from .problem import SMALL, unlikely_view
from .pyramid import places, turned
from .similarity import describe
from .views import VIEW_COUNT, view_descriptors
from .whitening import Background

LEVELS = 4  # of the pyramid, from one size of the object to the double
SMALLEST = 8  # times smaller than the photograph's longer side: objects that are looked for
BORDER = 4  # cells that an object may reach beyond the photograph
EVERY = 2  # how many views around are passed over to the next
_PEAKS = 200  # places of which those that overlap are left out
_OVERLAP = 0.5  # of two boxes, at most: intersection in the box around both


@dataclass(frozen=True, eq=False)
class Places:
    """Where views fit best.

    Attributes:
        similarities: (K,), of the best view there, less what is unlikely of it, the highest first.
        models: the models' names.
        poses: (K, 6) for a crop whose middle is the photograph's, and of which the longer side of an upright view fills
            :data:`.crop.FILL` of :data:`.crop.SIDE` pixels, still to be placed: azimuth, elevation and tilt are those
            of the view.
        boxes: (K, 4), x0, y0, x1, y1 around the view in the photograph, pixels.
    """

    similarities: Tensor
    models: tuple[str, ...]
    poses: Tensor
    boxes: Tensor


@dataclass(frozen=True, eq=False)
class _Level:
    """The photograph at one scale and tilt.

    Attributes:
        weights: (C, rows, cols), its whitened descriptor.
        middles: (down, across, 2), x, y in the photograph of the middles of windows, pixels.
        inside: (down, across), whether they are in the photograph.
        zoom: pixels of the level for one of the photograph.
        tilt: degrees.
    """

    weights: Tensor
    middles: Tensor
    inside: Tensor
    zoom: float
    tilt: float


def find_places(
    image: Tensor,
    models: Iterable[tuple[str, PreparedModel]],
    elevations: Sequence[float],
    tilts: Sequence[float],
    background: Background,
    shrink: int,
    allowed: Tensor,
    count: int,
) -> Places:
    """The places where views of models are most similar to the photograph, without those that overlap a better one.

    Args:
        image: (C, H, W), the photograph, in 0…1.
        models: by name.
        elevations, tilts: of the views, degrees.
        background: of the coarse descriptor.
        shrink: factor by which a crop is made smaller before it is described.
        allowed: (VIEW_COUNT / EVERY,), bool: which azimuths.
        count: the most to return.
    """
    models = list(models)
    rows, cols = background.spec.grid(SIDE // shrink, SIDE // shrink)
    whitener = whitener_of(background, rows, cols)
    of_models = [
        torch.cat([view_descriptors(model, background.spec, whitener, shrink, each)[::EVERY] for each in elevations])
        for _, model in models
    ]
    searched = allowed.repeat(len(models) * len(elevations)).nonzero()[:, 0]
    views = torch.cat(of_models)[searched]
    of_views = torch.tensor(elevations).repeat_interleave(VIEW_COUNT // EVERY).repeat(len(models))[searched]
    views = views.reshape(len(views), -1, rows, cols)
    peaks: list[Tensor] = []  # similarity, view, x, y, zoom, tilt of each
    for level in _levels(image, background, (rows, cols), shrink, tilts):
        lost = torch.tensor(SMALL * math.log2(max(image.shape[1:]) * shrink * level.zoom / FILL))
        if len(elevations) > 1:  # nothing is known of the pose
            lost = lost + unlikely_view(of_views, torch.tensor([level.tilt]))
        values, view = (_correlations(level.weights, views) - lost).max(2)
        values = torch.where(level.inside, values, -torch.inf)
        around = functional.max_pool2d(values[None, None], 3, stride=1, padding=1)[0, 0]
        peak = (values >= around) & level.inside
        found = torch.stack([values[peak], searched[view[peak]].float()], 1).double()
        where = found.new_tensor([level.zoom, level.tilt]).expand(len(found), 2)
        peaks.append(torch.cat([found, level.middles[peak], where], 1))
    best = torch.cat(peaks)
    best = best[best[:, 0].argsort(descending=True)[:_PEAKS]]
    view, zoom = best[:, 1].long(), best[:, 4]
    each = len(elevations) * VIEW_COUNT // EVERY
    poses = level_poses(equidistant_azimuths(VIEW_COUNT)[::EVERY].repeat(len(elevations) * len(models))[view], 0)
    of_elevation = torch.tensor(elevations, dtype=torch.float64).repeat_interleave(VIEW_COUNT // EVERY)
    poses[:, 1] = of_elevation.repeat(len(models))[view]
    boxes = torch.empty(len(best), 4, dtype=torch.float64)
    for k, (_, model) in enumerate(models):
        mine = (view // each == k).nonzero()[:, 0]
        if len(mine):
            upright = fit_to_box(poses[mine], model.hull, model.camera, FILL)
            upright[:, 3] = best[mine, 5]
            angle = torch.deg2rad(upright[:, 3])
            x, y = upright[:, 4].clone(), upright[:, 5].clone()
            upright[:, 4], upright[:, 5] = angle.cos() * x + angle.sin() * y, angle.cos() * y - angle.sin() * x
            poses[mine] = upright
            boxes[mine] = bounding_boxes(upright, model.hull, model.camera)
    boxes = boxes / (shrink * zoom)[:, None] + best[:, [2, 3, 2, 3]]
    kept = suppress_overlaps(boxes, count, _OVERLAP)
    names = tuple(models[k][0] for k in (view[kept] // each).tolist())
    return Places(best[kept, 0], names, poses[kept], boxes[kept])


def _levels(
    image: Tensor, background: Background, size: tuple[int, int], shrink: int, tilts: Sequence[float]
) -> Iterator[_Level]:
    """The photograph at all scales and tilts, from the finest on."""
    spec = background.spec
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
            sides = spec.image_size(*cells)
            canvas = turned(photograph[0, 0], [tilt], 1.0, sides)
            descriptor = describe(canvas[:, None], spec)
            whitener = whitener_of(background, *descriptor.shape[2:])
            at = [(torch.arange(n, dtype=torch.float64) - (n - 1) / 2) * cell for n in descriptor.shape[2:]]
            one, turn = torch.ones(1, dtype=torch.float64), torch.tensor([tilt], dtype=torch.float64)
            x, y = places(at, one, turn)
            valid = (x.abs() <= shape[1] / 2) & (y.abs() <= shape[0] / 2)
            weights = whitener(whitener.centred(descriptor) * valid[:, None])[0]
            down, across = (n - least + 1 for n, least in zip(weights.shape[1:], size, strict=True))
            at = [(torch.arange(n, dtype=torch.float64) - (n - 1) / 2) * cell for n in (down, across)]
            x, y = (part[0] for part in places(at, one, turn))
            inside = (x.abs() <= shape[1] / 2) & (y.abs() <= shape[0] / 2)
            middles = torch.stack([x / zoom + width / 2, y / zoom + height / 2], 2)
            yield _Level(weights, middles, inside, zoom, tilt)


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
