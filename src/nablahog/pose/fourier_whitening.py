"""Σ⁻¹ for a whole descriptor: the whitening of :mod:`.whitening`, but for templates of hundreds of cells.

Σ of a stationary background is a convolution over cells; so is its inverse, where the border is far.  On a torus a
little larger than the descriptor, the Fourier transform turns both into one C x C matrix for each frequency.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from scipy.fft import irfft2, next_fast_len, rfft2
from torch import Tensor

from ..runtime.compile import compiled
from .whitening import Background

_MARGIN = 4  # cells, between a descriptor and itself around the torus


class Whitener:
    """Applies Σ⁻¹ to descriptors of one size.

    The autocovariance is known for offsets up to the background's order only; a triangular window lets it fade out
    there, and no frequency's matrix gets an eigenvalue below λ.

    Args:
        background: μ and Σ.
        rows, cols: of the descriptors, in cells.
        regularization: λ, by default the background's.
    """

    def __init__(self, background: Background, rows: int, cols: int, regularization: float | None = None) -> None:
        least = background.regularization if regularization is None else regularization
        self.rows, self.cols, self.mean = rows, cols, background.mean.to(torch.float32)
        self.size = next_fast_len(rows + _MARGIN, real=True), next_fast_len(cols + _MARGIN, real=True)
        # entry [dy, dx, a, b] is E a(y) b(y + d): Σ maps b to a by correlation, the conjugate of convolution
        spectrum = torch.fft.rfft2(_on_torus(background, self.size), dim=(0, 1)).conj()
        spectrum = (spectrum + spectrum.mH) / 2
        values, vectors = torch.linalg.eigh(spectrum)
        inverse = (vectors / (values.clamp(min=0) + least)[..., None, :]) @ vectors.mH
        # (C, C, frequencies), which come last so that a loop over them is a fast one
        self.inverse = inverse.to(torch.complex64).flatten(0, 1).permute(1, 2, 0).contiguous().numpy()
        # of a real signal's spectrum a half is stored: all but its first and its middle column count twice
        across = np.arange(spectrum.shape[1])
        shares = np.where(2 * across % self.size[1] == 0, 1, 2) / math.prod(self.size)
        self._shares = np.tile(shares.astype(np.float32), self.size[0])

    def __call__(self, descriptors: Tensor) -> Tensor:
        """Σ⁻¹ q: (B, C, rows, cols) to the same, float32; zeros are assumed beyond the border."""
        # SciPy's transforms: small ones take PyTorch longer, and its threads wait for each other
        spectrum = rfft2(descriptors.numpy(force=True), s=self.size)
        product = np.empty_like(spectrum)
        flat = (*spectrum.shape[:2], -1)
        _multiply(self.inverse, spectrum.reshape(flat), product.reshape(flat))
        return torch.from_numpy(irfft2(product, s=self.size, overwrite_x=True)[..., : self.rows, : self.cols])

    def energies(self, descriptors: Tensor) -> Tensor:
        """qᵀ Σ⁻¹ q of descriptors (B, C, rows, cols), (B,): by Parseval's theorem, without an inverse transform."""
        spectrum = rfft2(descriptors.numpy(force=True), s=self.size)
        energies = np.empty(len(spectrum), np.float32)
        _energies(self.inverse, spectrum.reshape((*spectrum.shape[:2], -1)), self._shares, energies)
        return torch.from_numpy(energies)

    def centred(self, descriptors: Tensor) -> Tensor:
        """q − μ of descriptors (B, C, rows, cols)."""
        return descriptors - self.mean[:, None, None]


def _on_torus(background: Background, size: tuple[int, int]) -> Tensor:
    """The autocovariance at all offsets on a torus, (rows, cols, C, C), faded out at the background's order."""
    order = background.order
    above = background.covariance[1:].flip(0, 1).mT
    offsets = torch.cat([above, background.covariance])  # (2 · order + 1, 2 · order + 1, C, C)
    fade = 1 - torch.arange(-order, order + 1, dtype=torch.float64).abs() / (order + 1)
    offsets = offsets * (fade[:, None] * fade)[:, :, None, None]
    torus = offsets.new_zeros((*size, *offsets.shape[2:]))
    dy, dx = (torch.arange(-order, order + 1) % side for side in size)
    # an offset beyond half the torus meets one from the other side: both count
    torus.index_put_((dy[:, None], dx[None, :]), offsets, accumulate=True)
    return torus


@compiled
def _multiply(matrices: Any, vectors: Any, out: Any) -> None:
    """Matrices (C, C, F) times vectors (B, C, F) for each of F frequencies, to ``out`` (B, C, F)."""
    batch, channels, frequencies = vectors.shape
    for b in range(batch):
        for a in range(channels):
            row = out[b, a]
            row[:] = 0
            for c in range(channels):
                matrix, vector = matrices[a, c], vectors[b, c]
                for f in range(frequencies):
                    row[f] += matrix[f] * vector[f]


@compiled
def _energies(matrices: Any, vectors: Any, shares: Any, out: Any) -> None:
    """Σ over frequencies of shares (F,) times vᴴMv, for Hermitian matrices (C, C, F) and vectors (B, C, F), to (B,)."""
    batch, channels, frequencies = vectors.shape
    sums = np.empty(frequencies, shares.dtype)
    for b in range(batch):
        sums[:] = 0
        for a in range(channels):
            for c in range(a + 1):
                matrix, vector, other = matrices[a, c], vectors[b, a], vectors[b, c]
                times = sums.dtype.type(1 if c == a else 2)  # with the other half of the matrix
                for f in range(frequencies):
                    product = matrix[f] * other[f]
                    sums[f] += times * (vector[f].real * product.real + vector[f].imag * product.imag)
        out[b] = (shares * sums).sum()
