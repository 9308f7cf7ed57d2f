"""The network of a prior for signed descriptors: from a descriptor to the image that most likely had it.

Its inputs are the descriptor, the histograms recovered from it (:mod:`.histograms`), and the image that these integrate
to (:mod:`.start`).  It predicts a correction of that image.  Images are normalised to about unit variance.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from ..hog.channels import mirrored
from ..hog.normalizers import Footprint
from ..hog.spec import HOGSpec
from .histograms import recover_histograms
from .prior_network import Architecture, Prediction, PriorNetwork, ResidualBlock, set_to_zero
from .start import integrate, mean_gradient

CELLS = (2, 4, 8, 16)  # sides of cells in pixels, powers of two
HISTOGRAM_EVALUATIONS = 60  # of the recovery; enough for a network, the search uses more
FLAT = 0.01  # standard deviation, in 0…1, below which an image counts as flat
_DESCRIPTOR, _VOTES = 5.0, 3.84  # scale entries of a four-block descriptor, and votes of a pixel, to about 1


def _check_dialect(spec: HOGSpec) -> None:
    footprints = [spec.normalizer.footprint(axis) for axis in (0, 1)]
    if any(along.margin for along in footprints) or not spec.normalizer.keeps_directions:
        raise ValueError(
            f"a prior can be learned for descriptors with directed channels of all cells only, unlike {spec.name}"
        )
    if footprints != [Footprint()] * 2 or not spec.pooling.interpolates:
        raise ValueError(f"a prior can be learned for descriptors of single cells only, unlike {spec.name}")
    height, width = spec.cell_size
    if height != width or height not in CELLS:
        raise ValueError(
            f"a prior can be learned for square cells of {', '.join(map(str, CELLS))} pixels only, got {height}x{width}"
        )


@dataclass(frozen=True)
class Inputs:
    """Inputs of the network for descriptors of images of H x W pixels, which R x C cells of c pixels cover.

    Attributes:
        cells: (B, channels, R, C).
        integral: (B, 1, R · c, C · c), the image of the histograms, with zero mean and unit variance.
        votes: (B, bins, rows, cols), the recovered histograms.
    """

    cells: Tensor
    integral: Tensor
    votes: Tensor


@torch.no_grad()
def network_inputs(descriptor: Tensor, spec: HOGSpec, height: int, width: int) -> Inputs:
    """Inputs for descriptors (B, rows, cols, channels), float32, of images of ``height`` x ``width`` pixels."""
    cell = spec.cell_size[0]
    votes = recover_histograms(descriptor, spec, (height, width), max_evaluations=HISTOGRAM_EVALUATIONS)
    integral = integrate(*mean_gradient(votes, spec, height, width))
    contrast = integral.std(dim=(2, 3), keepdim=True, correction=0).clamp(min=FLAT * spec.value_range)
    integral = padded((integral - integral.mean(dim=(2, 3), keepdim=True)) / contrast, height, width, cell)
    rows, cols = (n // cell for n in integral.shape[2:])
    entries = scaled_entries(descriptor, spec)
    pixel_votes = torch.asinh(votes / contrast * (_VOTES / cell**2))
    per_cell = padded(torch.cat([entries, pixel_votes], dim=1), rows, cols, 1)
    return Inputs(torch.cat([per_cell, functional.pixel_unshuffle(integral, cell)], dim=1), integral, votes)


def scaled_entries(descriptor: Tensor, spec: HOGSpec) -> Tensor:
    """Entries of descriptors (B, rows, cols, channels) as (B, channels, rows, cols), of a size of about 1."""
    entries = descriptor.permute(0, 3, 1, 2)
    if spec.normalizer.bounded:
        return entries * _DESCRIPTOR
    size = entries.square().mean(dim=(1, 2, 3), keepdim=True).sqrt()  # else their scale is arbitrary
    return entries / torch.where(size > 0, size, 1)


def padded(x: Tensor, height: int, width: int, multiple: int) -> Tensor:
    """``x`` padded by its last rows and columns to the next multiples of ``multiple`` from ``height`` and ``width``."""
    bottom, right = (-(-n // multiple) * multiple - size for n, size in zip((height, width), x.shape[2:], strict=True))
    return functional.pad(x, (0, right, 0, bottom), mode="replicate") if bottom or right else x


class SignedNetwork(PriorNetwork):
    """From :class:`Inputs` to images (B, 1, R · c, C · c); before training, the integrals.

    Residual blocks at the resolution of cells, and after each doubling (a 1x1 convolution to four pixels of each).
    """

    def __init__(self, spec: HOGSpec, architecture: Architecture) -> None:
        super().__init__()
        widths = architecture.widths
        self.gain = nn.Parameter(torch.ones(1))
        self.inp = nn.Conv2d(spec.channels + spec.bins + spec.cell_size[0] ** 2, widths[0], 3, padding=1)
        body: list[nn.Module] = []
        for level, (width, blocks) in enumerate(zip(widths, architecture.blocks, strict=True)):
            body += [ResidualBlock(width) for _ in range(blocks)]
            if level + 1 < len(widths):
                body += [nn.Conv2d(width, 4 * widths[level + 1], 1), nn.PixelShuffle(2)]
        self.body = nn.Sequential(*body)
        self.out = nn.Conv2d(widths[-1], 1, 3, padding=1)
        set_to_zero(self.out)

    @classmethod
    def default_architecture(cls, spec: HOGSpec) -> Architecture:
        """5.9 million weights for UoCTTI with cells of 8."""
        _check_dialect(spec)
        doublings = spec.cell_size[0].bit_length() - 1
        return Architecture((192, *(64 >> k for k in range(doublings))), (8, 4, 2, 1, 1)[: doublings + 1])

    @classmethod
    def check(cls, spec: HOGSpec, architecture: Architecture) -> None:
        _check_dialect(spec)
        side, resolutions = spec.cell_size[0], len(architecture.widths)
        if 2 ** (resolutions - 1) != side:
            raise ValueError(f"{resolutions} resolutions do not lead from cells of {side} pixels to pixels")

    def predict(self, descriptor: Tensor, spec: HOGSpec, size: tuple[int, int]) -> Prediction:
        """Where the descriptor determines that of the mirrored image, the mean of both predictions."""
        height, width = size
        inputs = network_inputs(descriptor, spec, height, width)
        image: Tensor = self(inputs.cells, inputs.integral)[..., :height, :width]
        mirrored_descriptor = mirrored(descriptor, spec, width)
        if mirrored_descriptor is not None:
            mirror_inputs = network_inputs(mirrored_descriptor, spec, height, width)
            other: Tensor = self(mirror_inputs.cells, mirror_inputs.integral)[..., :height, :width]
            image = (image + other.flip(3)) / 2
        return Prediction(image, inputs.votes)

    def forward(self, cells: Tensor, integral: Tensor) -> Tensor:
        """Images of about zero mean and unit variance."""
        correction: Tensor = self.out(self.body(self.inp(cells)))
        return self.gain * integral + correction
