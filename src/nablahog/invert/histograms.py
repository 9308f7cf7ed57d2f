"""The start of a search, from the descriptor alone: cell histograms, and the smooth image that they integrate to.

Normalisation seems to destroy the contrast of each cell.  But a descriptor holds each histogram divided by the energies
of several neighbourhoods, and these overlap.  So the histograms before Eq. 7 can be recovered, up to one factor for the
whole image.

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

from ..hog.descriptor import histograms, normalize
from ..hog.entries import CellAlignment, cell_entries, mean_over_colours, of_nearest_cells
from ..hog.orientation import bin_angles
from ..hog.spec import HOGSpec
from ..hog.steps import split_colours
from ..hog.taps import pooling_axes
from ..optimize import lbfgs
from .block_levels import histograms_without_clip
from .reconstruction import squared_norm
from .signs import expected_cells
from .unknowns import CosineBasis, from_cosines, to_cosines

NOMINAL_CONTRAST = 0.05  # mean gradient magnitude of a photograph in 0…1, where the descriptor leaves it open
AFTER_CLOSED_FORM = 60  # evaluations, which suffice after a start in closed form
_MAX_VOTE_RATIO = 20.0  # times the largest vote of a cell at the start, the most that the search may come to
ENTRY_FLOOR = 1e-3  # added to entries, relative to the largest, so that the logarithm of 0 is finite


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
        histograms = _least_squares(colours, spec.single_colour, size, max_evaluations)
    histograms = histograms.reshape(len(descriptor), -1, *histograms.shape[2:]).clamp(min=0)  # as votes are
    return histograms if spec.normalizer.fixes_contrast else set_nominal_contrast(histograms, spec, size)


def normalization_error(descriptor: Tensor, spec: HOGSpec, size: tuple[int, int]) -> Tensor:
    """‖N(h) - d‖ / ‖d‖ with N the dialect's normaliser, (B,): near 0 where some histograms h have the descriptor d."""
    spec = linear_vote_spec(spec)
    residual = normalize(recover_histograms(descriptor, spec, size), spec) - descriptor.permute(0, 3, 1, 2)
    return (squared_norm(residual) / squared_norm(descriptor)).sqrt()


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


def _least_squares(descriptor: Tensor, spec: HOGSpec, size: tuple[int, int], max_evaluations: int) -> Tensor:
    """Least squares for the logarithms of the histograms, which span four decades in one photograph.

    Neighbourhoods couple the levels of cells step by step.  So the logarithm of each cell's level has unknowns of its
    own, in a cosine basis, beside those of the entries: distant levels then converge together.  Copies of the same cell
    share their unknowns.  The search begins at :mod:`.block_levels` and is soon at its end, or else at the entries.
    """
    target = descriptor.permute(0, 3, 1, 2)
    batch = len(target)
    alignment = CellAlignment(spec, size, target)
    shares = of_nearest_cells(cell_entries(descriptor, spec), spec, size).clamp(min=0)
    shares = alignment(shares)
    rows, cols = shares.shape[2:]
    tiny = torch.finfo(target.dtype).tiny
    unclipped = histograms_without_clip(descriptor, spec)
    if unclipped is not None:
        max_evaluations = min(max_evaluations, AFTER_CLOSED_FORM)
        start = torch.log(alignment(of_nearest_cells(unclipped, spec, size)).clamp(min=tiny))
    else:
        start = torch.log(shares / shares.amax(dim=(1, 2, 3), keepdim=True).clamp(min=tiny) + ENTRY_FLOOR)
    start += math.log(spec.value_range * NOMINAL_CONTRAST * spec.cell_size[0] * spec.cell_size[1])
    limit = start.amax(dim=(1, 2, 3), keepdim=True) + math.log(_MAX_VOTE_RATIO)  # else clipped cells run away
    scale = squared_norm(target)
    levels = CosineBasis(rows, cols, target, exponent=0.5)

    def histograms(unknowns: Tensor, index: Tensor) -> Tensor:
        level, entries = unknowns[:, : rows * cols], unknowns[:, rows * cols :].reshape(-1, spec.bins, rows, cols)
        cells = limit[index].exp() * torch.sigmoid(levels.image(level) + entries - limit[index])
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


START_NOISE = 0.01  # standard deviation, in 0…1; without any, the two sides of a thin line would stay equal
ROUNDING_CONTRAST = 1e-5  # in 0…1, far below a step of 8 bits and above the rounding of an enlargement
TINY_WEIGHT = 1e-30


def starting_images(
    histograms: Tensor, spec: HOGSpec, height: int, width: int, count: int, seed: int, spread: float = START_NOISE
) -> Tensor:
    """Images (B, count, 1, H, W) around 0.5 from histograms (B, colours · bins, rows, cols).

    The noise has the standard deviation ``spread``, comes in pairs, and is the same for every image of the batch.
    """
    if spec.signed:
        smooth = integrate(*mean_gradient(mean_over_colours(histograms, spec), spec, height, width)).unsqueeze(1)
    else:
        cells = expected_cells(average_colours(histograms, spec, (height, width)), spec, seed).unsqueeze(1)
        # from votes of a cell, differences of two pixels, to the difference of two cells
        per_step = math.sqrt(spec.cell_size[0] * spec.cell_size[1])
        smooth = enlarge(cells / per_step, height, width).unsqueeze(2)
    return 0.5 + smooth / spec.value_range + pair_noise(histograms, height, width, count, seed, spread)


def noise(like: Tensor, height: int, width: int, count: int, seed: int, spread: float = START_NOISE) -> Tensor:
    """(1, count, 1, H, W), of zero mean and the standard deviation ``spread``."""
    generator = torch.Generator().manual_seed(int(seed))
    unit = torch.randn((1, count, 1, height, width), generator=generator, dtype=torch.float64)
    return (unit * spread).to(like)


def pair_noise(like: Tensor, height: int, width: int, count: int, seed: int, spread: float) -> Tensor:
    """:func:`noise` in pairs of opposite sign: what depends linearly on the noise cancels in their mean."""
    half = noise(like, height, width, (count + 1) // 2, seed, spread)
    return torch.cat([half, -half[:, : count // 2]], dim=1)


def match_contrast(image: Tensor, target: Tensor, spec: HOGSpec) -> Tensor:
    """Images (B, 1, H, W) around 0.5, at the contrast for which their histograms come nearest to ``target``.

    Images that only vary by rounding become constant.
    """
    image = image - image.mean(dim=(2, 3), keepdim=True)
    varies = image.abs().amax(dim=(1, 2, 3), keepdim=True) > ROUNDING_CONTRAST
    image = torch.where(varies, image, 0)
    cells = histograms(image, spec)
    size = cells.square().sum(dim=(1, 2, 3))
    contrast = torch.where(size > 0, (cells * target).sum(dim=(1, 2, 3)) / torch.where(size > 0, size, 1), 1)
    return 0.5 + image * contrast.reshape(-1, 1, 1, 1)


def start_near(
    histograms: Tensor, spec: HOGSpec, start: Tensor | None, expected: Tensor, seed: int
) -> tuple[Tensor, Tensor]:
    """Start and expected image at the contrast of the ``histograms``."""
    expected = match_contrast(expected, histograms, spec)
    start = expected if start is None else match_contrast(start, histograms, spec)
    constant = (start == start[..., :1, :1]).flatten(1).all(dim=1)
    if constant.any():  # all derivatives vanish there, so no search would leave it
        height, width = start.shape[2:]
        grainy = start + noise(histograms, height, width, 1, seed)[:, 0]
        start = torch.where(constant.reshape(-1, 1, 1, 1), grainy, start)
    return start, expected


def enlarge(images: Tensor, height: int, width: int) -> Tensor:
    """Images (B, K, h, w) to (B, K, H, W), bicubic; as they are if that is their size."""
    if images.shape[2:] == (height, width):
        return images
    return interpolate(images, size=(height, width), mode="bicubic", align_corners=False)


def mean_gradient(histograms: Tensor, spec: HOGSpec, height: int, width: int) -> tuple[Tensor, Tensor]:
    """Smooth fields Gx, Gy, each (B, H, W) in units of Eq. 2, from a signed spec's histograms (B, bins, rows, cols)."""
    angles = torch.from_numpy(bin_angles(spec)).to(histograms)
    down, across = pooling_axes(replace(spec, border="reflect"), height, width, histograms)
    # votes divided by the sum of the cell's weights are their mean; the same weights interpolate between the centres
    mean = histograms / (down.totals().unsqueeze(1) * across.totals())
    if not spec.pooling.interpolates:  # then the weights of a pixel do not sum to 1 yet
        down, across = (
            along.map(lambda weights: weights / weights.sum(dim=0).clamp(min=TINY_WEIGHT)) for along in (down, across)
        )
    gx, gy = (
        across.spread(down.spread(torch.einsum("bkrc,k->brc", mean, f(angles)), -2), -1) for f in (torch.cos, torch.sin)
    )
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
