"""Dense SIFT: Lowe's descriptor, upright and of one scale, at every point of a grid.

A window of 4x4 cells has in each cell a histogram of 8 signed orientations, bilinear in place and linear in angle,
computed by this package's operator.  Each cell is weighted by a Gaussian at its centre, as in VLFeat's ``dsift`` with
its flat window.  The 128 numbers are normalised to length 1, clipped at 0.2 and normalised again (D. Lowe,
*Distinctive Image Features from Scale-Invariant Keypoints*, IJCV 2004).

No :class:`.HOGSpec` describes it: no normaliser weights the cells of a block by a Gaussian, or gives 0 for a window of
too little contrast.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import normalize

from ...hog.descriptor import histograms
from ...hog.normalizers import GlobalNorm
from ...hog.spec import HOGSpec

WINDOW_CELLS = 4  # of a window's side
ORIENTATIONS = 8
LENGTH = WINDOW_CELLS * WINDOW_CELLS * ORIENTATIONS
WINDOW_SIGMA = 2.0  # cells: of the Gaussian that weights them
CLIP = 0.2
LEAST_CONTRAST = 0.0125  # length of a window's weighted votes per pixel of a cell's side; with less, it is flat


def sift_grid(height: int, width: int, cell: int) -> tuple[int, int]:
    """Rows and columns of windows in an image, one at each cell where a whole window fits; 0 where none does."""
    rows, cols = (max(0, side // cell - WINDOW_CELLS + 1) for side in (height, width))
    return rows, cols


@torch.no_grad()
def dense_sift(images: Tensor, cell: int) -> Tensor:
    """The descriptors (B, rows, cols, 128) of all windows of 4x4 cells, one cell apart, of images (B, 1, H, W) in 0…1.

    Numbers are by cell row, cell column and orientation; bin k is of gradients at 45° · k, clockwise on screen.  The
    length is 1, or 0 for a flat window: with an edge of one 8-bit level through its middle it is flat, with one of two
    it is not.  The outermost pixels of an image do not vote.
    """
    spec = HOGSpec(
        name="dense SIFT",
        value_range=1.0,
        colour="gray",
        border="ignore",
        bins=ORIENTATIONS,
        signed=True,
        bin_offset=0.0,
        vote="linear",
        cell_size=(cell, cell),
        partial_cells="floor",
        normalizer=GlobalNorm(),
    )
    windows = histograms(images, spec).unfold(2, WINDOW_CELLS, 1).unfold(3, WINDOW_CELLS, 1).permute(0, 2, 3, 4, 5, 1)
    offset = (torch.arange(WINDOW_CELLS).to(images) - (WINDOW_CELLS - 1) / 2) / WINDOW_SIGMA
    weights = torch.exp(-offset.square() / 2)
    votes = (windows * torch.outer(weights, weights).unsqueeze(2)).flatten(3)
    length, least = votes.norm(dim=3, keepdim=True), LEAST_CONTRAST * cell
    clipped = (votes / length.clamp(min=least)).clamp(max=CLIP)
    return torch.where(length < least, 0.0, normalize(clipped, dim=3))
