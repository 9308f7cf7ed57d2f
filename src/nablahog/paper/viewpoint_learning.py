"""Learning a viewpoint prior from scenes of procedural chairs before photographs."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..hog import HOGSpec
from ..io.array_cache import cached_array
from ..pose.background import coarse_background
from ..pose.crop import crop_object
from ..pose.similarity import describe
from ..pose.viewpoint_prior import CELLS, EPOCHS, WIDTH, ViewpointLearning, ViewpointPrior, train_viewpoints
from ..runtime.source import code_key
from .viewpoint_scenes import viewpoint_chairs, viewpoint_scene

SCENES = 30_000
_CHUNK = 250  # scenes that are stored together


def learn_viewpoints(
    images: Mapping[str, Tensor],
    spec: HOGSpec,
    *,
    scenes: int | None = None,
    epochs: int | None = None,
    seed: int = 0,
    progress: Callable[[int, int, str], None] = lambda done, total, what: None,
) -> ViewpointPrior:
    """Learns which azimuths are likely for a descriptor of a chair.

    Descriptors of scenes are stored in the user's folder for caches, so that an interrupted run takes up from there.

    Args:
        images: what is behind the chairs, gray (H, W), float32 in 0…1, by name; best without chairs.
        spec: not used: the descriptor is that of the coarse search.
        scenes: number of scenes, rounded up to a multiple of 250; by default :data:`SCENES`.
        epochs: passes over them; by default :data:`.viewpoint_training.EPOCHS`.
        seed: of everything random.
        progress: called with what is done, of how many, and what that is.
    """
    epochs = EPOCHS if epochs is None else epochs
    names = sorted(images)
    digest = hashlib.sha256()
    for name in names:
        digest.update(repr((name, images[name].shape)).encode() + images[name].numpy().tobytes())
    sha256 = digest.hexdigest()
    background, _ = coarse_background(None)
    clutter = [images[name] for name in names]
    descriptors, azimuths = _described(scenes or SCENES, clutter, sha256, seed, progress)
    weights, losses = train_viewpoints(descriptors, azimuths, epochs=epochs, seed=seed, progress=progress)
    learning = ViewpointLearning(
        scenes=len(descriptors), photographs=len(names), sha256=sha256, seed=seed, epochs=epochs, losses=losses
    )
    return ViewpointPrior(background.spec, WIDTH, weights, learning)


def _described(
    count: int, clutter: list[Tensor], sha256: str, seed: int, progress: Callable[[int, int, str], None]
) -> tuple[Tensor, Tensor]:
    """Descriptors (N, C, 16, 16) of scenes, and azimuths (N,), degrees; N is ``count`` rounded up to whole chunks."""
    shape = coarse_background(None)[0].spec.channels, CELLS, CELLS
    chunks = []
    for start in range(0, count, _CHUNK):
        progress(start, count, "scenes")
        key = hashlib.sha256(repr((sha256, seed, start, _code())).encode()).hexdigest()
        size = _CHUNK, 1 + int(np.prod(shape))
        chunks.append(cached_array("viewpoint-scenes", key, size, _Chunk(start, clutter, seed)))
    rows = torch.from_numpy(np.concatenate(chunks))
    return rows[:, 1:].reshape(-1, *shape), rows[:, 0]


class _Chunk:
    """Makes scenes from the number ``start`` on, a row of azimuth and descriptor for each."""

    def __init__(self, start: int, clutter: list[Tensor], seed: int) -> None:
        self.start, self.clutter, self.seed = start, clutter, seed

    def __call__(self) -> NDArray[np.float32]:
        background, shrink = coarse_background(None)
        models = viewpoint_chairs()
        crops, azimuths = [], []
        for index in range(self.start, self.start + _CHUNK):
            made = viewpoint_scene(index, models, self.clutter, seed=self.seed)
            crops.append(crop_object(made.image, made.box).downsampled(shrink).image)
            azimuths.append(made.pose[:1].float())
        descriptors = describe(torch.cat(crops), background.spec).flatten(1)
        rows: NDArray[np.float32] = torch.cat([torch.stack(azimuths), descriptors], 1).numpy()
        return rows


def _code() -> str:
    return code_key(viewpoint_scene, crop_object, describe)
