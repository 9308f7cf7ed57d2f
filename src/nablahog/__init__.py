"""∇HOG: HOG you can differentiate, invert and fit."""

from typing import TYPE_CHECKING

from .runtime.lazy import names_when_used

if TYPE_CHECKING:
    from .hog import HOG, HOGSpec, hog, presets, stream
    from .invert import LearnedPrior, Reconstruction, reconstruct, train_prior

__all__ = ["HOG", "HOGSpec", "LearnedPrior", "Reconstruction", "hog", "presets", "reconstruct", "stream", "train_prior"]

names_when_used(
    __name__,  # PyTorch takes two seconds to load
    hog=("HOG", "HOGSpec", "hog", "presets", "stream"),
    invert=("LearnedPrior", "Reconstruction", "reconstruct", "train_prior"),
)
