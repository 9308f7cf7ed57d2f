"""CNN-HOG and CNN-HOGb: HOG as a convolutional network, inverted by gradient descent under natural-image priors.

Mahendran and Vedaldi, *Understanding Deep Image Representations by Inverting Them* (CVPR 2015).  The network's
descriptor is VLFeat's UoCTTI HOG in the interior, without its texture channels; what approximates HOG is the network's
derivative, and at the border the image continues in zeros, that is in middle gray.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from torch.nn import functional as F

from ..preimage import Reconstruction

RATES = (0.004, 0.0004, 0.00004, 0.000004)
"""Learning rates, one after the other."""
ITERATIONS = 200  # at each rate
MOMENTUM = 0.9
NORM_POWER = 6  # α of the prior Σxᵅ
NORM_WEIGHT = 8e-10  # λ_α
SMOOTHNESS = 1.0  # λ of total variation, the one of their quantitative experiments
SPREAD = 27098.1 / math.sqrt(227 * 227 * 3)
"""Root mean square of the noise that a search starts from, in gray levels of 255.

Their code gives noise the norm 27098.1 whatever the size of the image, a number meant for inputs of their convolutional
networks; here these are taken to be of 227x227 pixels and three channels, and the norm grows with the size.  As it is,
it would be 212 gray levels a pixel for an image of 128x128, from where their schedule diverges."""

_MIDDLE = 128.0  # what is subtracted from gray levels


@dataclass(frozen=True)
class CNNHOG:
    """The network and its inversion.

    Attributes:
        cell_size: pixels, even.
        orientations: undirected ones, n.
        bilinear: whether a gradient votes for the two nearest orientations by its angle to them (CNN-HOGb), with the
            derivative of these votes, or for the nearest one (CNN-HOG), with the derivative of its magnitude alone.
        smoothness: weight of the total variation; 1, 10 and 100 are published, 1 is that of the figures.

    Raises:
        ValueError: the cell size is odd or less than 2, there is no orientation, or the smoothness is negative.
    """

    cell_size: int = 8
    orientations: int = 9
    bilinear: bool = False
    smoothness: float = SMOOTHNESS

    def __post_init__(self) -> None:
        if self.cell_size < 2 or self.cell_size % 2:
            raise ValueError(f"the cell size must be an even number of pixels, got {self.cell_size}")
        if self.orientations < 1:
            raise ValueError(f"there must be at least one orientation, got {self.orientations}")
        if not 0 <= self.smoothness < math.inf:
            raise ValueError(f"smoothness must be a finite number of at least 0, got {self.smoothness}")

    @property
    def channels(self) -> int:
        """2n directed and n undirected orientations."""
        return 3 * self.orientations

    def descriptor(self, image: Tensor) -> Tensor:
        """The network's descriptor.

        Args:
            image: (B, 1, H, W), float in 0…1, H and W whole cells, at least two.

        Returns:
            (B, rows, cols, 3n) in 0…0.4, channels as in :func:`nablahog.presets.uoctti` without its texture: directed
            orientations from 0° (to the right), then undirected ones.  Differentiable by the network's own derivative.

        Raises:
            TypeError: the image is no floating-point tensor.
            ValueError: its shape is another, or it holds NaN or Inf.
        """
        if not isinstance(image, Tensor) or not image.is_floating_point():
            got = image.dtype if isinstance(image, Tensor) else type(image).__name__
            raise TypeError(f"the image must be a floating-point tensor, got {got}")
        if image.dim() != 4 or image.shape[1] != 1 or not len(image):
            raise ValueError(f"the image must have shape (B, 1, H, W), B at least 1, got {tuple(image.shape)}")
        self._check_size(*image.shape[2:])
        if not torch.isfinite(image).all():
            raise ValueError("the image must be finite, got NaN or Inf")
        return self._network(255 * image - _MIDDLE).permute(0, 2, 3, 1)

    def reconstruct(
        self,
        descriptor: Tensor,
        image_size: tuple[int, int] | None = None,
        *,
        seed: int = 0,
        progress: Callable[[int, int], None] | None = None,
    ) -> Reconstruction:
        """Images whose descriptor is near the given one, by 800 steps of gradient descent with momentum.

        Args:
            descriptor: (B, rows, cols, 3n), float32 or float64, of :meth:`descriptor`; texture channels, as VLFeat's
                have them after these, are left out.
            image_size: (height, width), whole cells; by default what the descriptor has.
            seed: of the noise that the search starts from, the same for every image of the batch.
            progress: called with the steps done and all of them.

        Returns:
            Images stretched to 0…1, and the distances of exactly these; one evaluation is a step.

        Raises:
            TypeError: the descriptor is no float32 or float64 tensor.
            ValueError: its shape is another, it holds NaN or Inf or nothing but zeros, or contradicts the image size.
        """
        began = time.perf_counter()
        height, width = self._check_descriptor(descriptor, image_size)
        wanted = descriptor.detach()[..., : self.channels].permute(0, 3, 1, 2)
        scale = wanted.flatten(1).norm(dim=1)
        if not (scale > 0).all():
            raise ValueError("the descriptor must not be zero: that of a constant image says nothing")
        generator = torch.Generator().manual_seed(seed)
        noise = torch.randn((1, 1, height, width), generator=generator, dtype=torch.float64)
        norm = SPREAD * math.sqrt(height * width)
        x = (noise * (norm / noise.norm())).to(descriptor).repeat(len(descriptor), 1, 1, 1)
        velocity, history = torch.zeros_like(x), []
        for step in range(ITERATIONS * len(RATES)):
            if step % ITERATIONS == 0:
                velocity.zero_()
            distance, slope = self._slope(x, wanted, scale, norm)
            history.append(distance)
            velocity = MOMENTUM * velocity - RATES[step // ITERATIONS] * slope
            x = x + velocity
            if progress is not None:
                progress(step + 1, ITERATIONS * len(RATES))
        image = _stretched(x)
        apart = self.descriptor(image).permute(0, 3, 1, 2) - wanted
        return Reconstruction(
            image,
            apart.flatten(1).norm(dim=1) / scale,
            ["the schedule of learning rates has ended"] * len(x),
            torch.stack(history),
            torch.full((len(x),), len(history)),
            time.perf_counter() - began,
        )

    def _slope(self, x: Tensor, wanted: Tensor, scale: Tensor, norm: float) -> tuple[Tensor, Tensor]:
        """Relative distances (B,) of x (B, 1, H, W), and the derivative of the objective times the squared norm σ²:

        ‖Φ(x) − Φ₀‖² / ‖Φ₀‖² + (λ_TV/2 · TV(x) + λ_α/2 · Σxᵅ) / σ².
        """
        x = x.detach().requires_grad_()
        squares = (self._network(x) - wanted).square().flatten(1).sum(dim=1)
        (of_data,) = torch.autograd.grad((squares / scale**2).sum(), x)
        x = x.detach()
        of_norm = NORM_WEIGHT / 2 * NORM_POWER * x ** (NORM_POWER - 1)
        return squares.detach().sqrt() / scale, norm**2 * of_data + self.smoothness / 2 * _variation(x) + of_norm

    def _network(self, x: Tensor) -> Tensor:
        """From gray levels (B, 1, H, W), less 128, to descriptors (B, 3n, rows, cols)."""
        n, cell = self.orientations, self.cell_size
        directed = 2 * n
        angles = torch.arange(directed, dtype=torch.float64) * (math.pi / n)
        across = torch.tensor([[0, 0, 0], [-0.5, 0, 0.5], [0, 0, 0]], dtype=torch.float64)
        steered = angles.cos().reshape(-1, 1, 1, 1) * across + angles.sin().reshape(-1, 1, 1, 1) * across.T
        responses = F.conv2d(x, steered.float().to(x), padding=1)  # rounded as theirs, so that 80° and 100° tie
        votes: Tensor = (_Bilinear if self.bilinear else _Nearest).apply(responses)  # type: ignore[no-untyped-call]
        ramp = 1 - (torch.arange(2 * cell, dtype=torch.float64) - (cell - 0.5)).abs() / cell
        tent = torch.outer(ramp, ramp).expand(directed, 1, -1, -1)
        histograms = F.conv2d(votes, tent.to(x), stride=cell, padding=cell // 2, groups=directed)
        undirected = histograms[:, :n] + histograms[:, n:]
        cells = torch.cat([histograms, undirected], dim=1)
        energy = 4 * F.avg_pool2d(undirected.square().sum(dim=1, keepdim=True), 2, stride=1)
        inverse = F.pad(energy.clamp(min=1e-12).rsqrt(), (1, 1, 1, 1))  # no block beyond the border
        rows, cols = cells.shape[2:]
        blocks = (inverse[:, :, i : i + rows, j : j + cols] for i in (0, 1) for j in (0, 1))
        return 0.5 * sum(((cells * block).clamp(max=0.2) for block in blocks), torch.zeros_like(cells))

    def _check_size(self, height: int, width: int) -> None:
        cell = self.cell_size
        if height % cell or width % cell or min(height, width) < 2 * cell:
            raise ValueError(
                f"the image must have whole cells of {cell} pixels, at least two each way, got {height}x{width} pixels"
            )

    def _check_descriptor(self, descriptor: Tensor, image_size: tuple[int, int] | None) -> tuple[int, int]:
        if not isinstance(descriptor, Tensor) or descriptor.dtype not in (torch.float32, torch.float64):
            got = descriptor.dtype if isinstance(descriptor, Tensor) else type(descriptor).__name__
            raise TypeError(f"the descriptor must be a float32 or float64 tensor, got {got}")
        allowed = (self.channels, self.channels + 4)
        if descriptor.dim() != 4 or not len(descriptor) or descriptor.shape[3] not in allowed:
            raise ValueError(
                f"the descriptor must have shape (B, rows, cols, {self.channels}), or {self.channels + 4} channels "
                f"with texture, B at least 1, got {tuple(descriptor.shape)}"
            )
        size = (descriptor.shape[1] * self.cell_size, descriptor.shape[2] * self.cell_size)
        if image_size is not None and tuple(image_size) != size:
            raise ValueError(
                f"the descriptor is of an image of {size[0]}x{size[1]} pixels, got image size {image_size}"
            )
        self._check_size(*size)
        if not torch.isfinite(descriptor).all():
            raise ValueError("the descriptor must be finite, got NaN or Inf")
        return size


class _Nearest(torch.autograd.Function):
    """Each gradient's magnitude at the orientation of the largest response; the derivative is that of the magnitude."""

    @staticmethod
    def forward(ctx: Any, responses: Tensor) -> Tensor:
        magnitude = _magnitude(responses)
        nearest = responses.argmax(dim=1, keepdim=True)
        ctx.save_for_backward(responses, magnitude, nearest)
        return torch.zeros_like(responses).scatter_(1, nearest, magnitude)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> Tensor:
        responses, magnitude, nearest = ctx.saved_tensors
        return grads[0].gather(1, nearest) * _slope_of(responses, magnitude)


class _Bilinear(torch.autograd.Function):
    """Each gradient's magnitude, shared by its angle to each orientation: 1 - n/π · angle where that is positive."""

    @staticmethod
    def forward(ctx: Any, responses: Tensor) -> Tensor:
        n, magnitude = responses.shape[1] // 2, _magnitude(responses)
        cosine = (responses / magnitude.clamp(min=1e-10)).clamp(-1, 1)
        shares = (1 - n / math.pi * cosine.acos()).clamp(min=0)
        ctx.save_for_backward(responses, magnitude, cosine, shares)
        return magnitude * shares

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> Tensor:
        responses, magnitude, cosine, shares = ctx.saved_tensors
        n = responses.shape[1] // 2
        # 1e-7 keeps the derivative finite where a gradient points along an orientation, as in the authors' code
        by_cosine = grads[0] * (shares > 0) * (n / math.pi) / (1.0000001 - cosine.square()).sqrt()
        # the share's own derivative, times the magnitude: d(r/m) = dr/m - r/m² dm and dm = Σ r dr / (n m)
        along = (by_cosine * cosine).sum(dim=1, keepdim=True)
        by_magnitude = (grads[0] * shares).sum(dim=1, keepdim=True)
        slope: Tensor = by_cosine * (magnitude > 0) + (by_magnitude - along) * _slope_of(responses, magnitude)
        return slope


def _magnitude(responses: Tensor) -> Tensor:
    """Of the gradient, (B, 1, H, W): the squared responses of 2n orientations sum to n times its square."""
    return (responses.square().sum(dim=1, keepdim=True) / (responses.shape[1] // 2)).sqrt()


def _slope_of(responses: Tensor, magnitude: Tensor) -> Tensor:
    """The magnitude's derivative by the responses; 0 where there is no gradient."""
    slope: Tensor = responses / (responses.shape[1] // 2) / magnitude.clamp(min=1e-10)
    return slope


def _variation(x: Tensor) -> Tensor:
    """Derivative of the total variation Σ dx² + dy² of x (B, 1, H, W), without differences across the border."""
    across, down = x.diff(dim=3), x.diff(dim=2)
    return 2 * (F.pad(across, (1, 0)) - F.pad(across, (0, 1)) + F.pad(down, (0, 0, 1, 0)) - F.pad(down, (0, 0, 0, 1)))


def _stretched(x: Tensor) -> Tensor:
    """Images from their own least value to their largest, brought to 0…1; a constant one to 0.5."""
    low, high = x.flatten(1).aminmax(dim=1)
    low, spread = (one.reshape(-1, 1, 1, 1) for one in (low, high - low))
    return torch.where(spread > 0, (x - low) / torch.where(spread > 0, spread, 1), 0.5)
