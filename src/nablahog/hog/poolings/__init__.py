"""The ways in which pixels vote into cells, each with its constants: Eq. 5-6 and what libraries do instead."""

from __future__ import annotations

from .base import PartialCells, Pooling, Spacing
from .bilinear import BilinearCells
from .block import BlockCells
from .box import BoxCells

POOLINGS: dict[str, type[Pooling]] = {each.kind: each for each in (BilinearCells, BoxCells, BlockCells)}

__all__ = ["POOLINGS", "BilinearCells", "BlockCells", "BoxCells", "PartialCells", "Pooling", "Spacing"]
