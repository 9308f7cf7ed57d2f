from .base import (
    Footprint as Footprint,
    Identity as Identity,
    Normalizer as Normalizer,
    clipped as clipped,
    proportion_errors as proportion_errors,
    root as root,
)
from .block import BlockNorm as BlockNorm
from .four_block import FourBlockNorm as FourBlockNorm
from .per_cell import CellNorm as CellNorm, GlobalNorm as GlobalNorm, PerCell as PerCell
from .unclip import (
    solve_clipped as solve_clipped,
    sum_over_blocks as sum_over_blocks,
    unclip as unclip,
    unclip_exactly as unclip_exactly,
)
