"""The baseline of Section 3.2: Aubry et al. ("Seeing 3D chairs") detect renderings of all models in the image.

Their steps, with the constants of their released code: the elements of each rendering (:mod:`.exemplar_views`) are
scored at all cells and levels of the image's pyramid, each votes for where the rendering lies (:func:`star_match`),
and the view of the most confident detection is the pose.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...hog.box import Box
from ...pose.crop import ObjectCrop, crop_object
from ...pose.photograph import all_patches
from .exemplar_views import CELL, LEVELS, ExemplarViews, concatenate_views, pyramid
from .star_matching import NOTHING, Layout, Pyramid, star_match

FILL = 150.0  # pixels of the longer side of the object's box: no less than in renderings, so that all levels exist
SIDE = 200  # of the square that is searched: half an element around the box
AT_ONCE = 4096  # elements that are scored together: 32 MiB of scores for an image of 2000 places
MARGIN = 10.0  # pixels by which the middle of an element may lie outside the box


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

    def match(self, views: ExemplarViews, agreement: float) -> NDArray[np.floating]:
        """The best detection of each view, (V, 7), see :func:`.star_matching.star_match`."""
        scores = torch.full((len(views.scale), int(self.pyramid.start[-1])), NOTHING)
        weights = views.scale[:, None] * views.weights.flatten(1)
        scores[:, self.places] = torch.addmm(views.offset[:, None], weights, self.patches.T)
        layout = Layout(views.level.numpy(), views.positions.numpy(), views.first.numpy(), views.boxes.double().numpy())
        return star_match(scores.numpy(), self.pyramid, layout, self.box, agreement)
