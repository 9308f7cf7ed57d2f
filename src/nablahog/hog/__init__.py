"""Section 2: image to descriptor, differentiable."""

from . import presets
from .descriptor import HOG, hog
from .normalizers import BlockNorm, CellNorm, FourBlockNorm, GlobalNorm
from .poolings import BilinearCells, BlockCells, BoxCells
from .spec import HOGSpec

__all__ = [
    "HOG",
    "BilinearCells",
    "BlockCells",
    "BlockNorm",
    "BoxCells",
    "CellNorm",
    "FourBlockNorm",
    "GlobalNorm",
    "HOGSpec",
    "hog",
    "presets",
]
