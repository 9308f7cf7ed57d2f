"""Cell histograms recovered from a descriptor.

Normalisation seems to destroy the contrast of each cell.  But a descriptor holds each histogram divided by the energies
of several neighbourhoods, and these overlap.  So the histograms before Eq. 7 can be recovered, up to one factor for the
whole image: by least squares.  For four-block descriptors all but the clip has a closed form, the start of the search:
a texture channel is t = c · Σ_o min(h_o / N, clip), of a cell h and one of its four blocks, with energy N².  Without
the clip it is the ratio of the cell's level Σ_o h_o to N, so the levels of the cells of one block are known relative to
each other.  Over all blocks, their logarithms solve Poisson's equation.
"""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor

from ..hog.descriptor import normalize
from ..hog.entries import CellAlignment, cell_entries, fill_from_nearest, mean_over_colours
from ..hog.normalizers.four_block import FourBlockNorm
from ..hog.normalizers.unclip import TINY_RATIO, solve_clipped, sum_over_blocks, unclip
from ..hog.orientation import bin_angles
from ..hog.spec import HOGSpec
from ..hog.steps import pooling_axes, split_colours
from ..optimize import lbfgs
from ..runtime.pytorch import by_image
from .reconstruction import squared_norm, squared_scale
from .unknowns import CosineBasis, from_cosines, to_cosines

NOMINAL_CONTRAST = 0.05  # mean gradient magnitude of a photograph in 0…1, where the descriptor leaves it open
AFTER_CLOSED_FORM = 60  # evaluations, which suffice after a start in closed form
_MAX_VOTE_RATIO = 20.0  # times the largest vote of a cell at the start, the most that the search may come to
ENTRY_FLOOR = 1e-3  # added to entries, relative to the largest, so that the logarithm of 0 is finite

BLOCK_ROUNDS = 4  # in each, ratios are found for fixed shares, then shares for fixed ratios
LEVEL_ITERATIONS, LEVEL_ACCURACY = 12, 1e-8  # of conjugate gradients; more iterations make no difference
LEAST_ENTRY = 1e-3  # lower limit of entries, relative to the largest of their cell, so that logarithms are finite


def linear_vote_spec(spec: HOGSpec) -> HOGSpec:
    """The spec that a search for images uses: nearly the same, and easier to minimise.

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
    """Cell histograms (B, colours · bins, rows, cols), in votes, whose normalisation is the descriptor.

    ``spec`` is one of :func:`linear_vote_spec`.  The common scale is the original's if the descriptor fixes the
    contrast; else the mean vote of a pixel is set to that of an ordinary photograph.
    """
    size = size or spec.image_size(*descriptor.shape[1:3])
    colours = split_colours(descriptor, spec)
    histograms = spec.normalizer.invert(colours.permute(0, 3, 1, 2))
    if histograms is None:
        histograms = _fit_histograms(colours, spec.single_colour, size, max_evaluations)
    histograms = histograms.reshape(len(descriptor), -1, *histograms.shape[2:]).clamp(min=0)  # as votes are
    return histograms if spec.normalizer.fixes_contrast else set_nominal_contrast(histograms, spec, size)


def normalization_error(descriptor: Tensor, spec: HOGSpec, size: tuple[int, int]) -> Tensor:
    """‖N(h) - d‖ / ‖d‖ with N the dialect's normaliser, (B,): near 0 where some histograms h have the descriptor d."""
    spec = linear_vote_spec(spec)
    residual = normalize(recover_histograms(descriptor, spec, size), spec) - descriptor.permute(0, 3, 1, 2)
    return (squared_norm(residual) / squared_scale(descriptor)).sqrt()


def set_nominal_contrast(histograms: Tensor, spec: HOGSpec, size: tuple[int, int]) -> Tensor:
    """Histograms (B, colours · bins, rows, cols), scaled to the mean vote of an ordinary photograph's pixel."""
    nominal = NOMINAL_CONTRAST * spec.value_range * _votes_per_magnitude(spec, size, histograms)
    total = histograms.sum(dim=(1, 2, 3), keepdim=True)
    return histograms * torch.where(total > 0, nominal / total, 1)


def _votes_per_magnitude(spec: HOGSpec, size: tuple[int, int], like: Tensor) -> float:
    """The sum of all histograms of an image whose pixels all have a gradient of 1."""
    if spec.pooling.interpolates:  # as if no vote were lost at the border
        return math.prod(spec.cells(*size)) * math.prod(spec.cell_size)
    rows, cols = (
        sum(float(piece.weights.sum()) for piece in along.pieces) for along in pooling_axes(spec, *size, like)
    )
    return spec.colours * rows * cols


def _fit_histograms(descriptor: Tensor, spec: HOGSpec, size: tuple[int, int], max_evaluations: int) -> Tensor:
    """Least squares for the logarithms of the histograms, which span four decades in one photograph.

    Neighbourhoods couple the levels of cells step by step.  So the logarithm of each cell's level has unknowns of its
    own, in a cosine basis, beside those of the entries: distant levels then converge together.  Copies of the same cell
    share their unknowns.  The search begins at :func:`histograms_without_clip` and is soon at its end, or else at the
    entries.
    """
    target = descriptor.permute(0, 3, 1, 2)
    batch = len(target)
    alignment = CellAlignment(spec, size, target)
    shares = fill_from_nearest(cell_entries(descriptor, spec), spec, size).clamp(min=0)
    shares = alignment(shares)
    rows, cols = shares.shape[2:]
    tiny = torch.finfo(target.dtype).tiny
    unclipped = histograms_without_clip(descriptor, spec)
    if unclipped is not None:
        max_evaluations = min(max_evaluations, AFTER_CLOSED_FORM)
        start = torch.log(alignment(fill_from_nearest(unclipped, spec, size)).clamp(min=tiny))
    else:
        start = torch.log(shares / shares.amax(dim=(1, 2, 3), keepdim=True).clamp(min=tiny) + ENTRY_FLOOR)
    start += math.log(spec.value_range * NOMINAL_CONTRAST * spec.cell_size[0] * spec.cell_size[1])
    limit = start.amax(dim=(1, 2, 3), keepdim=True) + math.log(_MAX_VOTE_RATIO)  # else clipped cells run away
    scale = squared_scale(target)
    levels = CosineBasis(rows, cols, target, exponent=0.5)

    def histograms(unknowns: Tensor, index: Tensor) -> Tensor:
        level, entries = unknowns[:, : rows * cols], unknowns[:, rows * cols :].reshape(-1, spec.bins, rows, cols)
        cells = limit[index].exp() * by_image(torch.sigmoid, levels.image(level) + entries - limit[index])
        return alignment.restore(torch.where(shares[index] > 0, cells, 0))

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


def histograms_without_clip(descriptor: Tensor, spec: HOGSpec) -> Tensor | None:
    """Histograms (B, bins, rows, cols) of descriptors (B, rows, cols, channels), of mean level 1.

    None for a descriptor that does not tell blocks apart: one without texture, or without the histograms that it sums.
    """
    normalizer = spec.normalizer
    if not isinstance(normalizer, FourBlockNorm):
        return None
    parts = normalizer.split(descriptor.permute(0, 3, 1, 2), spec.bins, spec.signed)
    vlfeat = normalizer.texture == "vlfeat"
    summed = parts.get("undirected" if vlfeat else "directed")
    if summed is None or "texture" not in parts:
        return None
    totals = normalizer.texture_sums(parts["texture"])
    shares, ratios, known = unclip(summed, totals, normalizer.clip, BLOCK_ROUNDS)
    if "directed" in parts and vlfeat:
        shares, _ = solve_clipped(ratios, 2 * parts["directed"].unsqueeze(1), normalizer.clip, dim=1)
    known &= totals.unsqueeze(2) > TINY_RATIO
    levels = _solve_levels(ratios.double().clamp(min=TINY_RATIO).log().squeeze(2), known.squeeze(2).double())
    shares = shares.squeeze(1)
    floor = LEAST_ENTRY * shares.amax(dim=1, keepdim=True)
    return shares.clamp(min=floor) * torch.exp(levels).to(shares)


def _solve_levels(ratios: Tensor, known: Tensor) -> Tensor:
    """Logarithms of levels (B, 1, rows, cols), of mean 0, from those of ratios (B, 4, rows, cols) to blocks.

    Least squares, where ``known`` is 1, over the levels of cells and of blocks.  Those of blocks are means, which
    leaves equations for those of cells; if all ratios are known, the cosine basis solves them.
    """
    blocks = sum_over_blocks(known).clamp(min=TINY_RATIO)

    def subtract_block_means(cell_ratios: Tensor) -> Tensor:
        """Σ over its blocks of a cell's difference from the mean of the block: (B, 4, rows, cols) to (B, 1, …)."""
        means = _from_blocks(sum_over_blocks(known * cell_ratios) / blocks)
        return (known * (cell_ratios - means)).sum(dim=1, keepdim=True)

    rows, cols = (torch.cos(math.pi * torch.arange(n, dtype=torch.float64) / (2 * n)) ** 2 for n in ratios.shape[2:])
    spectrum = 4 * (1 - torch.outer(rows, cols))
    spectrum[0, 0] = math.inf
    spectrum = spectrum.to(ratios)
    levels, residual = torch.zeros_like(ratios[:, :1]), subtract_block_means(ratios)
    direction = solved = from_cosines(to_cosines(residual) / spectrum)
    first = error = (residual * solved).sum(dim=(1, 2, 3), keepdim=True)
    for _ in range(LEVEL_ITERATIONS):  # preconditioned conjugate gradients
        runs, image = error > LEVEL_ACCURACY * first, subtract_block_means(direction.expand_as(ratios))
        curvature = (direction * image).sum(dim=(1, 2, 3), keepdim=True)
        step = torch.where(runs, error / curvature, 0)
        levels, residual = levels + step * direction, residual - step * image
        solved, before = from_cosines(to_cosines(residual) / spectrum), error
        error = (residual * solved).sum(dim=(1, 2, 3), keepdim=True)
        direction = solved + torch.where(runs, error / before, 0) * direction
    return levels - levels.mean(dim=(2, 3), keepdim=True)


def _from_blocks(blocks: Tensor) -> Tensor:
    """The four blocks of each cell: (B, 1, rows + 1, cols + 1) to (B, 4, rows, cols)."""
    top, bottom = blocks[:, :, :-1], blocks[:, :, 1:]
    return torch.cat([top[..., :-1], top[..., 1:], bottom[..., :-1], bottom[..., 1:]], dim=1)


def average_colours(histograms: Tensor, spec: HOGSpec, size: tuple[int, int]) -> Tensor:
    """Histograms (B, colours · bins, rows, cols) of images (height, width): means over colours, cells side by side."""
    return CellAlignment(spec, size, histograms)(mean_over_colours(histograms, spec))


def rebin_cells(
    histograms: Tensor, spec: HOGSpec, size: tuple[int, int], bins: int, first: float, period: float
) -> Tensor:
    """Histograms (B, colours · spec.bins, rows, cols) to other bins of cells side by side, (B, bins, R, C).

    Each vote is shared between the two nearest bins; ``first`` is the centre of bin 0, in bins, and ``period`` that of
    the angles, π or 2π.
    """
    position = torch.from_numpy(bin_angles(spec)) * (bins / period) - first
    below = torch.floor(position + 1e-6)  # a vote at a bin's centre is not split
    share = (position - below).clamp(0, 1)
    shares, spec_bins = torch.zeros(bins, spec.bins, dtype=torch.float64), torch.arange(spec.bins)
    shares.index_put_((below.long() % bins, spec_bins), 1 - share, accumulate=True)
    shares.index_put_(((below.long() + 1) % bins, spec_bins), share, accumulate=True)
    return torch.einsum("kb,nbrc->nkrc", shares.to(histograms), average_colours(histograms, spec, size))
