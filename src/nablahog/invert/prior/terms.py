"""Priors on images: which of all images with the same descriptor to prefer.

Each is a sum of squares, so that Gauss-Newton methods can use its residuals.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from ctypes import c_bool, c_double, c_int64
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable
from torch.nn.functional import avg_pool2d

from ... import native
from ...hog.descriptor import histograms, normalize
from ...hog.orientation import magnitude, vanishing
from ...hog.spec import HOGSpec
from ...hog.steps import normalize_reference
from ...inputs.numbers import as_number

# of the mean gradient magnitude: |d| is rounded off below it, so that minimisers see a smooth minimum
SMOOTHNESS_ROUNDING = 0.05

_REALS = native.array(np.float32, np.float64)
_smoothness = native.function("smoothness", c_bool, *[c_int64] * 3, *[c_double] * 2, *[_REALS] * 3)


def differences(image: Tensor) -> list[Tensor]:
    """i_p - i_q over all pairs of neighbours, along x and along y."""
    return [image[..., :, 1:] - image[..., :, :-1], image[..., 1:, :] - image[..., :-1, :]]


def smoothness(image: Tensor) -> Tensor:
    """The smoothness term of Eq. 9, Σ |i_p - i_q|, divided by Σ‖∇i‖: images (A, 1, H, W) to (A,).

    The mask [-1, 0, 1] of ∇ skips the pixel in the middle, so the descriptor fixes Σ‖∇i‖ but leaves patterns of period
    two open.  This ratio is smallest where neighbours change monotonically, and grows with each such pattern.
    """
    neighbours, scale, pixels = _differences_and_scale(image)
    rounding = (SMOOTHNESS_ROUNDING * scale).square().reshape(-1, 1, 1, 1)
    terms = [(d.square() + rounding).sqrt().sum(dim=(1, 2, 3)) for d in neighbours]
    return (terms[0] + terms[1]) / (pixels * scale)


def _differences_and_scale(image: Tensor) -> tuple[list[Tensor], Tensor, int]:
    """Differences along x and y, Σ‖∇i‖ per pixel (A,), 1 if that is 0, and the number of pixels."""
    dx, dy = differences(image)
    gx, gy = (dx[..., 1:] + dx[..., :-1])[..., 1:-1, :], (dy[..., 1:, :] + dy[..., :-1, :])[..., 1:-1]
    pixels = image[0].numel()  # divides a sum: a mean over no differences, in one row or column, would be NaN
    visible = magnitude(gx, gy).sum(dim=(1, 2, 3)) / pixels
    return [dx, dy], torch.where(visible > 0, visible, 1), pixels


class _Smoothness(torch.autograd.Function):
    """:func:`smoothness` on a CPU, differentiable once, in reverse mode."""

    @staticmethod
    def forward(ctx: Any, images: Tensor) -> Tensor:
        images = images.detach().contiguous()
        double, out, ctx.slopes = images.dtype == torch.float64, images.new_empty(len(images)), torch.empty_like(images)
        shape = len(images), *images.shape[2:]
        _smoothness(double, *shape, SMOOTHNESS_ROUNDING, vanishing(images.dtype), images, out, ctx.slopes)
        return out

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad_output: Tensor) -> Tensor:
        slopes: Tensor = ctx.slopes * grad_output.view(-1, 1, 1, 1)
        return slopes


@dataclass(frozen=True)
class Prior(ABC):
    """A weighted sum of squares over an image.

    Attributes:
        weight: factor of the sum, on the scale of ‖φ(Î) - φ(I)‖² / ‖φ(I)‖² and gray values in 0…1.
    """

    weight: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "weight", as_number("weight", self.weight, 0))

    @abstractmethod
    def terms(self, image: Tensor) -> Tensor:
        """Images (A, 1, H, W) to (A, K), whose squares sum to the prior of weight 1."""

    def residuals(self, image: Tensor) -> Tensor:
        """Images (A, 1, H, W) to (A, K), whose squares sum to the prior."""
        return self.terms(image) * math.sqrt(self.weight)

    def __call__(self, image: Tensor) -> Tensor:
        """Images (A, 1, H, W) to the prior (A,)."""
        return self.weight * self.terms(image).square().sum(1)

    def select(self, index: Tensor | slice) -> Prior:
        """The prior of the images ``index`` of a batch; most priors are the same for all images."""
        return self


@dataclass(frozen=True)
class RelativeSmoothness(Prior):
    """:func:`smoothness`, the default prior: it ignores brightness and contrast, which HOG leaves open.

    Called with images on a CPU it is differentiable once, in reverse mode; its residuals are differentiable in any mode
    and order.
    """

    def terms(self, image: Tensor) -> Tensor:
        # √(d² + ε²) = (√(d² + ε²) - ε) + ε with ε a fixed share of the scale.  The bracket is the square of
        # d / √(√(d² + ε²) + ε), whose slope at d = 0 gives Gauss-Newton the curvature there; the rest is constant.
        neighbours, scale, pixels = _differences_and_scale(image)
        rounding = SMOOTHNESS_ROUNDING * scale.unsqueeze(1)
        d = torch.cat([d.flatten(1) for d in neighbours], dim=1)
        bent = d / ((d.square() + rounding.square()).sqrt() + rounding).sqrt() / (pixels * scale.unsqueeze(1)).sqrt()
        constant = (SMOOTHNESS_ROUNDING * d.shape[1] / pixels) ** 0.5
        return torch.cat([bent, torch.full_like(bent[:, :1], constant)], dim=1)

    def __call__(self, image: Tensor) -> Tensor:
        if image.device.type != "cpu" or not native.available():
            return self.weight * smoothness(image)
        value: Tensor = self.weight * _Smoothness.apply(image)  # type: ignore[no-untyped-call]
        return value


@dataclass(frozen=True)
class GrayRange(Prior):
    """Mean squared excess of gray values over 0…1: where the descriptor fixes the contrast, no image exceeds them."""

    def terms(self, image: Tensor) -> Tensor:
        pixels = image.flatten(1)
        return ((pixels - 0.5).abs() - 0.5).clamp(min=0) / math.sqrt(pixels.shape[1])


@dataclass(frozen=True, eq=False)
class CoarserDescriptor(Prior):
    """‖φ(Î') - φ(I')‖² / ‖φ(I')‖², where I' is I at a coarser scale: each pixel is the mean of those it covers.

    0 where I' has no texture, so that φ(I') = 0.  Where the unknown is the root of an image, roots are averaged instead
    of gray values, an approximation.
    """

    descriptor: Tensor  # (B, rows, cols, channels), φ(I')
    spec: HOGSpec  # its dialect, as :func:`.histograms.linear_vote_spec` gives it
    factor: int  # pixels covered by a pixel of I', along each axis

    def terms(self, image: Tensor) -> Tensor:
        cells = histograms(avg_pool2d(image, self.factor), self.spec)
        difference = normalize_reference(cells, self.spec) - self.descriptor.permute(0, 3, 1, 2)
        return difference.flatten(1) * self._scale().sqrt().unsqueeze(1)

    def __call__(self, image: Tensor) -> Tensor:
        cells = histograms(avg_pool2d(image, self.factor), self.spec)
        difference = normalize(cells, self.spec) - self.descriptor.permute(0, 3, 1, 2)
        return self.weight * difference.square().sum(dim=(1, 2, 3)) * self._scale()

    def select(self, index: Tensor | slice) -> CoarserDescriptor:
        return replace(self, descriptor=self.descriptor[index])

    def _scale(self) -> Tensor:
        """1 / ‖φ(I')‖² (B,), 0 where that is 0."""
        size = self.descriptor.square().sum(dim=(1, 2, 3))
        return torch.where(size > 0, 1 / torch.where(size > 0, size, 1), 0)
