"""Aubry et al.'s exemplars ("Seeing 3D chairs"): renderings of a model from all around, and the elements of each.

Constants and steps are those of their released code (``DEinit_n100_ms4.m``), which differ a little from the paper's.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from ...hog.descriptor import histograms, normalize
from ...hog.presets import aubry
from ...io.learned_model import TENSOR, Codec, LearnedModel
from ...pose.photograph import all_patches, element_weights, most_discriminative, suppress_overlaps
from ...pose.whitening import Background
from ...render import Camera, Light, Mesh, Renderer, silhouette
from ...runtime.cache import code_key

CELL_SIDE = 5  # pixels of a cell
EXEMPLAR_SPEC = aubry(CELL_SIDE)
OCTAVE_LEVELS = 3  # of a pyramid, per octave
RENDERING_SIDE = 200  # pixels of a rendering: a model of diagonal 1, and half an element around it
FOCAL = 150 / math.tan(math.radians(54.611 / 2))  # pixels; the authors render 600 at 54.611° and begin at half the size
LIGHT = Light(ambient=0.2, diffuse=0.8)
FALSE_POSITIVES = 3.15
"""The score that one of 10,000 patches of photographs reaches, in standard deviations √(wᵀΣw) of the model.

Measured on the photographs that come with scikit-image: 2.9…3.4 for elements of 5x5 and 10x10 cells.  Were scores
normally distributed with the variance of photographs, it would be 2.6; with that of the model, which has λ in it, 3.7.
"""


@dataclass(frozen=True)
class ViewSampling:
    """The views from which models are rendered, in degrees and diagonals, and the elements that are used of each.

    Aubry et al.'s azimuths are the integer parts of linspace(0, 360, 32), 31 directions.  The size of an element, rows
    and columns in cells of 5 pixels, is not published with their code.  ``overlap`` and ``threshold`` are those of
    :func:`nablahog.pose.elements`.
    """

    azimuths: tuple[int, ...] = tuple(int(angle) for angle in np.linspace(0, 360, 32)[:-1])
    elevations: tuple[int, ...] = (20, 30)
    distance: float = 2.0
    size: tuple[int, int] = (10, 10)
    count: int = 10
    overlap: float = 0.25
    threshold: float = 2.0

    def poses(self) -> Tensor:
        """(V, 6), see :data:`nablahog.render.PARAMETERS`."""
        rows = itertools.product(self.azimuths, self.elevations)
        return torch.tensor([(*row, self.distance, 0, 0, 0) for row in rows], dtype=torch.float64)


VIEW_SAMPLING = ViewSampling()


_HALVES = Codec(lambda value: value.half().numpy(), lambda arrays, name: TENSOR.decode(arrays, name).float())


@dataclass(frozen=True, eq=False, repr=False)
class ExemplarViews(LearnedModel):
    """The elements of all views of a model; the weights are stored in float16.

    Attributes:
        weights: (E, r, c, C), float32, as in :class:`~nablahog.pose.Elements`.
        scale, offset: (E,), float32, see :func:`calibration`.
        level: (E,), int64: the level of the pyramid that an element is from; 0 is the rendering itself.
        positions: (E, 2), int64: row and column of its upper left cell there.
        first: (V + 1,), int64: the elements of view v are first[v] … first[v + 1] − 1.
        boxes: (V, 4), float32: x0, y0, x1, y1 of the object, in pixels of the rendering.
        viewpoints: (V, 2), float32: azimuth and elevation, degrees.
    """

    KIND = "view set"
    NOUN = "views"
    FORMAT = 2
    ARRAYS: ClassVar = {
        "weights": _HALVES,
        **dict.fromkeys(("scale", "offset", "level", "positions", "first", "boxes", "viewpoints"), TENSOR),
    }

    weights: Tensor
    scale: Tensor
    offset: Tensor
    level: Tensor
    positions: Tensor
    first: Tensor
    boxes: Tensor
    viewpoints: Tensor

    def __post_init__(self) -> None:
        elements, views = len(self.scale), len(self.viewpoints)
        cells = tuple(self.weights.shape[1:])
        of_views = {"boxes": (views, 4), "viewpoints": (views, 2)}
        floats = {"weights": (elements, *cells), "scale": (elements,), "offset": (elements,)} | of_views
        integers = {"level": (elements,), "positions": (elements, 2), "first": (views + 1,)}
        for shapes, dtype in ((floats, torch.float32), (integers, torch.int64)):
            for name, shape in shapes.items():
                array: Tensor = getattr(self, name)
                if array.dtype != dtype or array.shape != shape or not bool(torch.isfinite(array).all()):
                    got = f"{array.dtype} of {tuple(array.shape)}"
                    raise ValueError(f"{name} must be finite, {dtype} of shape {shape}, got {got}")
        bounded = bool(((self.level >= 0) & (self.level < 64)).all()) and bool((self.positions >= 0).all())
        in_order = bool((self.first.diff() >= 0).all()) and int(self.first[0]) == 0 and int(self.first[-1]) == elements
        if len(cells) != 3 or not bounded or not in_order:
            raise ValueError("weights must be (E, r, c, C), level and positions from 0, first in order of the views")

    @property
    def summary(self) -> str:
        return f"{len(self.viewpoints)} views, {len(self.scale)} elements"


@torch.no_grad()
def learn_views(mesh: Mesh, background: Background, sampling: ViewSampling = VIEW_SAMPLING) -> ExemplarViews:
    """Renders a normalised model from all around, white behind it, and finds the elements of each rendering.

    Patches of all levels of a rendering's pyramid compete, but only those centred on the object: the others are
    mostly empty.  The background has the statistics of other photographs, in the dialect :data:`EXEMPLAR_SPEC`.
    """
    background.check(EXEMPLAR_SPEC)
    poses = sampling.poses()
    camera = Camera(FOCAL * sampling.distance / VIEW_SAMPLING.distance, RENDERING_SIDE, RENDERING_SIDE)
    images = Renderer(mesh, camera, light=LIGHT, supersampling=2)(poses).float()
    masks = silhouette(mesh, poses, camera, supersampling=1)[:, 0] > 0
    boxes = torch.stack([_box_of(mask) for mask in masks])
    of_views = [_elements(image[0], box, background, sampling) for image, box in zip(images, boxes, strict=True)]
    weights, level, positions = (torch.cat(parts) for parts in zip(*of_views, strict=True))
    scale, offset = calibration(weights, background)
    counts = torch.tensor([0, *(len(each[1]) for each in of_views)])
    return ExemplarViews(weights, scale, offset, level, positions, counts.cumsum(0), boxes, poses[:, :2].float())


def concatenate_views(models: Sequence[ExemplarViews]) -> ExemplarViews:
    """The views of several models as one; their elements have one size."""
    names = ExemplarViews.ARRAYS.keys() - {"first"}
    columns = {name: torch.cat([getattr(views, name) for views in models]) for name in names}
    counts = torch.cat([views.first.diff() for views in models])
    return ExemplarViews(first=functional.pad(counts.cumsum(0), (1, 0)), **columns)


def _box_of(mask: Tensor) -> Tensor:
    """x0, y0, x1, y1 around the pixels of a mask, (4,); 0 for an empty one."""
    pixels = mask.nonzero().flip(1)  # x, y
    return torch.cat([pixels.amin(0), pixels.amax(0) + 1]).float() if len(pixels) else torch.zeros(4)


def _elements(
    image: Tensor, box: Tensor, background: Background, sampling: ViewSampling
) -> tuple[Tensor, Tensor, Tensor]:
    """Weights (E, r, c, C), levels (E,) and positions (E, 2) of the elements of a rendering (S, S)."""
    size = torch.tensor(sampling.size)
    patches, places = [], []
    for level, cells in enumerate(pyramid(image, sampling.size)):
        every = all_patches(cells, sampling.size)
        pixels: float = CELL_SIDE * 2 ** (level / OCTAVE_LEVELS)
        at = torch.cartesian_prod(*(torch.arange(n) for n in every.shape[:2]))
        middle = (at + size / 2) * pixels
        at = at[((middle >= box[[1, 0]]) & (middle <= box[[3, 2]])).all(1)]
        patches.append(every[at[:, 0], at[:, 1]])
        places.append(torch.cat([torch.full((len(at), 1), level), at], dim=1))
    patch, place = torch.cat(patches), torch.cat(places)
    order, _ = most_discriminative(patch, background, sampling.threshold)
    enlarged = CELL_SIDE * 2 ** (place[order, :1] / OCTAVE_LEVELS)
    corners = torch.cat([place[order, 1:] * enlarged, (place[order, 1:] + size) * enlarged], dim=1)
    kept = order[suppress_overlaps(corners, sampling.count, sampling.overlap)]
    return element_weights(patch[kept], background), place[kept, 0], place[kept, 1:]


def calibration(weights: Tensor, background: Background) -> tuple[Tensor, Tensor]:
    """a and b, each (N,), for weights (N, r, c, C): a·wᵀx + b is −1 for the mean of photographs, 0 for 1 in 10,000."""
    of_mean = (weights * background.template_mean(*weights.shape[1:3]).to(weights)).sum(dim=(1, 2, 3))
    scale = 1 / (FALSE_POSITIVES * background.deviation(weights))
    return scale, -scale * of_mean - 1


def pyramid(image: Tensor, size: tuple[int, int]) -> list[Tensor]:
    """Descriptors (rows, cols, C) of a gray image (H, W), each 2^(1/3) times smaller than the one before,
    as long as they have ``size`` (rows, cols) cells."""
    levels: list[Tensor] = []
    while True:
        sides = [max(1, round(side * 2 ** (-len(levels) / OCTAVE_LEVELS))) for side in image.shape]
        if any((side + CELL_SIDE // 2) // CELL_SIDE < least for side, least in zip(sides, size, strict=True)):
            return levels
        small = image[None, None]
        if levels:
            small = functional.interpolate(small, sides, mode="bicubic", antialias=True).clamp(0, 1)
        levels.append(normalize(histograms(small, EXEMPLAR_SPEC), EXEMPLAR_SPEC)[0].permute(1, 2, 0))


class ExemplarLibrary:
    """Views of models, each learned once and stored in ``folder``; None: kept in this process only."""

    def __init__(self, folder: Path | None, background: Background, sampling: ViewSampling = VIEW_SAMPLING) -> None:
        self.folder, self.background, self.sampling = folder, background, sampling
        self._views: dict[str, ExemplarViews] = {}
        facts = [ExemplarViews.FORMAT, code_key(), asdict(sampling), background.spec.to_json()]
        self._common = hashlib.sha256(json.dumps(facts).encode())
        for array in (background.mean, background.covariance):
            self._common.update(array.numpy().tobytes())

    def views(self, mesh: Mesh) -> ExemplarViews:
        """The views of a normalised mesh: from memory, from the folder, or learned and stored there.

        Raises:
            OSError: the folder cannot be written.
        """
        whole = self._common.copy()
        for array in (mesh.vertices, mesh.faces, mesh.brightness):
            whole.update(array.numpy().tobytes())
        key = whole.hexdigest()
        if key not in self._views:
            self._views[key] = self._read_or_learn(mesh, key)
        return self._views[key]

    def _read_or_learn(self, mesh: Mesh, key: str) -> ExemplarViews:
        if self.folder is None:
            return learn_views(mesh, self.background, self.sampling)
        path = self.folder / f"{key}.npz"
        try:
            return ExemplarViews.load(path)
        except (FileNotFoundError, ValueError):  # a damaged file is made again
            self.folder.mkdir(parents=True, exist_ok=True)
            learn_views(mesh, self.background, self.sampling).save(path)
            return ExemplarViews.load(path)  # with the weights rounded as on disk
