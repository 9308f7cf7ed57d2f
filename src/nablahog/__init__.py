"""∇HOG: HOG you can differentiate, invert and fit."""

from .hog import HOG, HOGSpec, hog, presets
from .invert import Reconstruction, reconstruct

__all__ = ["HOG", "HOGSpec", "Reconstruction", "hog", "presets", "reconstruct"]
