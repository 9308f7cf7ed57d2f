"""Section 2: image to descriptor, differentiable."""

from typing import TYPE_CHECKING

from ..runtime.lazy import names_when_used
from . import presets
from .normalizers import BlockNorm, CellNorm, FourBlockNorm, GlobalNorm, WindowNorm
from .poolings import BilinearCells, BlockCells, BoxCells
from .spec import HOGSpec

if TYPE_CHECKING:
    from .descriptor import HOG, hog
    from .streaming import DescriptorStrip, stream

__all__ = [
    "HOG",
    "BilinearCells",
    "BlockCells",
    "BlockNorm",
    "BoxCells",
    "CellNorm",
    "DescriptorStrip",
    "FourBlockNorm",
    "GlobalNorm",
    "HOGSpec",
    "WindowNorm",
    "hog",
    "presets",
    "stream",
]

names_when_used(__name__, descriptor=("HOG", "hog"), streaming=("DescriptorStrip", "stream"))
