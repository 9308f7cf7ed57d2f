"""The start of a search: the smooth image that cell histograms integrate to.

A signed histogram holds the mean gradient of its cell, Σ_b h_b · direction of b: the gradient field at low resolution.
Interpolated between cells and integrated (Poisson's equation, solved in the cosine basis), it is already a blurred
version of the image.  A descent from noise alone would have to build that from randomly oriented pixels, and would keep
some of their randomness.

An unsigned histogram has no such mean: it tells the strength and orientation of a cell's edges, but not the sign of
their gradients.  The signs must form a gradient field, though, one that integrates to an image: they agree along a
contour and sum to zero around a closed path.  With one sign s per cell this is a quadratic problem,

    min over images u and signs s ∈ {-1, 1}:
        Σ_cells τ (∂u/∂n - s a)² + (∂u/∂t)²   +   μ Σ_neighbours (u_p - u_q)²   +   κ Σ_border w_p (u_p - ū)²,

with n the cell's dominant gradient direction, t the direction along its edge, and a the resultant of its votes.  The
last sum is the only assumption about photographs: the flat parts of their border are one background, of one brightness
ū.  For given signs the best u is linear in s, which leaves sᵀQs: a maximum-cut problem.  It is relaxed to unit vectors
instead of signs (Goemans & Williamson 1995) of low dimension (Burer & Monteiro 2003), solved by the generalised power
method, rounded by random hyperplanes, and improved by single flips.

One sign for every region that no edge connects to others remains unknown, and one for the whole image: its polarity
(:mod:`.polarity`).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d, interpolate, normalize, pad

from ..hog.descriptor import histograms
from ..hog.entries import mean_over_colours
from ..hog.orientation import bin_angles
from ..hog.spec import HOGSpec
from ..hog.steps import pooling_axes
from ..runtime.pytorch import by_image
from .histograms import average_colours
from .unknowns import from_cosines, to_cosines

START_NOISE = 0.01  # standard deviation, in 0…1; without any, the two sides of a thin line would stay equal
ROUNDING_CONTRAST = 1e-5  # in 0…1, far below a step of 8 bits and above the rounding of an enlargement
TINY_WEIGHT = 1e-30

COUPLING = 0.1  # μ: the mask [-1, 0, 1] splits the grid into four; this term couples them
TRUST = 0.1  # τ of cells of several pixels: their gradients may cancel, so that a is only an upper bound
BACKGROUND = 0.5  # κ of cells of several pixels; cells of one pixel do not need it
FAINT_SHARE = 0.3  # of the mean cell's votes: cells below it count as flat
DIMENSION = 12  # of the relaxed signs
POWER_ITERATIONS = 300  # of the power method
ROUNDINGS = 32  # random hyperplanes
MAX_CELLS = 1024  # Q is dense; a larger grid is solved at half its resolution


def starting_images(
    histograms: Tensor, spec: HOGSpec, height: int, width: int, count: int, seed: int, spread: float = START_NOISE
) -> Tensor:
    """Images (B, count, 1, H, W) around 0.5 from histograms (B, colours · bins, rows, cols).

    The noise has the standard deviation ``spread``, comes in pairs, and is the same for every image of the batch.
    """
    smooth = by_image(lambda cells: _smooth_images(cells, spec, height, width, seed), histograms)
    return 0.5 + smooth / spec.value_range + pair_noise(histograms, height, width, count, seed, spread)


def _smooth_images(histograms: Tensor, spec: HOGSpec, height: int, width: int, seed: int) -> Tensor:
    """The images (B, 1, 1, H, W) that histograms (B, colours · bins, rows, cols) integrate to, of zero mean."""
    if spec.signed:
        return integrate(*mean_gradient(mean_over_colours(histograms, spec), spec, height, width)).unsqueeze(1)
    cells = expected_cells(average_colours(histograms, spec, (height, width)), spec, seed).unsqueeze(1)
    # from votes of a cell, differences of two pixels, to the difference of two cells
    per_step = math.sqrt(spec.cell_size[0] * spec.cell_size[1])
    return enlarge(cells / per_step, height, width).unsqueeze(2)


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
    along_y, along_x = (2 * torch.cos(math.pi * torch.arange(n, dtype=torch.float32) / n) - 2 for n in (height, width))
    laplacian = (along_y.unsqueeze(1) + along_x).to(gx)  # its eigenvalues in the cosine basis
    laplacian[0, 0] = torch.inf
    return from_cosines(to_cosines(divergence) / laplacian).unsqueeze(1)


class SignedCells(NamedTuple):
    """Images of one gray value a cell, in the units of the votes, for :data:`ROUNDINGS` choices K of signs.

    In order of energy, each of zero mean, and with the sign with which it correlates positively with the first.
    """

    images: Tensor  # (B, K, rows, cols)
    energy: Tensor  # (B, K), sᵀQs


def signed_cells(histograms: Tensor, spec: HOGSpec, seed: int) -> SignedCells:
    """Sign patterns of low energy for unsigned histograms (B, bins, rows, cols), as images of cells."""
    rows, cols = histograms.shape[2:]
    if rows * cols > MAX_CELLS:
        halves = [2 if n > 1 else 1 for n in (rows, cols)]
        even = pad(histograms, (0, -cols % halves[1], 0, -rows % halves[0]))
        coarse = signed_cells(avg_pool2d(even, halves), spec, seed)
        images = interpolate(2 * coarse.images, size=even.shape[2:], mode="bilinear", align_corners=False)
        images = images[..., :rows, :cols]
        return SignedCells(images - images.mean(dim=(2, 3), keepdim=True), coarse.energy)
    trust, background = (1.0, 0.0) if spec.cell_size == (1, 1) else (TRUST, BACKGROUND)
    response, energy = _sign_problem(histograms.double(), spec, trust, background)
    signs, energies = _round(energy, _relax(energy, seed), seed)
    images = torch.einsum("bij,bkj->bki", response, signs).view(-1, ROUNDINGS, rows, cols)
    images = images - images.mean(dim=(2, 3), keepdim=True)
    agreement = torch.sign((images * images[:, :1]).sum(dim=(2, 3), keepdim=True))
    images = torch.where(agreement < 0, -images, images)
    return SignedCells(images.to(histograms), energies.to(histograms))


def expected_cells(histograms: Tensor, spec: HOGSpec, seed: int) -> Tensor:
    """Unsigned histograms (B, bins, rows, cols) to an image of cells (B, rows, cols), in the units of the votes.

    For cells of one pixel it is the sign pattern of least energy, for larger ones, where many have nearly the least,
    their mean.
    """
    images = signed_cells(histograms, spec, seed).images
    return images[:, 0] if spec.cell_size == (1, 1) else images.mean(dim=1)


def dominant_gradient(histograms: Tensor, spec: HOGSpec) -> tuple[Tensor, Tensor]:
    """Length and angle, each (B, rows, cols), of the votes' resultant, with opposite directions taken as the same."""
    doubled = 2 * torch.from_numpy(bin_angles(spec)).to(histograms)
    x, y = (torch.einsum("bkrc,k->brc", histograms, f(doubled)) for f in (torch.cos, torch.sin))
    return torch.hypot(x, y), torch.atan2(y, x) / 2


def _differences(n: int, like: Tensor) -> tuple[Tensor, Tensor]:
    """The mask [-1, 0, 1], 0 at both ends, and the differences of neighbours, as matrices (n, n) and (n - 1, n)."""
    steps = torch.diff(torch.eye(n, dtype=like.dtype, device=like.device), dim=0)
    central = torch.zeros(n, n, dtype=like.dtype, device=like.device)
    central[1:-1] = steps[1:] + steps[:-1]
    return central, steps


def _sign_problem(histograms: Tensor, spec: HOGSpec, trust: float, background: float) -> tuple[Tensor, Tensor]:
    """Two matrices (B, n, n) for n cells: the one that maps signs to their best image, and Q."""
    rows, cols = histograms.shape[2:]
    eye_r, eye_c = (torch.eye(n, dtype=histograms.dtype, device=histograms.device) for n in (rows, cols))
    (central_y, steps_y), (central_x, steps_x) = _differences(rows, histograms), _differences(cols, histograms)
    # in cells that are not square, a step along the longer side spans more pixels of the same gradient
    height, width = spec.cell_size
    across_x, across_y = (height / width) ** 0.5, (width / height) ** 0.5
    dx, dy = across_x * torch.kron(eye_r, central_x), across_y * torch.kron(central_y, eye_c)
    neighbours = torch.cat([torch.kron(eye_r, steps_x), torch.kron(steps_y, eye_c)])

    strength, angle = (field.flatten(1).unsqueeze(2) for field in dominant_gradient(histograms, spec))
    unit = strength.square().mean(dim=1, keepdim=True).sqrt()
    strength = strength / torch.where(unit > 0, unit, 1)
    across = torch.cos(angle) * dx + torch.sin(angle) * dy
    along = torch.cos(angle) * dy - torch.sin(angle) * dx
    fixed = COUPLING * neighbours.T @ neighbours + 1e-3 / (rows * cols)  # the last term makes the mean 0
    system = trust * across.mT @ across + along.mT @ along + fixed + background * _background(histograms)
    pull = trust * across.mT * strength.mT
    # positive definite.  A general solver fails on batches of large systems in some builds, with two threads.
    response = torch.cholesky_solve(pull, torch.linalg.cholesky(system))
    energy = trust * torch.diag_embed(strength.squeeze(2).square()) - pull.mT @ response
    return response * unit, (energy + energy.mT) / 2


def _background(histograms: Tensor) -> Tensor:
    """The last sum's matrix (B, n, n): w_p is exp(-votes / faint votes) along the border, 0 elsewhere; w weights ū."""
    at_border = torch.zeros(histograms.shape[2:], dtype=histograms.dtype, device=histograms.device)
    at_border[[0, -1]] = at_border[:, [0, -1]] = 1
    total = histograms.sum(dim=1)
    mean = total.mean(dim=(1, 2), keepdim=True)
    weights = (at_border * torch.exp(-total / (FAINT_SHARE * torch.where(mean > 0, mean, 1)))).flatten(1)
    share = weights / weights.sum(dim=1, keepdim=True).clamp(min=torch.finfo(histograms.dtype).tiny)
    return torch.diag_embed(weights) - weights.unsqueeze(2) * share.unsqueeze(1)


def _relax(energy: Tensor, seed: int) -> Tensor:
    """Q (B, n, n) to unit vectors (B, n, DIMENSION) of low Σ_ij Q_ij v_i·v_j."""
    generator = torch.Generator().manual_seed(int(seed))
    vectors = torch.randn(1, energy.shape[1], DIMENSION, generator=generator, dtype=torch.float64)
    vectors = normalize(vectors.to(energy).expand(len(energy), -1, -1), dim=2)
    free = energy - torch.diag_embed(torch.diagonal(energy, dim1=1, dim2=2))  # s_i² = 1 for any s
    shift = torch.linalg.matrix_norm(free, ord=2).reshape(-1, 1, 1) / 2  # half the shift that guarantees descent
    for _ in range(POWER_ITERATIONS):
        vectors = normalize(shift * vectors - free @ vectors, dim=2)
    return vectors


def _round(energy: Tensor, vectors: Tensor, seed: int) -> tuple[Tensor, Tensor]:
    """Signs (B, ROUNDINGS, n) and their energies (B, ROUNDINGS), lowest first."""
    n, dimension = vectors.shape[1:]
    generator = torch.Generator().manual_seed(int(seed))
    planes = torch.randn(1, dimension, ROUNDINGS, generator=generator, dtype=torch.float64).to(vectors)
    signs = torch.where((vectors @ planes).mT < 0, -1.0, 1.0).to(energy)
    free = energy - torch.diag_embed(torch.diagonal(energy, dim1=1, dim2=2))
    for _ in range(n):  # in every rounding, flip the sign that lowers the energy most, as long as one does
        gain, best = (signs * (signs @ free)).max(dim=2, keepdim=True)
        if not (gain > 1e-9).any():
            break
        flip = torch.zeros_like(signs).scatter(2, best, (gain > 1e-9).to(signs))
        signs = signs * (1 - 2 * flip)
    energies = ((signs @ energy) * signs).sum(dim=2)
    energies, order = energies.sort(dim=1, stable=True)
    return signs.gather(1, order.unsqueeze(2).expand_as(signs)), energies
