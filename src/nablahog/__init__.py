"""∇HOG: HOG you can differentiate, invert and fit."""

from .hog import HOG, HOGSpec, hog, presets
from .invert import LearnedPrior, Reconstruction, reconstruct, train_prior

__all__ = ["HOG", "HOGSpec", "LearnedPrior", "Reconstruction", "hog", "presets", "reconstruct", "train_prior"]
