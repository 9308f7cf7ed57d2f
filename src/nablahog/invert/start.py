"""Where the search begins: the smooth image that the votes integrate to, plus noise.

A signed histogram holds the mean gradient of its cell, Σ_b h_b · direction of b: the gradient field at low resolution.
Interpolated between cells and integrated (Poisson's equation, solved in the cosine basis), it is already a blurred
version of the image.  A descent from noise alone would have to build that from randomly oriented pixels, and would keep
some of their randomness.  An unsigned histogram has no such mean: there the image follows from estimated signs of the
gradients (:mod:`.signs`).
"""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor
from torch.nn.functional import interpolate, pad

from ..hog.descriptor import histograms
from ..hog.entries import mean_over_colours
from ..hog.orientation import bin_angles
from ..hog.spec import HOGSpec
from ..hog.steps import pooling_matrices
from .cosine import from_cosines, to_cosines
from .histograms import of_one_colour
from .signs import expected_cells

NOISE = 0.01  # standard deviation, in 0…1; without any, the two sides of a thin line would stay equal
INVISIBLE = 1e-5  # in 0…1, far below a step of 8 bits and above the rounding of an enlargement
TINY = 1e-30


def starting_images(
    votes: Tensor, spec: HOGSpec, height: int, width: int, count: int, seed: int, spread: float = NOISE
) -> Tensor:
    """Images (B, count, 1, H, W) around 0.5 from histograms (B, colours · bins, rows, cols).

    The noise has the standard deviation ``spread``, comes in pairs, and is the same for every image of the batch.
    """
    if spec.signed:
        smooth = integrate(*mean_gradient(mean_over_colours(votes, spec), spec, height, width)).unsqueeze(1)
    else:
        cells = expected_cells(of_one_colour(votes, spec, (height, width)), spec, seed).unsqueeze(1)
        # votes of a cell, each the difference of two pixels, to the difference of two cells
        per_step = math.sqrt(spec.cell_size[0] * spec.cell_size[1])
        smooth = enlarge(cells / per_step, height, width).unsqueeze(2)
    return 0.5 + smooth / spec.value_range + in_pairs(votes, height, width, count, seed, spread)


def noise(like: Tensor, height: int, width: int, count: int, seed: int, spread: float = NOISE) -> Tensor:
    """(1, count, 1, H, W), of zero mean and the standard deviation ``spread``."""
    generator = torch.Generator().manual_seed(seed)
    unit = torch.randn((1, count, 1, height, width), generator=generator, dtype=torch.float64)
    return (unit * spread).to(like)


def in_pairs(like: Tensor, height: int, width: int, count: int, seed: int, spread: float) -> Tensor:
    """The same, in pairs of opposite sign.

    The result of a search depends in part linearly on its initial noise; that part cancels in the mean of a pair.
    """
    half = noise(like, height, width, (count + 1) // 2, seed, spread)
    return torch.cat([half, -half[:, : count // 2]], dim=1)


def at_contrast(image: Tensor, votes: Tensor, spec: HOGSpec) -> Tensor:
    """Images (B, 1, H, W) at the contrast for which their histograms come closest to ``votes``, around 0.5.

    Histograms are proportional to the contrast, so this is one division.  Images that only vary by rounding become
    constant.
    """
    image = image - image.mean(dim=(2, 3), keepdim=True)
    varies = image.abs().amax(dim=(1, 2, 3), keepdim=True) > INVISIBLE
    image = torch.where(varies, image, 0)
    own = histograms(image, spec)
    size = own.square().sum(dim=(1, 2, 3))
    contrast = torch.where(size > 0, (own * votes).sum(dim=(1, 2, 3)) / torch.where(size > 0, size, 1), 1)
    return 0.5 + image * contrast.reshape(-1, 1, 1, 1)


def enlarge(images: Tensor, height: int, width: int) -> Tensor:
    """Images (B, K, h, w) to (B, K, H, W), bicubic; as they are if that is their size."""
    if images.shape[2:] == (height, width):
        return images
    return interpolate(images, size=(height, width), mode="bicubic", align_corners=False)


def mean_gradient(votes: Tensor, spec: HOGSpec, height: int, width: int) -> tuple[Tensor, Tensor]:
    """Smooth fields Gx, Gy, each (B, H, W) in units of Eq. 2, from a signed spec's histograms (B, bins, rows, cols)."""
    angles = torch.from_numpy(bin_angles(spec)).to(votes)
    by_row, by_col = pooling_matrices(replace(spec, border="reflect"), height, width, votes)
    # a cell's votes divided by the sum of its weights are its mean; the same weights interpolate between the centres
    mean = votes / (by_row.sum(dim=1, keepdim=True) * by_col.sum(dim=1))
    if not spec.pooling.interpolates:  # whose weights of a pixel sum to 1
        by_row, by_col = (matrix / matrix.sum(dim=0).clamp(min=TINY) for matrix in (by_row, by_col))
    gx, gy = (by_row.T @ torch.einsum("bkrc,k->brc", mean, f(angles)) @ by_col for f in (torch.cos, torch.sin))
    return gx, gy


def integrate(gx: Tensor, gy: Tensor) -> Tensor:
    """Images (B, 1, H, W) of zero mean whose [-1, 0, 1] differences are closest to smooth fields gx, gy (B, H, W)."""
    height, width = gx.shape[-2:]
    # the difference of two neighbours is half the mask's response, averaged over the two pixels
    fx, fy = (gx[..., :, 1:] + gx[..., :, :-1]) / 4, (gy[..., 1:, :] + gy[..., :-1, :]) / 4
    divergence = pad(fx, (0, 1)) - pad(fx, (1, 0)) + pad(fy, (0, 0, 0, 1)) - pad(fy, (0, 0, 1, 0))
    along_y, along_x = (2 * torch.cos(math.pi * torch.arange(n) / n) - 2 for n in (height, width))
    laplacian = (along_y.unsqueeze(1) + along_x).to(gx)  # its eigenvalues in the cosine basis
    laplacian[0, 0] = torch.inf
    return from_cosines(to_cosines(divergence) / laplacian).unsqueeze(1)
