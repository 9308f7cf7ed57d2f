"""Eq. 7 and the block schemes: from cell histograms to the descriptor."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from .spec import FourBlockNorm, GlobalNorm, HOGSpec

TEXTURE_SCALE = 1 / math.sqrt(18)  # DPM's 0.2357, made for 18 directions; VLFeat keeps it for any number


def global_norm(histograms: Tensor, scheme: GlobalNorm) -> Tensor:
    """Eq. 7: v / √(‖v‖ + ε), or v / √(‖v‖² + ε²), with v all cells and bins of one image."""
    energy = histograms.square().sum(dim=(1, 2, 3), keepdim=True)
    if scheme.form == "robust":
        return histograms * torch.rsqrt(energy + scheme.epsilon**2)
    zero = energy == 0  # the derivative of v·‖v‖ vanishes there, so ‖v‖ may be taken as constant
    norm = torch.where(zero, 0.0, torch.sqrt(torch.where(zero, 1.0, energy)))
    return histograms * torch.rsqrt(norm + scheme.epsilon)


def _repeat_edge(x: Tensor, dim: int) -> Tensor:
    return torch.cat([x.narrow(dim, 0, 1), x, x.narrow(dim, -1, 1)], dim)


def four_block_norm(histograms: Tensor, scheme: FourBlockNorm) -> Tensor:
    """UoCTTI (VLFeat ``vl/hog.c``): directed histograms (B, 2n, rows, cols) to (B, channels, rows, cols)."""
    n = histograms.shape[1] // 2
    undirected = histograms[:, :n] + histograms[:, n:]
    energy = _repeat_edge(_repeat_edge(undirected.square().sum(dim=1, keepdim=True), -2), -1)
    energy = energy[..., :-1] + energy[..., 1:]
    energy = energy[..., :-1, :] + energy[..., 1:, :]  # of the block around each cell corner: (B, 1, rows+1, cols+1)
    factor = torch.rsqrt(energy + scheme.epsilon)
    top, bottom = factor[..., :-1, :], factor[..., 1:, :]
    # (B, 4, 1, rows, cols): the blocks up-left, up-right, down-left, down-right of each cell
    blocks = torch.stack([top[..., :-1], top[..., 1:], bottom[..., :-1], bottom[..., 1:]], dim=1)

    def clipped(entries: Tensor) -> Tensor:
        # minimum, unlike clamp, has the mean of its one-sided derivatives where both are equal
        return torch.minimum(entries.unsqueeze(1) * blocks, entries.new_tensor(scheme.clip))

    found = []
    if "directed" in scheme.parts:
        found.append(clipped(histograms).sum(dim=1) / 2)
    if "undirected" in scheme.parts:
        found.append(clipped(undirected).sum(dim=1) / 2)
    if "texture" in scheme.parts:
        found.append(clipped(undirected).sum(dim=2) * TEXTURE_SCALE)
    return torch.cat(found, dim=1)


def normalize(histograms: Tensor, spec: HOGSpec) -> Tensor:
    """The spec's normaliser: cell histograms (B, bins, rows, cols) to (B, ``spec.channels``, rows, cols)."""
    if isinstance(spec.normalizer, GlobalNorm):
        return global_norm(histograms, spec.normalizer)
    return four_block_norm(histograms, spec.normalizer)
