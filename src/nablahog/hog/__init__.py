"""Section 2: image to descriptor, differentiable."""

from typing import TYPE_CHECKING

from ..runtime.lazy import names_when_used
from . import presets
from .normalizers import BlockNorm, CellNorm, FourBlockNorm, GlobalNorm
from .poolings import BilinearCells, BlockCells, BoxCells
from .spec import HOGSpec

if TYPE_CHECKING:
    from .descriptor import HOG, hog
    from .layout import from_layout, to_layout
    from .loss import HOGLoss
    from .steps import histograms_reference, normalize_reference
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
    "HOGLoss",
    "HOGSpec",
    "from_layout",
    "histograms_reference",
    "hog",
    "normalize_reference",
    "presets",
    "stream",
    "to_layout",
]

names_when_used(
    __name__,
    descriptor=("HOG", "hog"),
    layout=("from_layout", "to_layout"),
    loss=("HOGLoss",),
    steps=("histograms_reference", "normalize_reference"),
    streaming=("DescriptorStrip", "stream"),
)
