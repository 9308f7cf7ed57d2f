"""The photographs that a model was trained on."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

from torch import Tensor

from ...runtime.text import counted


@dataclass(frozen=True, kw_only=True)
class Learning:
    """How a model was learned.  Subclasses add the numbers of their method.

    Attributes:
        images: the names of the photographs, sorted.
        sha256: :func:`digest_of_images` of them.
        seed: the seed of all random numbers.
    """

    images: tuple[str, ...]
    sha256: str
    seed: int


@dataclass(frozen=True, kw_only=True)
class NetworkLearning(Learning):
    """How a network was trained.

    Attributes:
        epochs: passes over the photographs.
        losses: the mean loss of each epoch.
        start: SHA-256 of the initial weights, hexadecimal; empty if these were random.
        precision: the precision of its convolutions and matrix products.
        calibration: the numbers of its :class:`.confidence.Calibration`; empty if nothing was calibrated.
        calibrated_on: the names of the photographs that these were fitted to, none of which it was trained on.
    """

    epochs: int
    losses: tuple[float, ...]
    start: str = ""
    precision: str = "float32"
    calibration: tuple[float, ...] = ()
    calibrated_on: tuple[str, ...] = ()

    @property
    def summary(self) -> str:
        extent = f"{counted(len(self.images), 'image')}, {counted(self.epochs, 'epoch')}"
        return f"{extent}, last loss {self.losses[-1]:.4f}"


def digest_of_weights(weights: Tensor) -> str:
    """The SHA-256 of weights (n,), float16, hexadecimal."""
    return hashlib.sha256(weights.cpu().numpy().tobytes()).hexdigest()
