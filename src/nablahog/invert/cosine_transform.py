"""The orthonormal cosine transform, DCT-II, of images: SciPy's on a CPU, elsewhere by PyTorch.

On a device, products with the matrix of cosines for small images, a Fourier transform along each axis for large ones.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import torch
from scipy import fft
from torch import Tensor

# Pixels of the longer side up to which products are taken.  Reasoned, not measured: for n x n pixels they are 4n
# operations a pixel, in two calls at a GPU's full rate; Fourier transforms move some 80 bytes a pixel through memory in
# about twenty calls, and GPUs do some 20 float32 operations in the time of a byte.
PRODUCTS_UP_TO = 512


@lru_cache(maxsize=16)  # kept on the device: what is made on the CPU waits for it each time
def cosines(n: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    """The orthonormal DCT-II matrix (n, n)."""
    with torch.inference_mode(False):
        k, x = torch.meshgrid(*(torch.arange(n, dtype=torch.float64),) * 2, indexing="ij")
        matrix = torch.cos(math.pi * k * (x + 0.5) / n) * math.sqrt(2 / n)
        matrix[0] /= math.sqrt(2)
        return matrix.to(device, dtype)


def _fast_cosines(planes: Tensor, inverse: bool) -> Tensor:
    transform = fft.idctn if inverse else fft.dctn
    return torch.from_numpy(transform(planes.numpy(), axes=(-2, -1), norm="ortho", workers=torch.get_num_threads()))


class _FastCosines(torch.autograd.Function):
    """The transform on a CPU, or its inverse: orthonormal, so each is the other's adjoint."""

    @staticmethod
    def forward(planes: Tensor, inverse: bool) -> Tensor:
        return _fast_cosines(planes.detach(), inverse)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Tensor) -> None:
        ctx.inverse = inputs[1]

    @staticmethod
    def backward(ctx: Any, grad_output: Tensor) -> tuple[Tensor, None]:
        return _transformed(grad_output, not ctx.inverse), None

    @staticmethod
    def jvp(ctx: Any, tangent: Tensor, _: None) -> Tensor:
        return _transformed(tangent, ctx.inverse)


@lru_cache(maxsize=16)
def _rotations(n: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    """e^(-iπk/2n) √(2/n), and √(1/n) for k = 0: (n // 2 + 1,), complex."""
    with torch.inference_mode(False):
        angle = torch.arange(n // 2 + 1, dtype=torch.float64) * (math.pi / (2 * n))
        length = torch.full_like(angle, math.sqrt(2 / n))
        length[0] /= math.sqrt(2)
        return torch.polar(length, -angle).to(device, dtype.to_complex())


def _along_rows(rows: Tensor) -> Tensor:
    """The transform of each row (..., n) by a Fourier transform of it (Makhoul, IEEE Trans. ASSP 28, 1980)."""
    n = rows.shape[-1]
    # even places, then odd ones backwards: the cosines of the row are the Fourier coefficients of this, rotated
    shuffled = torch.cat([rows[..., ::2], rows[..., 1::2].flip(-1)], dim=-1)
    half = torch.fft.rfft(shuffled) * _rotations(n, rows.dtype, rows.device)
    return torch.cat([half.real, -half.imag[..., 1 : (n + 1) // 2].flip(-1)], dim=-1)


def _along_rows_inverse(rows: Tensor) -> Tensor:
    """The inverse of :func:`_along_rows`."""
    n = rows.shape[-1]
    ahead = rows[..., : n // 2 + 1]
    behind = torch.cat([torch.zeros_like(rows[..., :1]), -rows[..., (n + 1) // 2 :].flip(-1)], dim=-1)
    shuffled = torch.fft.irfft(torch.complex(ahead, behind) / _rotations(n, rows.dtype, rows.device), n)
    even = (n + 1) // 2
    odd = torch.cat([shuffled[..., even:].flip(-1), shuffled[..., : 2 * even - n]], dim=-1)  # filled up to as many
    return torch.stack([shuffled[..., :even], odd], dim=-1).flatten(-2)[..., :n]


def by_fourier(planes: Tensor, inverse: bool) -> Tensor:
    """The transform of planes (..., H, W), or its inverse, by Fourier transforms along each axis."""
    along = _along_rows_inverse if inverse else _along_rows
    return along(along(planes).mT).mT


def by_products(planes: Tensor, inverse: bool) -> Tensor:
    """The transform of planes (..., H, W), or its inverse, by products with matrices."""
    rows, cols = (cosines(n, planes.dtype, planes.device) for n in planes.shape[-2:])
    return rows.T @ planes @ cols if inverse else rows @ planes @ cols.T


def _transformed(planes: Tensor, inverse: bool) -> Tensor:
    if planes.device.type != "cpu":
        return (by_products if max(planes.shape[-2:]) <= PRODUCTS_UP_TO else by_fourier)(planes, inverse)
    if not torch.is_grad_enabled():  # saves the overhead of autograd
        return _fast_cosines(planes, inverse)
    out: Tensor = _FastCosines.apply(planes, inverse)  # type: ignore[no-untyped-call]
    return out


def to_cosines(images: Tensor) -> Tensor:
    """The orthonormal DCT-II of images (..., H, W), differentiable in either mode."""
    return _transformed(images, inverse=False)


def from_cosines(coefficients: Tensor) -> Tensor:
    """Images (..., H, W) from their :func:`to_cosines`."""
    return _transformed(coefficients, inverse=True)
