from . import presets as presets
from .descriptor import HOG as HOG, hog as hog
from .layout import from_layout as from_layout, to_layout as to_layout
from .loss import HOGLoss as HOGLoss

# generated: normalizers

from .normalizers import (
    BlockNorm as BlockNorm,
    CellNorm as CellNorm,
    FourBlockNorm as FourBlockNorm,
    GlobalNorm as GlobalNorm,
)

# end of normalizers
from .poolings import BilinearCells as BilinearCells, BlockCells as BlockCells, BoxCells as BoxCells
from .spec import HOGSpec as HOGSpec
from .steps import histograms_reference as histograms_reference, normalize_reference as normalize_reference
from .streaming import DescriptorStrip as DescriptorStrip, stream as stream
