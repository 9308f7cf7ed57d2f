"""The pre-image of the normaliser: cell histograms from a descriptor alone.

Normalisation looks as if it destroyed the contrast of each cell, but a descriptor holds each histogram divided by
several neighbourhoods' energies, and neighbourhoods overlap.  So the histograms before Eq. 7 can be computed back, up
to one factor for the whole image, on the cells alone, before a single pixel is guessed.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..hog.kernels import steps
from ..hog.spec import FourBlockNorm, GlobalNorm, HOGSpec
from ..optimize import lbfgs
from .objective import squared_norm
from .parameterize import CosineBasis

NOMINAL_CONTRAST = 0.05  # mean gradient magnitude of a photograph in 0…1, where the descriptor leaves it open
FLOOR = 1e-3  # of the largest entry: where a sparse histogram's logarithm starts from


def fixes_contrast(spec: HOGSpec) -> bool:
    """Whether the descriptor determines the image's contrast: Eq. 7 as printed scales with its square root."""
    return isinstance(spec.normalizer, GlobalNorm) and spec.normalizer.form == "printed"


def check_directed(spec: HOGSpec) -> None:
    """Raises ValueError if ``spec`` sums directed histograms and keeps nothing else of them, which no step undoes."""
    if isinstance(spec.normalizer, FourBlockNorm) and "directed" not in spec.normalizer.parts:
        raise ValueError(
            f"a four-block descriptor can be inverted only with its directed channels, which {spec.name} leaves out"
        )


def recover_histograms(descriptor: Tensor, spec: HOGSpec, *, max_evaluations: int = 200) -> Tensor:
    """Cell histograms whose normalisation is the descriptor.

    Args:
        descriptor: (B, rows, cols, channels).
        spec: its dialect.
        max_evaluations: of the block normaliser, which is inverted iteratively; each costs the cells, not the pixels.

    Returns:
        (B, bins, rows, cols), in votes.  Their common scale is the original's if the spec fixes the contrast, else it
        is set so that the mean vote of a pixel is that of an ordinary photograph.
    """
    target = descriptor.permute(0, 3, 1, 2)
    if isinstance(spec.normalizer, GlobalNorm):
        histograms = _undo_global(target, spec.normalizer)
    else:
        histograms = _undo_blocks(target, spec, max_evaluations)
    if fixes_contrast(spec):
        return histograms
    pixels = target.shape[-1] * target.shape[-2] * spec.cell_size[0] * spec.cell_size[1]
    nominal = NOMINAL_CONTRAST * spec.value_range * pixels
    total = histograms.sum(dim=(1, 2, 3), keepdim=True)
    return histograms * torch.where(total > 0, nominal / total, 1)


def _undo_global(target: Tensor, scheme: GlobalNorm) -> Tensor:
    """Eq. 7 solved for v: d = v / √(‖v‖ + ε) gives ‖v‖² - ‖d‖²‖v‖ - ‖d‖²ε = 0; the robust form keeps no scale."""
    if scheme.form == "robust":
        return target
    energy = target.square().sum(dim=(1, 2, 3), keepdim=True)
    norm = (energy + torch.sqrt(energy.square() + 4 * energy * scheme.epsilon)) / 2
    return target * torch.sqrt(norm + scheme.epsilon)


def _undo_blocks(target: Tensor, spec: HOGSpec, max_evaluations: int) -> Tensor:
    """Least squares for the logarithms of the directed histograms: they span four decades in one photograph.

    What neighbourhoods tell of each other's energy passes from cell to cell, so the logarithm of each cell's level
    gets a cosine basis of its own beside the entries: in it, levels far apart settle together.
    """
    batch, _, rows, cols = target.shape
    directed = target[:, : spec.bins].clamp(min=0)
    tiny = torch.finfo(target.dtype).tiny
    start = torch.log(directed / directed.amax(dim=(1, 2, 3), keepdim=True).clamp(min=tiny) + FLOOR)
    start += math.log(spec.value_range * NOMINAL_CONTRAST * spec.cell_size[0] * spec.cell_size[1])
    size = squared_norm(target)
    _, normalize = steps(target.device)
    levels = CosineBasis(rows, cols, target, exponent=0.5)

    def histograms(unknowns: Tensor, index: Tensor) -> Tensor:
        level, entries = unknowns[:, : rows * cols], unknowns[:, rows * cols :].reshape(-1, spec.bins, rows, cols)
        return torch.where(directed[index] > 0, torch.exp(levels.image(level) + entries), 0)

    @torch.enable_grad()
    def objective(unknowns: Tensor, index: Tensor) -> tuple[Tensor, Tensor]:
        unknowns = unknowns.detach().requires_grad_()
        residual = normalize(histograms(unknowns, index), spec) - target[index]
        value = squared_norm(residual) / size[index]
        (gradient,) = torch.autograd.grad(value.sum(), unknowns)
        return value.detach(), gradient

    unknowns = torch.cat([target.new_zeros(batch, rows * cols), start.flatten(1)], dim=1)
    found = lbfgs(objective, unknowns, max_evaluations=max_evaluations, memory=10, progress_tolerance=1e-3)
    return histograms(found.x, torch.arange(batch, device=target.device))
