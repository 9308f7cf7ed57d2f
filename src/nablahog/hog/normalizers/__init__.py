"""The normalisers of all dialects, each with its constants and all that follows from them: see :class:`Normalizer`."""

from __future__ import annotations

from .base import Footprint, Normalizer
from .block import BlockForm, BlockNorm
from .four_block import PARTS, FourBlockNorm, Outside, Part, Texture
from .per_cell import CellNorm, GlobalForm, GlobalNorm, PerCell

NORMALIZERS: dict[str, type[Normalizer]] = {
    each.kind: each for each in (GlobalNorm, FourBlockNorm, BlockNorm, CellNorm)
}

__all__ = [
    "NORMALIZERS",
    "PARTS",
    "BlockForm",
    "BlockNorm",
    "CellNorm",
    "Footprint",
    "FourBlockNorm",
    "GlobalForm",
    "GlobalNorm",
    "Normalizer",
    "Outside",
    "Part",
    "PerCell",
    "Texture",
]
