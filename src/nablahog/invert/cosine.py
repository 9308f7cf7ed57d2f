"""The orthonormal cosine transform of images, DCT-II, and images as unknowns in its basis.

On a CPU the transform is SciPy's, elsewhere products with the matrix of cosines.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import torch
from scipy import fft
from torch import Tensor


@lru_cache(maxsize=16)  # kept on the device: a copy from the CPU would stall it
def cosines(n: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    """The orthonormal DCT-II matrix (n, n)."""
    with torch.inference_mode(False):
        k, x = torch.meshgrid(*(torch.arange(n, dtype=torch.float64),) * 2, indexing="ij")
        matrix = torch.cos(math.pi * k * (x + 0.5) / n) * math.sqrt(2 / n)
        matrix[0] /= math.sqrt(2)
        return matrix.to(device, dtype)


def to_cosines(images: Tensor) -> Tensor:
    """The orthonormal DCT-II of images (..., H, W), differentiable in either mode."""
    return _transformed(images, inverse=False)


def from_cosines(coefficients: Tensor) -> Tensor:
    """Images (..., H, W) from their :func:`to_cosines`, differentiable in either mode."""
    return _transformed(coefficients, inverse=True)


def _transformed(planes: Tensor, inverse: bool) -> Tensor:
    if planes.device.type != "cpu":
        rows, cols = (cosines(n, planes.dtype, planes.device) for n in planes.shape[-2:])
        return rows.T @ planes @ cols if inverse else rows @ planes @ cols.T
    if not torch.is_grad_enabled():  # saves the overhead of autograd
        return _on_cpu(planes, inverse)
    out: Tensor = _OnCpu.apply(planes, inverse)  # type: ignore[no-untyped-call]
    return out


def _on_cpu(planes: Tensor, inverse: bool) -> Tensor:
    transform = fft.idctn if inverse else fft.dctn
    return torch.from_numpy(transform(planes.numpy(), axes=(-2, -1), norm="ortho", workers=torch.get_num_threads()))


class _OnCpu(torch.autograd.Function):
    """The transform on a CPU, or its inverse: orthonormal, so each is the other's adjoint."""

    @staticmethod
    def forward(planes: Tensor, inverse: bool) -> Tensor:
        return _on_cpu(planes.detach(), inverse)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Tensor) -> None:
        ctx.inverse = inputs[1]

    @staticmethod
    def backward(ctx: Any, grad_output: Tensor) -> tuple[Tensor, None]:
        return _transformed(grad_output, not ctx.inverse), None

    @staticmethod
    def jvp(ctx: Any, tangent: Tensor, _: None) -> Tensor:
        return _transformed(tangent, ctx.inverse)


class CosineBasis:
    """Unknowns (A, H·W): cosine coefficients of images (A, 1, H, W), in units of 1/f^exponent at spatial frequency f.

    HOG sees only differences, which are weakest in smooth components, so pixel unknowns converge last there.  Natural
    images have amplitudes of about 1/f: in these units all unknowns have about the same size, and the first descent
    step from a nearly flat image already integrates the gradient field (exponent 1 solves Poisson's equation).
    """

    def __init__(self, height: int, width: int, like: Tensor, exponent: float = 1.0) -> None:
        # half-cycles across the longer side; the mean has frequency 0 and is given the lowest
        scale = max(height, width)
        fy, fx = torch.arange(height) * scale / height, torch.arange(width) * scale / width
        frequency = torch.sqrt(fy.square().unsqueeze(1) + fx.square()).clamp(min=1)
        self.weights = frequency.pow(-exponent).to(like)

    def image(self, unknowns: Tensor) -> Tensor:
        """Unknowns (A, H·W) to images (A, 1, H, W), in memory of its own."""
        return from_cosines(unknowns.reshape(-1, 1, *self.weights.shape) * self.weights)

    def unknowns(self, image: Tensor) -> Tensor:
        """Images (A, 1, H, W) to unknowns (A, H·W)."""
        return (to_cosines(image) / self.weights).flatten(1)

    def adjoint(self, grad_image: Tensor) -> Tensor:
        """Gradients with respect to images (A, 1, H, W) to those with respect to the unknowns (A, H·W)."""
        return (to_cosines(grad_image) * self.weights).flatten(1)


def low_pass(image: Tensor, sigma: float) -> Tensor:
    """Images (A, 1, H, W) convolved with a Gaussian of ``sigma`` pixels, mirrored at the borders."""
    damping = [
        torch.exp(-0.5 * (math.pi * sigma * torch.arange(n, dtype=torch.float64) / n) ** 2) for n in image.shape[-2:]
    ]
    return from_cosines(to_cosines(image) * torch.outer(*damping).to(image))
