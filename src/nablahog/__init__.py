"""∇HOG: HOG you can differentiate, invert and fit."""

from .hog import HOG, HOGSpec, hog, presets

__all__ = ["HOG", "HOGSpec", "hog", "presets"]
