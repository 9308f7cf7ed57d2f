"""Whitening of whole descriptors by the background's Σ⁻¹, a convolution, by Fourier transforms."""

from __future__ import annotations

import hashlib
import math
from ctypes import c_int64
from functools import cached_property, lru_cache

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.fft import irfft2, next_fast_len, rfft2
from torch import Tensor
from torch.nn.functional import pad

from .. import native
from .whitening import Background

_REACH = 48  # cells, a torus on which the inverse of Σ decays; windows of objects have fewer
_MARGIN = 4  # cells, between a descriptor and itself around the torus
_BLOCK = 16  # frequencies that are next to each other in the compiled loops' memory

_COMPLEX, _FLOATS = native.array(np.complex64), native.array(np.float32)
_whiten = native.function("whiten", *[c_int64] * 3, _FLOATS, _COMPLEX, _COMPLEX)
_energies = native.function("energies", *[c_int64] * 3, _FLOATS, _COMPLEX, _FLOATS, _FLOATS)


class Whitener:
    """Applies Σ⁻¹ to descriptors of one size, of hundreds of cells.

    Σ of a stationary background is a convolution over cells; so is its inverse, where the border is far.  On a torus a
    little larger than the descriptor, the Fourier transform turns both into one C x C matrix for each frequency.

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
        inverse = _inverse_spectrum(background, self.size, least)
        self.inverse = inverse.to(torch.complex64).flatten(0, 1).permute(1, 2, 0).contiguous()  # (C, C, frequencies)
        # of a real signal's spectrum a half is stored: all but its first and its middle column count twice
        across = np.arange(self.size[1] // 2 + 1)
        shares = np.where(2 * across % self.size[1] == 0, 1, 2) / math.prod(self.size)
        self._shares = _whole_blocks(torch.from_numpy(np.tile(shares.astype(np.float32), self.size[0])))
        blocks = torch.view_as_real(torch.unflatten(_whole_blocks(self.inverse), 2, (-1, _BLOCK)))
        self._blocks = blocks.permute(2, 0, 1, 4, 3).contiguous()  # (blocks, C, C, 2, frequencies of a block)

    @cached_property
    def digest(self) -> str:
        """A hash of Σ⁻¹."""
        return hashlib.sha256(repr(self.size).encode() + self.inverse.numpy().tobytes()).hexdigest()

    def __call__(self, descriptors: Tensor) -> Tensor:
        """Σ⁻¹ q: (B, C, rows, cols) to the same, float32; zeros are assumed beyond the border."""
        spectrum = self._spectrum(descriptors)
        if native.available():
            whitened = np.empty_like(spectrum)
            _whiten(*spectrum.shape, self._blocks, spectrum, whitened)
        else:
            whitened = torch.einsum("acf,bcf->baf", self.inverse, torch.from_numpy(spectrum)).numpy()
        half = whitened.reshape(*whitened.shape[:2], self.size[0], -1)
        return torch.from_numpy(irfft2(half, s=self.size, overwrite_x=True)[..., : self.rows, : self.cols])

    def energies(self, descriptors: Tensor) -> Tensor:
        """qᵀ Σ⁻¹ q of descriptors (B, C, rows, cols), (B,): by Parseval's theorem, without an inverse transform."""
        if not native.available():
            return (descriptors * self(descriptors)).sum(dim=(1, 2, 3))
        spectrum = self._spectrum(descriptors)
        energies = np.empty(len(spectrum), np.float32)
        _energies(*spectrum.shape, self._blocks, spectrum, self._shares, energies)
        return torch.from_numpy(energies)

    def _spectrum(self, descriptors: Tensor) -> NDArray[np.complex64]:
        """The Fourier transform of descriptors (B, C, rows, cols), (B, C, frequencies)."""
        # SciPy's transforms: small ones take PyTorch longer, and its threads wait for each other
        spectrum = rfft2(descriptors.float().numpy(force=True), s=self.size)
        half: NDArray[np.complex64] = spectrum.reshape(*spectrum.shape[:2], -1)
        return half

    def centred(self, descriptors: Tensor) -> Tensor:
        """q − μ of descriptors (B, C, rows, cols)."""
        return descriptors - self.mean[:, None, None]


def _whole_blocks(values: Tensor) -> Tensor:
    """Values (…, frequencies) with zeros behind, up to whole blocks of frequencies."""
    return pad(values, (0, -values.shape[-1] % _BLOCK))


def _inverse_spectrum(background: Background, size: tuple[int, int], least: float) -> Tensor:
    """(Σ + λ)⁻¹ at the frequencies of a torus, (rows, cols / 2 + 1, C, C), complex.

    It decays over cells, so that on a large torus it is that of a smaller one, continued by zeros.
    """
    if min(size) <= _REACH:
        return _inverted(background, size, least)
    cells = _inverse_cells(background, least)
    torus = cells.new_zeros(*size, *cells.shape[2:])
    half = _REACH // 2
    for rows in (slice(None, half), slice(-half, None)):
        for cols in (slice(None, half), slice(-half, None)):
            torus[rows, cols] = cells[rows, cols]
    spectrum: Tensor = torch.fft.rfft2(torus, dim=(0, 1))
    return spectrum


@lru_cache(maxsize=8)
def _inverse_cells(background: Background, least: float) -> Tensor:
    """(Σ + λ)⁻¹ by the offset between two cells, (_REACH, _REACH, C, C)."""
    size = _REACH, _REACH
    cells: Tensor = torch.fft.irfft2(_inverted(background, size, least), s=size, dim=(0, 1))
    return cells


def _inverted(background: Background, size: tuple[int, int], least: float) -> Tensor:
    """(Σ + λ)⁻¹ at the frequencies of a torus, one by one."""
    # entry [dy, dx, a, b] is E a(y) b(y + d): Σ maps b to a by correlation, the conjugate of convolution
    spectrum = torch.fft.rfft2(_on_torus(background, size), dim=(0, 1)).conj()
    spectrum = (spectrum + spectrum.mH) / 2
    values, vectors = torch.linalg.eigh(spectrum)
    inverse: Tensor = (vectors / (values.clamp(min=0) + least)[..., None, :]) @ vectors.mH
    return inverse


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
