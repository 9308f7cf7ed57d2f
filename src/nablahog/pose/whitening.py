"""Whitening (exemplar LDA): mean and covariance of HOG templates over arbitrary photographs, and its inverse.

After Hariharan, Malik and Ramanan ("Discriminative decorrelation for clustering and classification"): the descriptor of
photographs is taken to be stationary, so that one mean and one covariance per offset between two cells give the mean μ
and the covariance Σ of templates of any size, Σ as a block-Toeplitz matrix.
"""

from __future__ import annotations

import hashlib
import math
from ctypes import c_int64
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.fft import irfft2, next_fast_len, rfft2
from torch import Tensor
from torch.nn.functional import pad

from .. import native
from ..hog.spec import HOGSpec
from ..inputs.numbers import as_number, check_type
from ..io.learned_model import NUMBER, SPEC, TENSOR, TEXTS, LearnedModel, check_tensor
from ..runtime.text import counted

MAX_ENTRY = 1e6  # entry of a mean or covariance: those of descriptors are far below 1
_DECAY = 48  # cells of a torus on which the inverse of Σ decays; windows of objects have fewer
_TORUS_MARGIN = 4  # cells between a descriptor and its copy around the torus
_BLOCK = 16  # frequencies that are adjacent in the compiled loops' memory
_REGULARIZATION = {8: 0.003, 4: 0.03}  # λ by the pixels of a cell, for whole windows

_COMPLEX, _FLOATS = native.array(np.complex64), native.array(np.float32)
_whiten = native.function("whiten", *[c_int64] * 3, _FLOATS, _COMPLEX, _COMPLEX)
_energies = native.function("energies", *[c_int64] * 3, _FLOATS, _COMPLEX, _FLOATS, _FLOATS)


@dataclass(frozen=True, eq=False, repr=False)
class Background(LearnedModel):
    """Mean and autocovariance of a stationary descriptor, learned by :func:`.background.learn_background`.

    Templates are (N, rows, cols, C), float32 or float64, on any device, with at most ``order`` + 1 rows and columns.
    Results have their dtype and device, are computed in float64, and are differentiable in the templates.

    Attributes:
        spec: the dialect, with C channels; not globally normalised.
        mean: (C,), float64.
        covariance: (order + 1, 2 · order + 1, C, C), float64: entry [dy, order + dx, a, b] is that of channel a of a
            cell with channel b of the cell dy rows below and dx columns to the right.
        images: the names of the images it was learned from.
        regularization: λ, added to the diagonal of Σ; a multiple of it if Σ + λ is not positive definite.

    Raises:
        ValueError: these contradict each other, hold NaN, Inf or what no descriptor has, or λ is not in 1e-9…1e6.
    """

    KIND = "background"
    NOUN = "background"
    ARRAYS: ClassVar = {
        "spec": SPEC,
        "mean": TENSOR,
        "covariance": TENSOR,
        "images": TEXTS,
        "regularization": NUMBER,
    }
    COMPRESSED = True

    spec: HOGSpec
    mean: Tensor
    covariance: Tensor
    images: tuple[str, ...]
    regularization: float = 0.01
    _factors: dict[tuple[int, int], Tensor] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        check_spec(check_type("spec", self.spec, HOGSpec))
        channels, order = self.spec.channels, self.order
        shapes = {"mean": (channels,), "covariance": (order + 1, 2 * order + 1, channels, channels)}
        for name, shape in shapes.items():
            check_tensor(name, getattr(self, name), torch.float64, shape, -MAX_ENTRY, MAX_ENTRY)
        if not torch.allclose(self.covariance[0].flip(0).mT, self.covariance[0]):
            raise ValueError("the covariance of two cells must not depend on which of them comes first")
        object.__setattr__(self, "regularization", as_number("regularization", self.regularization, 1e-9, MAX_ENTRY))

    @property
    def summary(self) -> str:
        cells = f"{self.order + 1}x{self.order + 1}"
        return f"{counted(len(self.images), 'image')}, {self.spec.channels} channels, templates of up to {cells} cells"

    @property
    def order(self) -> int:
        """The largest offset between cells, in either direction, that has a covariance."""
        return len(self.covariance) - 1

    def check(self, spec: HOGSpec) -> None:
        """Raises ValueError if descriptors of ``spec`` are not what it was learned for."""
        self.spec.check_same(spec, f"the {self.NOUN}")

    def template_mean(self, rows: int, cols: int) -> Tensor:
        """μ, (rows, cols, C), float64."""
        return self.mean.expand(rows, cols, -1)

    def template_covariance(self, rows: int, cols: int) -> Tensor:
        """Σ without λ, (rows · cols · C, rows · cols · C), float64, of flattened templates.

        Raises:
            ValueError: the template is empty, or larger than ``order`` + 1.
        """
        most = self.order + 1
        if not (1 <= rows <= most and 1 <= cols <= most):
            raise ValueError(f"a template must have 1…{most} rows and columns of cells here, got {rows}x{cols}")
        row, col = torch.arange(rows), torch.arange(cols)
        dy, dx = row - row[:, None] + self.order, col - col[:, None] + self.order
        blocks = self.all_offsets()[dy[:, :, None, None], dx]  # (row, row', col, col', channel, channel')
        return blocks.permute(0, 2, 4, 1, 3, 5).reshape(2 * [rows * cols * self.spec.channels])

    def all_offsets(self) -> Tensor:
        """The covariance at all offsets, (2 · order + 1, 2 · order + 1, C, C)."""
        above = self.covariance[1:].flip(0, 1).mT  # the cell at -dy, -dx sees this one at dy, dx
        return torch.cat([above, self.covariance])

    def factor(self, rows: int, cols: int) -> Tensor:
        """L, lower triangular, with L·Lᵀ = Σ + λ; cached."""
        size = rows, cols
        if size not in self._factors:
            self._factors[size] = _cholesky(self.template_covariance(rows, cols), self.regularization)
        return self._factors[size]

    def decorrelate(self, templates: Tensor) -> Tensor:
        """L⁻¹(q − μ), (N, rows, cols, C): over the background, entries of unit variance that do not correlate."""
        centred, factor = self._centred(templates)
        white: Tensor = torch.linalg.solve_triangular(factor, centred, upper=False)
        return white.T.reshape(templates.shape).to(templates)

    def whiten(self, templates: Tensor) -> Tensor:
        """Σ⁻¹(q − μ), (N, rows, cols, C): the weights of the linear discriminant between q and the background."""
        centred, factor = self._centred(templates)
        return torch.cholesky_solve(centred, factor).T.reshape(templates.shape).to(templates)

    def discriminability(self, templates: Tensor) -> Tensor:
        """‖Σ^-½(q − μ)‖, (N,): how unlike the background a template is, in its standard deviations."""
        norms: Tensor = self.decorrelate(templates).flatten(1).norm(dim=1)
        return norms

    def deviation(self, weights: Tensor) -> Tensor:
        """√(wᵀΣw), (N,): the standard deviation of the score of weights (N, rows, cols, C) over the background."""
        flat, factor = self._columns(weights)
        deviations: Tensor = (factor.mT @ flat).norm(dim=0).to(weights)
        return deviations

    def _centred(self, templates: Tensor) -> tuple[Tensor, Tensor]:
        """q − μ as columns, and L."""
        columns, factor = self._columns(templates)
        return columns - self.template_mean(*templates.shape[1:3]).reshape(-1, 1).to(templates.device), factor

    def _columns(self, templates: Tensor) -> tuple[Tensor, Tensor]:
        """q as columns, and L."""
        if templates.dim() != 4 or templates.shape[3] != self.spec.channels or not templates.is_floating_point():
            raise ValueError(
                f"templates must be floating-point tensors (N, rows, cols, {self.spec.channels}), "
                f"got {templates.dtype} of shape {tuple(templates.shape)}"
            )
        return templates.flatten(1).double().T, self.factor(*templates.shape[1:3]).to(templates.device)


def check_spec(spec: HOGSpec) -> None:
    """Raises ValueError if the descriptor of a cell depends on the whole image."""
    if spec.normalizer.reach() is None:
        raise ValueError(
            f"a background needs a locally normalised descriptor, but {spec.name} divides a whole image by one factor: "
            f"templates of different images would not be samples of one distribution"
        )


def _cholesky(covariance: Tensor, regularization: float) -> Tensor:
    """The factor of ``covariance`` with λ added to its diagonal as often as it takes to be positive definite."""
    eye = torch.eye(len(covariance), dtype=covariance.dtype)
    factor: Tensor
    factor, failed = torch.linalg.cholesky_ex(covariance + regularization * eye)
    times = 1
    while failed:
        if times == 1:  # the smallest eigenvalue says how often
            times = math.floor(-float(torch.linalg.eigvalsh(covariance)[0]) / regularization)
        times = max(times, 1) + 1
        factor, failed = torch.linalg.cholesky_ex(covariance + times * regularization * eye)
    return factor


class Whitener:
    """Applies Σ⁻¹ to descriptors of one size, of hundreds of cells.

    Σ of a stationary background is a convolution over cells, and so is its inverse far from the border.  On a torus a
    little larger than the descriptor, the Fourier transform turns both into one C x C matrix for each frequency.

    The autocovariance is known for offsets up to the background's order only: a triangular window fades it out, and λ,
    by default the background's, is added to the eigenvalues of each frequency's matrix.
    """

    def __init__(self, background: Background, rows: int, cols: int, regularization: float | None = None) -> None:
        least = background.regularization if regularization is None else regularization
        self.rows, self.cols, self.mean = rows, cols, background.mean.to(torch.float32)
        self.size = next_fast_len(rows + _TORUS_MARGIN, real=True), next_fast_len(cols + _TORUS_MARGIN, real=True)
        inverse = _inverse_spectrum(background, self.size, least)
        self.inverse = inverse.to(torch.complex64).flatten(0, 1).permute(1, 2, 0).contiguous()  # (C, C, frequencies)
        # half of a real signal's spectrum is stored: all but the first and the middle column count twice
        across = np.arange(self.size[1] // 2 + 1)
        shares = np.where(2 * across % self.size[1] == 0, 1, 2) / math.prod(self.size)
        whole = 0, -self.inverse.shape[2] % _BLOCK  # padding with zeros
        self._shares = pad(torch.from_numpy(np.tile(shares.astype(np.float32), self.size[0])), whole)
        blocks = torch.view_as_real(torch.unflatten(pad(self.inverse, whole), 2, (-1, _BLOCK)))
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
        spectrum = rfft2(descriptors.float().numpy(force=True), s=self.size)  # PyTorch is slower at small transforms
        half: NDArray[np.complex64] = spectrum.reshape(*spectrum.shape[:2], -1)
        return half

    def subtract_mean(self, descriptors: Tensor) -> Tensor:
        """q − μ of descriptors (B, C, rows, cols)."""
        return descriptors - self.mean[:, None, None]


def _inverse_spectrum(background: Background, size: tuple[int, int], least: float) -> Tensor:
    """(Σ + λ)⁻¹ at the frequencies of a torus, (rows, cols / 2 + 1, C, C), complex.

    It decays over cells: on a large torus it is that of a smaller one, padded with zeros.
    """
    if min(size) <= _DECAY:
        return _invert_on_torus(background, size, least)
    cells = _inverse_cells(background, least)
    torus = cells.new_zeros(*size, *cells.shape[2:])
    offsets = torch.arange(-(_DECAY // 2), _DECAY // 2)
    torus[offsets[:, None], offsets] = cells[offsets[:, None], offsets]
    spectrum: Tensor = torch.fft.rfft2(torus, dim=(0, 1))
    return spectrum


@lru_cache(maxsize=8)
def _inverse_cells(background: Background, least: float) -> Tensor:
    """(Σ + λ)⁻¹ by the offset between two cells, (_DECAY, _DECAY, C, C)."""
    size = _DECAY, _DECAY
    cells: Tensor = torch.fft.irfft2(_invert_on_torus(background, size, least), s=size, dim=(0, 1))
    return cells


def _invert_on_torus(background: Background, size: tuple[int, int], least: float) -> Tensor:
    """(Σ + λ)⁻¹ at the frequencies of a torus, one by one."""
    # entry [dy, dx, a, b] is E a(y) b(y + d): Σ maps b to a by correlation, the conjugate of convolution
    spectrum = torch.fft.rfft2(_wrap_covariance(background, size), dim=(0, 1)).conj()
    spectrum = (spectrum + spectrum.mH) / 2
    values, vectors = torch.linalg.eigh(spectrum)
    inverse: Tensor = (vectors / (values.clamp(min=0) + least)[..., None, :]) @ vectors.mH
    return inverse


def _wrap_covariance(background: Background, size: tuple[int, int]) -> Tensor:
    """The autocovariance at all offsets on a torus, (rows, cols, C, C), faded out at the background's order."""
    order, offsets = background.order, background.all_offsets()
    fade = 1 - torch.arange(-order, order + 1, dtype=torch.float64).abs() / (order + 1)
    offsets = offsets * (fade[:, None] * fade)[:, :, None, None]
    torus = offsets.new_zeros((*size, *offsets.shape[2:]))
    dy, dx = (torch.arange(-order, order + 1) % side for side in size)
    # offsets beyond half the torus coincide with others: both are added
    return torus.index_put_((dy[:, None], dx[None, :]), offsets, accumulate=True)


@lru_cache(maxsize=64)
def cached_whitener(background: Background, rows: int, cols: int) -> Whitener:
    """The whitener of descriptors of a size, made once."""
    return Whitener(background, rows, cols, _REGULARIZATION.get(background.spec.cell_size[0]))
