"""Histograms of any dialect in the bins that a network takes."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..hog.orientation import bin_angles
from ..hog.spec import HOGSpec
from .start import of_one_colour


def cells_in_bins(
    votes: Tensor, spec: HOGSpec, size: tuple[int, int], bins: int, first: float, period: float
) -> Tensor:
    """Histograms (B, colours · spec.bins, rows, cols) of images (height, width) to (B, bins, R, C), of tiling cells.

    Each vote is shared between the two nearest bins.

    Args:
        votes, spec, size: as of :func:`.start.of_one_colour`.
        bins: of the result.
        first: the centre of bin 0, in bins.
        period: of angles that are alike, in radians: π where opposite gradients are not told apart, else 2π.
    """
    position = torch.from_numpy(bin_angles(spec)) * (bins / period) - first
    below = torch.floor(position + 1e-6)  # rounding would share a vote that lies on a centre
    share = (position - below).clamp(0, 1)
    to, own = torch.zeros(bins, spec.bins, dtype=torch.float64), torch.arange(spec.bins)
    to.index_put_((below.long() % bins, own), 1 - share, accumulate=True)
    to.index_put_(((below.long() + 1) % bins, own), share, accumulate=True)
    return torch.einsum("kb,nbrc->nkrc", to.to(votes), of_one_colour(votes, spec, size))


UNSIGNED_BINS, SIGNED_BINS = 9, 18  # both 20° wide


def unsigned_cells(votes: Tensor, spec: HOGSpec, size: tuple[int, int]) -> Tensor:
    """Those of an unsigned dialect in nine bins, centred at 10°, 30°, …"""
    return cells_in_bins(votes, spec, size, UNSIGNED_BINS, 0.5, math.pi)


def signed_cells(votes: Tensor, spec: HOGSpec, size: tuple[int, int]) -> Tensor:
    """Those of a signed dialect in eighteen bins, centred at 0°, 20°, …"""
    return cells_in_bins(votes, spec, size, SIGNED_BINS, 0.0, 2 * math.pi)
