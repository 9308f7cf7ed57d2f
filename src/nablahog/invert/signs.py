"""Region signs and polarity: which side of each edge is the brighter one, where the descriptor is unsigned.

An unsigned histogram tells the strength and orientation of a cell's edges, but not the sign of their gradients.  The
signs must form a gradient field, though, one that integrates to an image: they agree along a contour and sum to zero
around a closed path.  With one sign s per cell this is a quadratic problem,

    min over images u and signs s ∈ {-1, 1}:
        Σ_cells τ (∂u/∂n - s a)² + (∂u/∂t)²   +   μ Σ_neighbours (u_p - u_q)²   +   κ Σ_border w_p (u_p - ū)²,

with n the cell's dominant gradient direction, t the direction along its edge, and a the resultant of its votes.  The
last sum is the only assumption about photographs: the flat parts of their border are one background, of one brightness
ū.  For given signs the best u is linear in s, which leaves sᵀQs: a maximum-cut problem.  It is relaxed to unit vectors
instead of signs (Goemans & Williamson 1995) of low dimension (Burer & Monteiro 2003), solved by the generalised power
method, rounded by random hyperplanes, and improved by single flips.

One sign remains unknown for the whole image, its polarity, and one for every region that no edge connects to others.
An unsigned descriptor is the same for an image and its negative, but light is not symmetric:

* a sensor saturates in bright areas: what is exactly flat is usually white, be it sky or paper;
* shading multiplies reflectance: contrasts are stronger in bright areas;
* small highlights stand out more than small shadows.

None is certain.  Each cue is a number that changes its sign with the image; their weighted sum decides.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d, interpolate, normalize, pad

from ..hog.orientation import bin_angles, magnitude
from ..hog.spec import HOGSpec

COUPLING = 0.1  # μ: the mask [-1, 0, 1] splits the grid into four; this term couples them
TRUST = 0.1  # τ of cells of several pixels: their gradients may cancel, so that a is only an upper bound
BACKGROUND = 0.5  # κ of cells of several pixels; cells of one pixel do not need it
FAINT = 0.3  # of the mean cell's votes: cells below it count as flat
DIMENSION = 12  # of the relaxed signs
POWER_ITERATIONS = 300  # of the power method
ROUNDINGS = 32  # random hyperplanes
MAX_CELLS = 1024  # Q is dense; a larger grid is solved at half its resolution

PATCH_PIXELS = 8  # pixels; an image smaller than that is one patch
# mean gradient magnitudes of a patch, images in 0…1: upper limits of flat patches, lower limit of textured ones
EXACTLY_FLAT, FLAT, TEXTURED = 0.002, 0.006, 0.04
INVISIBLE_STD = 1e-4  # standard deviation of detail, in 0…1, below which there is none
LEAST_SHARE = 0.02  # of the patches: with fewer flat ones the cue is 0
WEIGHTS = (3.0, 2.0, 0.8, 0.5)  # of the cues, chosen on exact photographs


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
    weights = (at_border * torch.exp(-total / (FAINT * torch.where(mean > 0, mean, 1)))).flatten(1)
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


def brightness_cues(image: Tensor) -> Tensor:
    """Images (B, 1, H, W) in 0…1 to cues (B, 4), positive for a photograph.

    Whether exactly flat patches are bright, whether flat patches are, whether strong texture is, and highlights.
    """
    height, width = image.shape[-2:]
    dx = pad(image[..., :, 2:] - image[..., :, :-2], (1, 1)) if width > 2 else torch.zeros_like(image)
    dy = pad(image[..., 2:, :] - image[..., :-2, :], (0, 0, 1, 1)) if height > 2 else torch.zeros_like(image)
    size = min(PATCH_PIXELS, height, width)
    strength, brightness = avg_pool2d(magnitude(dx, dy), size), avg_pool2d(image, size)
    textured = (strength > TEXTURED).to(image)
    cues = (
        _flat_is_bright(strength < EXACTLY_FLAT, brightness),
        _flat_is_bright(strength < FLAT, brightness),
        _correlation(brightness, torch.log(strength + 1e-3), textured),
        _highlights(image),
    )
    return torch.stack(cues, dim=1)


def find_negatives(image: Tensor, confidence: Tensor | None = None) -> tuple[Tensor, Tensor | None]:
    """Which images (B, 1, H, W) in 0…1 are probably negatives, (B,), and the confidence (B,) after negating these.

    A learned prior's ``confidence`` decides, the probability that an image is not a negative; without one, the cues do.
    """
    if confidence is None:
        weights = torch.tensor(WEIGHTS, dtype=image.dtype, device=image.device)
        return brightness_cues(image) @ weights < 0, None
    return confidence < 0.5, torch.maximum(confidence, 1 - confidence)


def negate(image: Tensor, which: Tensor) -> Tensor:
    """Images (B, 1, H, W) in 0…1, with those in the mask ``which`` (B,) replaced by their negatives."""
    return torch.where(which.reshape(-1, 1, 1, 1), 1 - image, image)


def _flat_is_bright(flat: Tensor, brightness: Tensor) -> Tensor:
    """Correlation (B,) over patches of flatness with brightness; 0 if hardly any patch is flat."""
    mask = flat.to(brightness)
    correlation = _correlation(brightness, mask, torch.ones_like(mask))
    return torch.where(mask.mean(dim=(1, 2, 3)) > LEAST_SHARE, correlation, 0)


def _highlights(image: Tensor) -> Tensor:
    """Skewness (B,) of the image minus its mean over 5x5 pixels."""
    window = min(5, 2 * ((min(image.shape[-2:]) - 1) // 2) + 1)
    if window == 1:
        return image.new_zeros(len(image))
    blurred = avg_pool2d(pad(image, (window // 2,) * 4, mode="reflect"), window, stride=1)
    detail = image - blurred
    energy = detail.square().mean(dim=(1, 2, 3))
    visible = energy > INVISIBLE_STD**2
    return torch.where(visible, detail.pow(3).mean(dim=(1, 2, 3)) / torch.where(visible, energy, 1).pow(1.5), 0)


def _correlation(a: Tensor, b: Tensor, weight: Tensor) -> Tensor:
    """Weighted Pearson correlation (B,); 0 where it is not defined."""
    total = weight.sum(dim=(1, 2, 3), keepdim=True)
    total = torch.where(total > 0, total, 1)
    a, b = (x - (weight * x).sum(dim=(1, 2, 3), keepdim=True) / total for x in (a, b))
    product, aa, bb = ((weight * x).sum(dim=(1, 2, 3)) for x in (a * b, a * a, b * b))
    size = (aa * bb).sqrt()
    return torch.where(size > 1e-12, product / torch.where(size > 1e-12, size, 1), 0)
