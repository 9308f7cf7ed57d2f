"""Section 2: image to descriptor, differentiable."""

from . import presets
from .descriptor import HOG, hog
from .spec import FourBlockNorm, GlobalNorm, HOGSpec

__all__ = ["HOG", "FourBlockNorm", "GlobalNorm", "HOGSpec", "hog", "presets"]
