"""Where the search begins: the smooth image that the directed votes integrate to, and a little noise.

The mean gradient of a cell, Σ_b h_b · direction of b, is what a signed histogram keeps of the gradient field at low
resolution.  Interpolated between cells and integrated (Poisson's equation, solved in the cosine basis), it is already a
blurred version of the image.  A descent from noise alone would have to build that from the votes of pixels that point
anywhere, and would carry their randomness along to the end.  An unsigned histogram has no such mean: there the search
begins with noise alone.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn.functional import pad

from ..hog.pooling import pooling_matrix
from ..hog.spec import HOGSpec
from .parameterize import cosines

NOISE = 0.01  # standard deviation of the noise, in 0…1; without any, nothing tells a thin line's two sides apart


def starting_image(votes: Tensor, spec: HOGSpec, height: int, width: int, seed: int) -> Tensor:
    """Images (B, 1, H, W) around 0.5 from histograms (B, bins, rows, cols).  The noise is the same for every image."""
    generator = torch.Generator().manual_seed(seed)
    noise = torch.randn((1, 1, height, width), generator=generator, dtype=torch.float64)
    image = (0.5 + NOISE * noise).to(votes).expand(len(votes), -1, -1, -1)
    if spec.signed:
        image = image + integrate(*mean_gradient(votes, spec, height, width)) / spec.value_range
    return image


def mean_gradient(votes: Tensor, spec: HOGSpec, height: int, width: int) -> tuple[Tensor, Tensor]:
    """Smooth fields Gx, Gy, each (B, H, W) in units of Eq. 2, from a signed spec's histograms (B, bins, rows, cols)."""
    bins = torch.arange(spec.bins, dtype=votes.dtype, device=votes.device)
    angles = (bins + spec.bin_offset) * spec.period / spec.bins
    by_row, by_col = (
        pooling_matrix(pixels, cell, cells, False, votes)
        for pixels, cell, cells in zip((height, width), spec.cell_size, votes.shape[2:], strict=True)
    )
    # a cell's votes over its weights' sum are its mean, which the same weights interpolate between the centres
    mean = votes / (by_row.sum(dim=1, keepdim=True) * by_col.sum(dim=1))
    gx, gy = (by_row.T @ torch.einsum("bkrc,k->brc", mean, f(angles)) @ by_col for f in (torch.cos, torch.sin))
    return gx, gy


def integrate(gx: Tensor, gy: Tensor) -> Tensor:
    """Images (B, 1, H, W) of zero mean whose [-1, 0, 1] differences are closest to smooth fields gx, gy (B, H, W)."""
    height, width = gx.shape[-2:]
    rows, cols = cosines(height, gx), cosines(width, gx)
    # the difference of two neighbours is half the mask's response, averaged over the two pixels
    fx, fy = (gx[..., :, 1:] + gx[..., :, :-1]) / 4, (gy[..., 1:, :] + gy[..., :-1, :]) / 4
    divergence = pad(fx, (0, 1)) - pad(fx, (1, 0)) + pad(fy, (0, 0, 0, 1)) - pad(fy, (0, 0, 1, 0))
    along_y, along_x = (2 * torch.cos(math.pi * torch.arange(n) / n) - 2 for n in (height, width))
    laplacian = (along_y.unsqueeze(1) + along_x).to(gx)  # its eigenvalues in the cosine basis
    laplacian[0, 0] = torch.inf
    return (rows.T @ ((rows @ divergence @ cols.T) / laplacian) @ cols).unsqueeze(1)
