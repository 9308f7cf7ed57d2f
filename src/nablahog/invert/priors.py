"""Priors on images: which of all images with the same descriptor to prefer.

Each is a sum of squares, so that Gauss-Newton methods can take it apart.  A power |d|^q is written as
d²·(d² + ε²)^((q-2)/2): the same, but for differences of ε and below, where it is a parabola with finite derivatives.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from ctypes import c_bool, c_double, c_int64
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from .. import native
from ..hog.orientation import magnitude, vanishing
from .method import Neighbours

ROUNDING = 0.05  # of the mean gradient magnitude: below it an absolute difference is rounded off, for the minimiser
EPSILON = 1e-3  # ε of the powers, a quarter of the step between two 8-bit levels

_REALS = native.array(np.float32, np.float64)
_smoothness = native.function("smoothness", c_bool, *[c_int64] * 3, *[c_double] * 2, *[_REALS] * 3)

Form: TypeAlias = Literal["absolute", "squared"]


def differences(image: Tensor, neighbours: Neighbours = 4) -> list[Tensor]:
    """i_p - i_q over all pairs of neighbours, each pair once: along x, along y, and along both diagonals if 8."""
    pairs = [(image[..., :, 1:], image[..., :, :-1]), (image[..., 1:, :], image[..., :-1, :])]
    if neighbours == 8:
        pairs += [(image[..., 1:, 1:], image[..., :-1, :-1]), (image[..., 1:, :-1], image[..., :-1, 1:])]
    return [p - q for p, q in pairs]


def _rounded(image: Tensor) -> tuple[list[Tensor], Tensor, int]:
    """Differences along x and along y, Σ‖∇i‖ per pixel (A,), and the number of pixels: what smoothness is made of."""
    dx, dy = differences(image)
    gx, gy = (dx[..., 1:] + dx[..., :-1])[..., 1:-1, :], (dy[..., 1:, :] + dy[..., :-1, :])[..., 1:-1]
    pixels = image[0].numel()  # sums over them, since the mean of no differences, in one row or column, is NaN
    visible = magnitude(gx, gy).sum(dim=(1, 2, 3)) / pixels
    return [dx, dy], torch.where(visible > 0, visible, 1), pixels


def smoothness(image: Tensor) -> Tensor:
    """The sum of Eq. 9's smoothness term over 4-neighbours, Σ |i_p - i_q|, as a share of Σ‖∇i‖: (A, 1, H, W) to (A,).

    The mask [-1, 0, 1] of ∇ skips the pixel in the middle, so the descriptor fixes Σ‖∇i‖ and leaves patterns of period
    two open; this ratio is smallest where neighbours change monotonically, and grows with each such pattern.
    """
    differences, scale, pixels = _rounded(image)
    rounding = (ROUNDING * scale).square().reshape(-1, 1, 1, 1)
    terms = [(d.square() + rounding).sqrt().sum(dim=(1, 2, 3)) for d in differences]
    return (terms[0] + terms[1]) / (pixels * scale)


class _Smoothness(torch.autograd.Function):
    """:func:`smoothness` on a CPU, differentiable once, in reverse mode."""

    @staticmethod
    def forward(ctx: Any, images: Tensor) -> Tensor:
        images = images.detach().contiguous()
        double, out, ctx.slopes = images.dtype == torch.float64, images.new_empty(len(images)), torch.empty_like(images)
        shape = len(images), *images.shape[2:]
        _smoothness(double, *shape, ROUNDING, vanishing(images.dtype), images, out, ctx.slopes)
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
        weight: what the sum is multiplied with, on the scale of ‖φ(Î) - φ(I)‖² / ‖φ(I)‖² and gray values in 0…1.
    """

    weight: float

    def __post_init__(self) -> None:
        if not 0 <= self.weight < float("inf"):
            raise ValueError(f"weight must be a finite number of at least 0, got {self.weight}")

    @abstractmethod
    def terms(self, image: Tensor) -> Tensor:
        """Images (A, 1, H, W) to (A, K), whose squares sum to the prior of weight 1."""

    def residuals(self, image: Tensor) -> Tensor:
        """Images (A, 1, H, W) to (A, K), whose squares sum to the prior."""
        return self.terms(image) * math.sqrt(self.weight)

    def __call__(self, image: Tensor) -> Tensor:
        """Images (A, 1, H, W) to the prior (A,)."""
        return self.weight * self.terms(image).square().sum(1)

    def of(self, index: Tensor | slice) -> Prior:
        """The prior of the images ``index`` of a batch: for most kinds, the same for all."""
        return self


def _power(difference: Tensor, squared: Tensor, exponent: float) -> Tensor:
    """Terms whose squares sum to |d|^exponent, from d or one component of it and from |d|²; rounded off at 0."""
    return difference if exponent == 2 else difference * (squared + EPSILON**2).pow((exponent - 2) / 4)


def _at_least_one(name: str, exponent: float) -> None:
    if not 1 <= exponent < float("inf"):
        raise ValueError(f"{name} must be a finite number of at least 1, got {exponent}")


@dataclass(frozen=True)
class RelativeSmoothness(Prior):
    """:func:`smoothness`, the default prior: it sees neither brightness nor contrast, which HOG leaves open.

    Called with images on a CPU it is differentiable once, in reverse mode; its residuals are as often as any other's.
    """

    def terms(self, image: Tensor) -> Tensor:
        # √(d² + ε²) = (√(d² + ε²) - ε) + ε with ε a fixed share of the scale.  The bracket is the square of
        # d / √(√(d² + ε²) + ε), whose slope at d = 0 tells Gauss-Newton of the parabola there; the rest is constant.
        differences, scale, pixels = _rounded(image)
        rounding = ROUNDING * scale.unsqueeze(1)
        d = torch.cat([d.flatten(1) for d in differences], dim=1)
        bent = d / ((d.square() + rounding.square()).sqrt() + rounding).sqrt() / (pixels * scale.unsqueeze(1)).sqrt()
        constant = (ROUNDING * d.shape[1] / pixels) ** 0.5
        return torch.cat([bent, torch.full_like(bent[:, :1], constant)], dim=1)

    def __call__(self, image: Tensor) -> Tensor:
        if image.device.type != "cpu" or not native.available():
            return self.weight * smoothness(image)
        value: Tensor = self.weight * _Smoothness.apply(image)  # type: ignore[no-untyped-call]
        return value


@dataclass(frozen=True)
class Smoothness(Prior):
    """Σ |i_p - i_q| over neighbours, as printed in Eq. 9 (weight: ξ), or Σ (i_p - i_q)².

    It grows with the contrast: where the descriptor leaves that open, an image of less contrast is always preferred.

    Attributes:
        form: ``"absolute"`` or ``"squared"``.
        neighbours: 4, or 8 with the diagonals, which count as much.
    """

    form: Form = "absolute"
    neighbours: Neighbours = 4

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, got, allowed in (
            ("form", self.form, get_args(Form)),
            ("neighbours", self.neighbours, get_args(Neighbours)),
        ):
            if got not in allowed:
                raise ValueError(f"{name} must be {' or '.join(map(repr, allowed))}, got {got!r}")

    def terms(self, image: Tensor) -> Tensor:
        exponent = 1 if self.form == "absolute" else 2
        return torch.cat(
            [_power(d, d.square(), exponent).flatten(1) for d in differences(image, self.neighbours)], dim=1
        )


@dataclass(frozen=True)
class TotalVariation(Prior):
    """Σ (dx² + dy²)^(β/2) of Mahendran & Vedaldi (CVPR 2015), dx and dy to the next pixel, 0 at the far edge.

    Attributes:
        beta: β, at least 1; 2 in their inversions of HOG, 1 is total variation.
    """

    beta: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        _at_least_one("beta", self.beta)

    def terms(self, image: Tensor) -> Tensor:
        dx = torch.diff(image, dim=-1, append=image[..., -1:])
        dy = torch.diff(image, dim=-2, append=image[..., -1:, :])
        squared = dx.square() + dy.square()
        return torch.cat([_power(d, squared, self.beta).flatten(1) for d in (dx, dy)], dim=1)


@dataclass(frozen=True)
class Norm(Prior):
    """Σ |i - mean of i|^α, which keeps gray values in a range (Mahendran & Vedaldi, CVPR 2015).

    Centred, since HOG does not see the brightness; theirs subtract a fixed mean first.

    Attributes:
        alpha: α, at least 1; 6 in their experiments.
    """

    alpha: float = 6.0

    def __post_init__(self) -> None:
        super().__post_init__()
        _at_least_one("alpha", self.alpha)

    def terms(self, image: Tensor) -> Tensor:
        pixels = image.flatten(1)
        centred = pixels - pixels.mean(dim=1, keepdim=True)
        return _power(centred, centred.square(), self.alpha)


@dataclass(frozen=True)
class Range(Prior):
    """Mean squared excess of gray values over 0…1: where the descriptor fixes the contrast, no image exceeds them."""

    def terms(self, image: Tensor) -> Tensor:
        pixels = image.flatten(1)
        return ((pixels - 0.5).abs() - 0.5).clamp(min=0) / math.sqrt(pixels.shape[1])
