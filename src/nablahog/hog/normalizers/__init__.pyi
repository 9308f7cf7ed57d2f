from .base import Footprint as Footprint, Normalizer as Normalizer, clipped as clipped, root as root
from .block import BlockNorm as BlockNorm
from .four_block import FourBlockNorm as FourBlockNorm
from .per_cell import CellNorm as CellNorm, GlobalNorm as GlobalNorm, PerCell as PerCell
