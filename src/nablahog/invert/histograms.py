"""Cell histograms from a descriptor alone, by inverting the normaliser, and in the bins of a prior's network.

Normalisation seems to destroy the contrast of each cell.  But a descriptor holds each histogram divided by the energies
of several neighbourhoods, and these overlap.  So the histograms before Eq. 7 can be recovered, up to one factor for the
whole image.
"""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor

from ..hog.descriptor import steps
from ..hog.entries import CellAlignment, cell_entries, mean_over_colours, of_nearest_cells
from ..hog.orientation import bin_angles
from ..hog.spec import HOGSpec
from ..hog.steps import pooling_matrices, split_colours
from ..optimize import lbfgs
from .cosine import CosineBasis
from .objective import squared_norm

NOMINAL_CONTRAST = 0.05  # mean gradient magnitude of a photograph in 0…1, where the descriptor leaves it open
FLOOR = 1e-3  # of the largest entry: where a sparse histogram's logarithm starts from


def searchable(spec: HOGSpec) -> HOGSpec:
    """The spec with which images are searched: nearly the same, and easier to minimise.

    * Votes are linear: hard votes have no derivative with respect to the orientation.
    * Where the dialect describes the root of an image, the root is the unknown.
    * Where the descriptor keeps only undirected sums of directed histograms, the histograms are unsigned.

    Raises:
        ValueError: the descriptor keeps directed texture without directed histograms, which cannot be inverted.
    """
    spec = spec.with_linear_votes()
    if spec.gamma == "sqrt":
        spec = replace(spec, gamma="none", value_range=math.sqrt(spec.value_range))
    if not spec.signed or spec.normalizer.keeps_directions:
        return spec
    if spec.normalizer.needs_directed:
        raise ValueError(
            f"a descriptor that is made from directed histograms can be inverted only with its directed channels, "
            f"which {spec.name} leaves out"
        )
    half = spec.bins // 2
    return replace(spec, signed=False, bins=half, bin_offset=spec.bin_offset % half)


def recover_histograms(
    descriptor: Tensor, spec: HOGSpec, size: tuple[int, int] | None = None, *, max_evaluations: int = 200
) -> Tensor:
    """Cell histograms whose normalisation is the descriptor.

    Args:
        descriptor: (B, rows, cols, channels).
        spec: its dialect, as :func:`searchable` gives it.
        size: (height, width) of the image; by default whole cells.
        max_evaluations: of a normaliser that is inverted iteratively; they cost time per cell, not per pixel.

    Returns:
        (B, colours · bins, rows, cols) of cells, in votes.  Their common scale is the original's if the spec fixes the
        contrast; else the mean vote of a pixel is set to that of an ordinary photograph.
    """
    size = size or spec.image_size(*descriptor.shape[1:3])
    each = split_colours(descriptor, spec)
    histograms = spec.normalizer.invert(each.permute(0, 3, 1, 2))
    if histograms is None:
        histograms = _least_squares(each, spec.of_one_colour(), size, max_evaluations)
    histograms = histograms.reshape(len(descriptor), -1, *histograms.shape[2:]).clamp(min=0)  # as votes are
    return histograms if spec.normalizer.fixes_contrast else at_nominal_contrast(histograms, spec, size)


def at_nominal_contrast(histograms: Tensor, spec: HOGSpec, size: tuple[int, int]) -> Tensor:
    """Histograms (B, colours · bins, rows, cols), scaled to the mean vote of an ordinary photograph's pixel."""
    nominal = NOMINAL_CONTRAST * spec.value_range * _votes_per_magnitude(spec, size, histograms)
    total = histograms.sum(dim=(1, 2, 3), keepdim=True)
    return histograms * torch.where(total > 0, nominal / total, 1)


def _votes_per_magnitude(spec: HOGSpec, size: tuple[int, int], like: Tensor) -> float:
    """The sum of all histograms of an image whose pixels all have a gradient of 1."""
    if spec.pooling.interpolates:  # as if no vote were lost at the border
        return math.prod(spec.cells(*size)) * math.prod(spec.cell_size)
    by_row, by_col = pooling_matrices(spec, *size, like)
    return spec.colours * float(by_row.sum()) * float(by_col.sum())


def _least_squares(descriptor: Tensor, spec: HOGSpec, size: tuple[int, int], max_evaluations: int) -> Tensor:
    """Least squares for the logarithms of the histograms, which span four decades in one photograph.

    Neighbourhoods couple the levels of cells step by step.  So the logarithm of each cell's level has unknowns of its
    own, in a cosine basis, beside those of the entries: distant levels then converge together.  Copies of the same cell
    share their unknowns.
    """
    target = descriptor.permute(0, 3, 1, 2)
    batch = len(target)
    alignment = CellAlignment(spec, size, target)
    shares = of_nearest_cells(cell_entries(descriptor, spec), spec, size).clamp(min=0)
    shares = alignment(shares)
    rows, cols = shares.shape[2:]
    tiny = torch.finfo(target.dtype).tiny
    start = torch.log(shares / shares.amax(dim=(1, 2, 3), keepdim=True).clamp(min=tiny) + FLOOR)
    start += math.log(spec.value_range * NOMINAL_CONTRAST * spec.cell_size[0] * spec.cell_size[1])
    scale = squared_norm(target)
    _, normalize = steps(target.device, spec)
    levels = CosineBasis(rows, cols, target, exponent=0.5)

    def histograms(unknowns: Tensor, index: Tensor) -> Tensor:
        level, entries = unknowns[:, : rows * cols], unknowns[:, rows * cols :].reshape(-1, spec.bins, rows, cols)
        return alignment.restore(torch.where(shares[index] > 0, torch.exp(levels.image(level) + entries), 0))

    @torch.enable_grad()
    def objective(unknowns: Tensor, index: Tensor) -> tuple[Tensor, Tensor]:
        unknowns = unknowns.detach().requires_grad_()
        residual = normalize(histograms(unknowns, index), spec) - target[index]
        value = squared_norm(residual) / scale[index]
        (gradient,) = torch.autograd.grad(value.sum(), unknowns)
        return value.detach(), gradient

    unknowns = torch.cat([target.new_zeros(batch, rows * cols), start.flatten(1)], dim=1)
    minimum = lbfgs(objective, unknowns, max_evaluations=max_evaluations, memory=10, progress_tolerance=1e-3)
    return histograms(minimum.x, torch.arange(batch, device=target.device))


def of_one_colour(votes: Tensor, spec: HOGSpec, size: tuple[int, int]) -> Tensor:
    """Histograms (B, colours · bins, rows, cols) of images (height, width): means over colours, cells side by side."""
    return CellAlignment(spec, size, votes)(mean_over_colours(votes, spec))


def cells_in_bins(
    votes: Tensor, spec: HOGSpec, size: tuple[int, int], bins: int, first: float, period: float
) -> Tensor:
    """Histograms (B, colours · spec.bins, rows, cols) to other bins of cells side by side, (B, bins, R, C).

    Each vote is shared between the two nearest bins.

    Args:
        votes, spec, size: as of :func:`of_one_colour`.
        bins: of the result.
        first: the centre of bin 0, in bins.
        period: of the angles, in radians: π for unsigned histograms, 2π for signed ones.
    """
    position = torch.from_numpy(bin_angles(spec)) * (bins / period) - first
    below = torch.floor(position + 1e-6)  # keeps a vote on a bin's centre whole
    share = (position - below).clamp(0, 1)
    to, own = torch.zeros(bins, spec.bins, dtype=torch.float64), torch.arange(spec.bins)
    to.index_put_((below.long() % bins, own), 1 - share, accumulate=True)
    to.index_put_(((below.long() + 1) % bins, own), share, accumulate=True)
    return torch.einsum("kb,nbrc->nkrc", to.to(votes), of_one_colour(votes, spec, size))
