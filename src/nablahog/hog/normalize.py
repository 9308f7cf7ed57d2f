"""Eq. 7 and the block schemes: from cell histograms to the descriptor."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from .normalizers import BlockNorm, CellNorm, FourBlockNorm, GlobalNorm
from .spec import HOGSpec

VLFEAT_TEXTURE = 1 / math.sqrt(18)  # made for 18 directions; VLFeat keeps it for any number
DPM_TEXTURE = 0.2357  # the same, to four decimals
DPM_ORDER = [3, 1, 2, 0]  # of the blocks up-left, up-right, down-left, down-right


def _root(values: Tensor) -> Tensor:
    """√ of each value, with derivative 0 at 0."""
    zero = values == 0
    return torch.where(zero, 0.0, torch.sqrt(torch.where(zero, 1.0, values)))


def _clipped(entries: Tensor, clip: float) -> Tensor:
    # minimum, unlike clamp, has the mean of its one-sided derivatives where both are equal
    return torch.minimum(entries, entries.new_tensor(clip))


def global_norm(histograms: Tensor, scheme: GlobalNorm) -> Tensor:
    """Eq. 7: v / √(‖v‖ + ε), or v / √(‖v‖² + ε²), with v all cells and bins of one image."""
    energy = histograms.square().sum(dim=(1, 2, 3), keepdim=True)
    if scheme.form == "robust":
        return histograms * torch.rsqrt(energy + scheme.epsilon**2)
    # the derivative of v·‖v‖ vanishes where v does, so ‖v‖ may be taken as constant there
    return histograms * torch.rsqrt(_root(energy) + scheme.epsilon)


def _repeat_edge(x: Tensor, dim: int) -> Tensor:
    return torch.cat([x.narrow(dim, 0, 1), x, x.narrow(dim, -1, 1)], dim)


def _block_factors(undirected: Tensor, scheme: FourBlockNorm) -> Tensor:
    """What the four blocks of each cell multiply it with: up-left, up-right, down-left, down-right, (B, 4, 1, r, c)."""
    energy = _repeat_edge(_repeat_edge(undirected.square().sum(dim=1, keepdim=True), -2), -1)
    energy = energy[..., :-1] + energy[..., 1:]
    energy = energy[..., :-1, :] + energy[..., 1:, :]  # of the block around each cell corner: (B, 1, rows+1, cols+1)
    if scheme.floor:
        factor = 1 / torch.maximum(_root(energy), energy.new_tensor(scheme.epsilon))
    else:
        factor = torch.rsqrt(energy + scheme.epsilon)
    if scheme.outside == "missing":
        inner = torch.zeros_like(factor)
        inner[..., 1:-1, 1:-1] = 1
        factor = factor * inner
    top, bottom = factor[..., :-1, :], factor[..., 1:, :]
    return torch.stack([top[..., :-1], top[..., 1:], bottom[..., :-1], bottom[..., 1:]], dim=1)


def four_block_norm(histograms: Tensor, scheme: FourBlockNorm, *, signed: bool = True) -> Tensor:
    """UoCTTI (VLFeat ``vl/hog.c``): histograms (B, 2n, rows, cols), n if not signed, to (B, channels, rows, cols)."""
    n = histograms.shape[1] // 2
    undirected = histograms[:, :n] + histograms[:, n:] if signed else histograms
    factors = _block_factors(undirected, scheme)
    if scheme.outside == "drop":
        histograms, undirected, factors = (x[..., 1:-1, 1:-1] for x in (histograms, undirected, factors))

    def blocks(entries: Tensor) -> Tensor:
        return _clipped(entries.unsqueeze(1) * factors, scheme.clip)  # (B, 4, bins, rows, cols)

    found = []
    if "directed" in scheme.parts:
        found.append(blocks(histograms).sum(dim=1) / 2)
    if "undirected" in scheme.parts:
        found.append(blocks(undirected).sum(dim=1) / 2)
    if "texture" in scheme.parts and scheme.texture == "vlfeat":
        found.append(blocks(undirected).sum(dim=2) * VLFEAT_TEXTURE)
    elif "texture" in scheme.parts:
        found.append(blocks(histograms).sum(dim=2)[:, DPM_ORDER] * DPM_TEXTURE)
    if "blocks" in scheme.parts:
        found.append(blocks(undirected).flatten(1, 2))
    if "zero" in scheme.parts:
        found.append(torch.zeros_like(histograms[:, :1]))
    return torch.cat(found, dim=1)


def block_norm(histograms: Tensor, scheme: BlockNorm) -> Tensor:
    """Rectangular blocks: histograms (B, bins, rows, cols) to (B, channels, rows of blocks, columns of blocks)."""
    (high, wide), (down, across) = scheme.block, scheme.step
    rows, cols = ((n - 1) * step + 1 for n, step in zip(scheme.grid(*histograms.shape[2:]), scheme.step, strict=True))
    # not by unfold, whose derivative torch.func.vmap does image by image
    of_cells = [
        histograms[:, :, row : row + rows : down, col : col + cols : across]
        for row in range(high)
        for col in range(wide)
    ]
    blocks = torch.stack(of_cells, dim=1).flatten(1, 2)
    if scheme.form.startswith("L1"):  # histograms are not negative
        blocks = blocks / (blocks.sum(dim=1, keepdim=True) + scheme.epsilon)
        return blocks if scheme.form == "L1" else _root(blocks)
    blocks = _unit(blocks, scheme.epsilon, scheme.epsilon_outside_root)
    if scheme.form == "L2":
        return blocks
    return _unit(_clipped(blocks, scheme.clip), scheme.epsilon_again, scheme.epsilon_outside_root)


def _unit(blocks: Tensor, epsilon: float, added: bool) -> Tensor:
    energy = blocks.square().sum(dim=1, keepdim=True)
    return blocks / (_root(energy) + epsilon) if added else blocks * torch.rsqrt(energy + epsilon**2)


def cell_norm(histograms: Tensor, scheme: CellNorm) -> Tensor:
    """Each cell for itself: (B, bins, rows, cols) to the same shape."""
    length = _root(histograms.square().sum(dim=1, keepdim=True))
    return histograms / torch.maximum(length, length.new_tensor(scheme.epsilon))


def normalize(histograms: Tensor, spec: HOGSpec) -> Tensor:
    """The spec's normaliser: cell histograms (B, colours · bins, rows, cols) to (B, ``spec.channels``, rows, cols)."""
    scheme = spec.normalizer
    each = histograms.reshape(-1, spec.bins, *histograms.shape[2:])
    if isinstance(scheme, GlobalNorm):
        found = global_norm(each, scheme)
    elif isinstance(scheme, FourBlockNorm):
        found = four_block_norm(each, scheme, signed=spec.signed)
    elif isinstance(scheme, BlockNorm):
        found = block_norm(each, scheme)
    else:
        found = cell_norm(each, scheme)
    return found.reshape(-1, spec.channels, *found.shape[2:])
