"""The unknowns of a reconstruction: how a vector becomes an image."""

from __future__ import annotations

import math
from typing import Protocol

import torch
from torch import Tensor

from .cosine_transform import from_cosines, to_cosines


class Parameterization(Protocol):
    """A linear, invertible map between unknowns (A, H·W) and images (A, 1, H, W)."""

    def image(self, unknowns: Tensor) -> Tensor:
        """In memory of its own."""
        ...

    def unknowns(self, image: Tensor) -> Tensor: ...

    def adjoint(self, grad_image: Tensor) -> Tensor:
        """Gradients with respect to images (A, 1, H, W) to those with respect to the unknowns (A, H·W)."""
        ...


class Pixels:
    """The gray values themselves, as in the paper."""

    def __init__(self, height: int, width: int) -> None:
        self.shape = (height, width)

    def image(self, unknowns: Tensor) -> Tensor:
        return unknowns.reshape(-1, 1, *self.shape).clone()

    def unknowns(self, image: Tensor) -> Tensor:
        return image.flatten(1)

    def adjoint(self, grad_image: Tensor) -> Tensor:
        return grad_image.flatten(1)


class CosineBasis:
    """Cosine coefficients, each in units of 1/f^exponent at its spatial frequency f.

    HOG sees differences only, which are weakest in smooth components; in pixels those converge last.  Natural images
    have amplitudes of about 1/f, so in these units all unknowns are of one size, and the first descent step from a
    nearly flat image already integrates the gradient field (exponent 1: it solves Poisson's equation).
    """

    def __init__(self, height: int, width: int, like: Tensor, exponent: float = 1.0) -> None:
        # cycles across the longer side, twice; the mean has no frequency and takes the lowest
        scale = max(height, width)
        fy, fx = torch.arange(height) * scale / height, torch.arange(width) * scale / width
        frequency = torch.sqrt(fy.square().unsqueeze(1) + fx.square()).clamp(min=1)
        self.weights = frequency.pow(-exponent).to(like)

    def image(self, unknowns: Tensor) -> Tensor:
        return from_cosines(unknowns.reshape(-1, 1, *self.weights.shape) * self.weights)

    def unknowns(self, image: Tensor) -> Tensor:
        return (to_cosines(image) / self.weights).flatten(1)

    def adjoint(self, grad_image: Tensor) -> Tensor:
        return (to_cosines(grad_image) * self.weights).flatten(1)


def low_pass(image: Tensor, sigma: float) -> Tensor:
    """Images (A, 1, H, W) convolved with a Gaussian of ``sigma`` pixels, mirrored at the borders."""
    damping = [
        torch.exp(-0.5 * (math.pi * sigma * torch.arange(n, dtype=torch.float64) / n) ** 2) for n in image.shape[-2:]
    ]
    return from_cosines(to_cosines(image) * torch.outer(*damping).to(image))
