"""The models that methods of Table 1 learn from photographs.  A new kind is one more entry of :data:`LEARNED`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from torch import Tensor

from ..hog import HOGSpec, presets
from ..invert.prior.choice import default_prior_file
from ..invert.prior.training import PRIOR_LEARNER
from ..io.images import limit_size
from ..io.learned_model import load_once
from ..io.learner import Learner, Progress
from ..io.photographs import sample_photographs
from ..runtime.cache import cache_folder, code_key
from .baselines.bovw import BoVW
from .baselines.bovw_learning import learn_bovw
from .baselines.hoggles import PairedDictionary, check_cells, patch_size
from .baselines.hoggles_learning import learn_hoggles
from .names import PRIORS

SPEC: HOGSpec = presets.uoctti()
"""The descriptor of the methods that learn, as in the paper."""


LEARNED = {
    "prior": PRIOR_LEARNER,
    "unsigned-prior": PRIOR_LEARNER,
    "hoggles": Learner(PairedDictionary, learn_hoggles, check_cells, patch_size),
    "bovw": Learner(
        BoVW, lambda images, spec, **options: learn_bovw(images, **options), least=lambda spec: (1, 1), tile=128
    ),
}
"""By the name of the option for its file; those of :data:`.PRIORS` are not learned unless asked for."""


def shipped_files() -> dict[str, Path]:
    """The files of :data:`.PRIORS` that the package was installed with."""
    files = {kind: default_prior_file(spec) for kind, spec in zip(PRIORS, (SPEC, presets.paper()), strict=True)}
    return {kind: file for kind, file in files.items() if file is not None and file.exists()}


def load(kind: str, path: Path) -> Any:
    """The model of a kind in a file, which is read once however many images it is used for."""
    return load_once(LEARNED[kind].model, path)


def learned_from_samples(kind: str, progress: Progress) -> Path:
    """The file of the model that is learned from the sample photographs, once for all runs, in the folder for caches.

    Raises:
        OSError: it cannot be stored.
    """
    path = cache_folder() / f"{kind}-{code_key()[:16]}.npz"
    try:
        load(kind, path)
    except (OSError, ValueError):  # missing, or damaged by another program
        path.parent.mkdir(parents=True, exist_ok=True)
        LEARNED[kind].learn_to(path, sample_training_photographs(kind), SPEC, progress, seed=0)
    return path


def sample_training_photographs(kind: str) -> dict[str, Tensor]:
    """The sample photographs for learning a kind: at most 512 pixels wide, or in tiles."""
    images, tile = sample_photographs(size=512, whole=True).images, LEARNED[kind].tile
    return images if tile is None else tiles(images, tile)


def tiles(images: Mapping[str, Tensor], side: int) -> dict[str, Tensor]:
    """Squares of ``side`` pixels that overlap by half, from images (H, W) and from these at half their size."""
    squares = {}
    for name, image in images.items():
        for scale in (1, 2):
            small = image if scale == 1 else limit_size(image[None], max(image.shape) // scale)[0]
            for y in range(0, small.shape[0] - side + 1, side // 2):
                for x in range(0, small.shape[1] - side + 1, side // 2):
                    squares[f"{name}, 1/{scale}, {y}, {x}"] = small[y : y + side, x : x + side].contiguous()
    return squares
