"""CNN-HOG and CNN-HOGb: HOG as a convolutional network, inverted by gradient descent under natural-image priors.

Mahendran and Vedaldi, *Understanding Deep Image Representations by Inverting Them* (CVPR 2015).  In the interior the
network's descriptor is VLFeat's UoCTTI HOG without texture channels.  Its derivative is an approximation.  Beyond the
border the image is zero, which is middle gray.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from torch.nn import functional as F

from ...invert.reconstruction import Reconstruction

LEARNING_RATES = (0.004, 0.0004, 0.00004, 0.000004)  # in this order
RATE_ITERATIONS = 200  # at each rate
MOMENTUM = 0.9
NORM_POWER = 6  # α of the prior Σxᵅ
NORM_WEIGHT = 8e-10  # λ_α
SMOOTHNESS = 1.0  # λ of total variation, as in their quantitative experiments; 10 and 100 are published, too
NOISE = 27098.1 / math.sqrt(227 * 227 * 3)
"""Root mean square of the initial noise, in gray levels of 255.

Their noise has the norm 27098.1 for any image.  Here that is the norm for 227x227 pixels and three channels, the inputs
of their networks, and grows with the size: for 128x128 pixels their schedule would diverge from 212 gray levels."""

_MIDDLE = 128.0  # subtracted from gray levels


@dataclass(frozen=True)
class CNNHOG:
    """The network, of cells of an even number of pixels and n undirected orientations, and its inversion.

    ``bilinear`` says whether a gradient votes for the two nearest orientations by its angle to them (CNN-HOGb), or for
    the nearest one, with the derivative of its magnitude alone (CNN-HOG).
    """

    cell_size: int = 8
    orientations: int = 9
    bilinear: bool = False

    def descriptor(self, image: Tensor) -> Tensor:
        """The network's descriptor (B, rows, cols, 3n), in 0…0.4, of images (B, 1, H, W) of whole cells, in 0…1.

        Channels are those of :func:`nablahog.presets.uoctti` without its texture: directed orientations from 0° (to the
        right), then undirected ones.  Differentiable by the network's own derivative.

        Raises:
            ValueError: the sides of the image are not whole cells, at least two each way.
        """
        (height, width), cell = image.shape[2:], self.cell_size
        if height % cell or width % cell or min(height, width) < 2 * cell:
            raise ValueError(
                f"the image must have whole cells of {cell} pixels, at least two each way, got {height}x{width} pixels"
            )
        return self._network(255 * image - _MIDDLE).permute(0, 2, 3, 1)

    def reconstruct(self, descriptor: Tensor, *, seed: int = 0) -> Reconstruction:
        """Images with nearly this descriptor of :meth:`descriptor`, by 800 steps of gradient descent with momentum.

        They are stretched to 0…1, and distances are those of the stretched images.  One evaluation is a step.  The
        initial noise is the same for every image of the batch.

        Raises:
            ValueError: the descriptor is zero.
        """
        began = time.perf_counter()
        height, width = (side * self.cell_size for side in descriptor.shape[1:3])
        target = descriptor.detach().permute(0, 3, 1, 2)
        scale = target.flatten(1).norm(dim=1)
        if not (scale > 0).all():
            raise ValueError("the descriptor must not be zero, as that of a constant image is")
        generator = torch.Generator().manual_seed(seed)
        noise = torch.randn((1, 1, height, width), generator=generator, dtype=torch.float64)
        norm = NOISE * math.sqrt(height * width)
        x = (noise * (norm / noise.norm())).to(descriptor).repeat(len(descriptor), 1, 1, 1)
        velocity, history = torch.zeros_like(x), []
        for step in range(RATE_ITERATIONS * len(LEARNING_RATES)):
            if step % RATE_ITERATIONS == 0:
                velocity.zero_()
            distance, gradient = self._gradient(x, target, scale, norm)
            history.append(distance)
            velocity = MOMENTUM * velocity - LEARNING_RATES[step // RATE_ITERATIONS] * gradient
            x = x + velocity
        image = _stretch(x)
        residual = self.descriptor(image).permute(0, 3, 1, 2) - target
        return Reconstruction(
            image,
            residual.flatten(1).norm(dim=1) / scale,
            ["the schedule of learning rates has ended"] * len(x),
            torch.stack(history),
            torch.full((len(x),), len(history)),
            time.perf_counter() - began,
        )

    def _gradient(self, x: Tensor, target: Tensor, scale: Tensor, norm: float) -> tuple[Tensor, Tensor]:
        """Relative distances (B,) of x (B, 1, H, W), and σ² times the gradient of the objective, σ being the norm:

        ‖Φ(x) − Φ₀‖² / ‖Φ₀‖² + (λ_TV/2 · TV(x) + λ_α/2 · Σxᵅ) / σ².
        """
        x = x.detach().requires_grad_()
        squares = (self._network(x) - target).square().flatten(1).sum(dim=1)
        (data_gradient,) = torch.autograd.grad((squares / scale**2).sum(), x)
        x = x.detach()
        norm_gradient = NORM_WEIGHT / 2 * NORM_POWER * x ** (NORM_POWER - 1)
        return (
            squares.detach().sqrt() / scale,
            norm**2 * data_gradient + SMOOTHNESS / 2 * _total_variation_gradient(x) + norm_gradient,
        )

    def _network(self, x: Tensor) -> Tensor:
        """Descriptors (B, 3n, rows, cols) of gray levels minus 128, (B, 1, H, W)."""
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


class _Nearest(torch.autograd.Function):
    """Magnitude of the gradient at the orientation of the largest response; the derivative is that of the magnitude."""

    @staticmethod
    def forward(ctx: Any, responses: Tensor) -> Tensor:
        magnitude = _magnitude(responses)
        nearest = responses.argmax(dim=1, keepdim=True)
        ctx.save_for_backward(responses, magnitude, nearest)
        return torch.zeros_like(responses).scatter_(1, nearest, magnitude)

    @staticmethod
    def backward(ctx: Any, *grad_outputs: Tensor) -> Tensor:
        responses, magnitude, nearest = ctx.saved_tensors
        return grad_outputs[0].gather(1, nearest) * _magnitude_gradient(responses, magnitude)


class _Bilinear(torch.autograd.Function):
    """Magnitude of the gradient times its weight for each orientation: max(0, 1 - n/π · angle)."""

    @staticmethod
    def forward(ctx: Any, responses: Tensor) -> Tensor:
        n, magnitude = responses.shape[1] // 2, _magnitude(responses)
        cosine = (responses / magnitude.clamp(min=1e-10)).clamp(-1, 1)
        weights = (1 - n / math.pi * cosine.acos()).clamp(min=0)
        ctx.save_for_backward(responses, magnitude, cosine, weights)
        return magnitude * weights

    @staticmethod
    def backward(ctx: Any, *grad_outputs: Tensor) -> Tensor:
        responses, magnitude, cosine, weights = ctx.saved_tensors
        n = responses.shape[1] // 2
        # 1e-7 keeps the derivative finite where a gradient points along an orientation, as in the authors' code
        grad_cosine = grad_outputs[0] * (weights > 0) * (n / math.pi) / (1.0000001 - cosine.square()).sqrt()
        # derivative of the weight, times the magnitude: d(r/m) = dr/m - r/m² dm and dm = Σ r dr / (n m)
        projection = (grad_cosine * cosine).sum(dim=1, keepdim=True)
        grad_magnitude = (grad_outputs[0] * weights).sum(dim=1, keepdim=True)
        slope = _magnitude_gradient(responses, magnitude)
        grad_input: Tensor = grad_cosine * (magnitude > 0) + (grad_magnitude - projection) * slope
        return grad_input


def _magnitude(responses: Tensor) -> Tensor:
    """Magnitude (B, 1, H, W) of the gradient: the squared responses of 2n orientations sum to n times its square."""
    return (responses.square().sum(dim=1, keepdim=True) / (responses.shape[1] // 2)).sqrt()


def _magnitude_gradient(responses: Tensor, magnitude: Tensor) -> Tensor:
    """Derivative of the magnitude with respect to the responses; 0 where the magnitude is 0."""
    gradient: Tensor = responses / (responses.shape[1] // 2) / magnitude.clamp(min=1e-10)
    return gradient


def _total_variation_gradient(x: Tensor) -> Tensor:
    """Gradient of the total variation Σ dx² + dy² of x (B, 1, H, W), without differences across the border."""
    across, down = x.diff(dim=3), x.diff(dim=2)
    return 2 * (F.pad(across, (1, 0)) - F.pad(across, (0, 1)) + F.pad(down, (0, 0, 1, 0)) - F.pad(down, (0, 0, 0, 1)))


def _stretch(x: Tensor) -> Tensor:
    """Images scaled from their least … largest value to 0…1; a constant one becomes 0.5."""
    low, high = x.flatten(1).aminmax(dim=1)
    low, spread = (one.reshape(-1, 1, 1, 1) for one in (low, high - low))
    return torch.where(spread > 0, (x - low) / torch.where(spread > 0, spread, 1), 0.5)
