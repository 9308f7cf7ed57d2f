"""What methods of Table 1 have learned from photographs.  A new kind is one more entry of :data:`LEARNED`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol, TypeAlias

from platformdirs import user_cache_path
from torch import Tensor

from ..hog import HOGSpec, presets
from ..invert import LearnedPrior
from ..invert.baselines.bovw import BoVW
from ..invert.baselines.bovw_learning import learn_bovw
from ..invert.baselines.hoggles import PairedDictionary
from ..invert.baselines.hoggles_learning import learn_hoggles
from ..invert.baselines.nearest import NearestWindows, learn_nearest
from ..invert.baselines.ridge import RidgeRegression, learn_ridge
from ..io.files import checkpoint_for
from ..io.images import limit_size
from ..jobs.store import code
from .photographs import sample_photographs

Progress: TypeAlias = Callable[[int, int, str], None]


class Saved(Protocol):
    """Something learned, that can be kept."""

    def save(self, path: Path) -> None: ...


@dataclass(frozen=True)
class Learned:
    """A kind of what is learned.

    Attributes:
        load: reads one from a file; raises OSError or ValueError.
        images: the names of the images that one has seen.
        learn: from gray photographs (H, W), float32 in 0…1, by name, with a seed, and a file for a checkpoint, if it
            takes long; None for what takes hours, so that nobody begins it unasked.
        tile: pixels of the side of all images to learn from, where they must have one; None where any will do.
    """

    load: Callable[[Path], Any]
    images: Callable[[Any], tuple[str, ...]]
    learn: Callable[[Mapping[str, Tensor], int, Path, Progress], Saved] | None = None
    tile: int | None = None


SPEC: HOGSpec = presets.uoctti()
"""The descriptor of the methods that learn, as in the paper."""


def _hoggles(images: Mapping[str, Tensor], seed: int, checkpoint: Path, progress: Progress) -> PairedDictionary:
    return learn_hoggles(images, SPEC, seed=seed, checkpoint=checkpoint, progress=progress)


def _bovw(images: Mapping[str, Tensor], seed: int, checkpoint: Path, progress: Progress) -> BoVW:
    return learn_bovw(images, seed=seed, progress=progress)


def _ridge(images: Mapping[str, Tensor], seed: int, checkpoint: Path, progress: Progress) -> RidgeRegression:
    return learn_ridge(images, SPEC, seed=seed, progress=progress)


def _nearest(images: Mapping[str, Tensor], seed: int, checkpoint: Path, progress: Progress) -> NearestWindows:
    return learn_nearest(images, SPEC, seed=seed, progress=progress)


LEARNED = {
    "prior": Learned(LearnedPrior.load, lambda prior: tuple(prior.training.images)),
    "hoggles": Learned(PairedDictionary.load, lambda pair: tuple(pair.learning.images), _hoggles),
    "bovw": Learned(BoVW.load, lambda words: tuple(words.learning.images), _bovw, tile=128),
    "ridge": Learned(RidgeRegression.load, lambda ridge: tuple(ridge.learning.images), _ridge),
    "nearest": Learned(NearestWindows.load, lambda database: tuple(database.learning.images), _nearest),
}
"""By name, which is also that of the option for a file of it, and of what ``nablahog learn`` learns."""


def load(kind: str, path: Path) -> Any:
    """What is in a file of the kind, read once however many images it is used for.

    Raises:
        OSError, ValueError: it cannot be read.
    """
    state = path.stat() if path.exists() else None
    return _loaded(kind, path, state and state.st_mtime_ns, state and state.st_size)


@lru_cache(maxsize=len(LEARNED))
def _loaded(kind: str, path: Path, changed: int | None, size: int | None) -> Any:
    return LEARNED[kind].load(path)


def learned_from_samples(kind: str, progress: Progress) -> Path:
    """The file of what is learned from the photographs that come with scikit-image, once for all runs.

    It is kept in the user's folder for caches.  If the learning was interrupted, it goes on.

    Raises:
        OSError: it cannot be kept.
    """
    learned = LEARNED[kind]
    assert learned.learn is not None
    path = user_cache_path("nablahog") / f"{kind}-{code('hog', 'invert', 'io', 'runtime', 'evaluate')[:16]}.npz"
    try:
        load(kind, path)
    except (OSError, ValueError):  # missing, or damaged by whatever else uses such folders
        path.parent.mkdir(parents=True, exist_ok=True)
        with checkpoint_for(path) as checkpoint:
            learned.learn(sample_training_photographs(kind), 0, checkpoint, progress).save(path)
    return path


def sample_training_photographs(kind: str) -> dict[str, Tensor]:
    """The photographs that come with scikit-image as the kind is learned from: at most 512 pixels wide, or in tiles."""
    images, tile = sample_photographs(size=512, whole=True).images, LEARNED[kind].tile
    return images if tile is None else tiles(images, tile)


def tiles(images: Mapping[str, Tensor], side: int) -> dict[str, Tensor]:
    """Squares of ``side`` pixels that overlap by half, from images (H, W) and from these at half their size."""
    found = {}
    for name, image in images.items():
        for scale in (1, 2):
            small = image if scale == 1 else limit_size(image[None], max(image.shape) // scale)[0]
            for y in range(0, small.shape[0] - side + 1, side // 2):
                for x in range(0, small.shape[1] - side + 1, side // 2):
                    found[f"{name}, 1/{scale}, {y}, {x}"] = small[y : y + side, x : x + side].contiguous()
    return found
