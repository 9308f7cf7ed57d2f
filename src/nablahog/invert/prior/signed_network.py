"""Networks of learned priors: what they share, and the network for signed descriptors.

The latter maps the histograms of cells to the expected image.  Its inputs are the histograms recovered from a
descriptor, their UoCTTI descriptor, and the image that they integrate to (:mod:`.histograms`), to which it predicts a
correction.  Images are enlarged or shrunk to cells of :data:`CELL_PIXELS` pixels, since the statistics of photographs
hardly depend on scale.  They are normalised by the variance among the cells around each pixel, as many as the network
was trained on (:data:`TRAINING_CELLS` along a side), and by the mean among four times as many: beside a mountain a sky
has little contrast, and would get the mountain's noise.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d, gelu, interpolate, pad, pixel_shuffle, pixel_unshuffle

from ...hog import presets
from ...hog.spec import HOGSpec
from ...hog.steps import normalize_reference
from ..histograms import rebin_cells, set_nominal_contrast
from ..starts import integrate, mean_gradient

CHANNEL_MOMENTUM = 0.02  # of the running means and variances of channels

CELL_PIXELS = 8  # pixels of a cell in the network's images, along each axis
TRAINING_CELLS = 16  # cells along a side of most images in training
PIXELS_PER_OUTPUT = 2  # pixels of these images, along each axis, per pixel at the network's last resolution
SIGNED_BINS = 18  # of 20° each
INPUT_SPEC = presets.uoctti(CELL_PIXELS)  # of its inputs
FLAT_STD = 0.01 * INPUT_SPEC.value_range  # standard deviation below which an image counts as flat
_ENTRY_FACTOR, _VOTE_FACTOR = 5.0, 3.84  # factors that scale descriptor entries and votes per pixel to about 1
_INPUT_CHANNELS = SIGNED_BINS + INPUT_SPEC.channels + CELL_PIXELS**2


@dataclass(frozen=True)
class Architecture:
    """Sizes of a network, an entry for each of its resolutions.

    The first resolution is that of cells.  Each further one is twice as fine for signed descriptors, down to two
    pixels, and half as fine for unsigned ones.

    Attributes:
        widths: channels, 1 … 1024.
        blocks: residual blocks, 0 … 64.

    Raises:
        ValueError: they are out of their range, or not of the same length.
    """

    widths: tuple[int, ...]
    blocks: tuple[int, ...]

    def __post_init__(self) -> None:
        if not self.widths or len(self.widths) != len(self.blocks):
            raise ValueError(f"expected as many widths as blocks, at least one, got {self.widths} and {self.blocks}")
        for name, numbers, least, most in (("widths", self.widths, 1, 1024), ("blocks", self.blocks, 0, 64)):
            if not all(type(n) is int and least <= n <= most for n in numbers):
                raise ValueError(f"{name} must be integers in {least}…{most}, got {numbers}")


class PriorNetwork(nn.Module, ABC):
    """A network from descriptors to images, made from an :class:`Architecture`."""

    KIND: ClassVar[str]  # of its descriptors
    DEFAULT: ClassVar[Architecture]

    @abstractmethod
    def __init__(self, architecture: Architecture) -> None:
        super().__init__()

    @classmethod
    def check(cls, architecture: Architecture) -> None:
        """Raises ValueError unless the network can have this architecture."""
        resolutions = len(cls.DEFAULT.widths)
        if len(architecture.widths) != resolutions:
            raise ValueError(f"a prior for {cls.KIND} descriptors has {resolutions} widths, got {architecture.widths}")

    @staticmethod
    @abstractmethod
    def rebin(histograms: Tensor, spec: HOGSpec, size: tuple[int, int]) -> Tensor:
        """Histograms (B, colours · bins, rows, cols) of images (height, width) in the bins of the network."""

    @staticmethod
    @abstractmethod
    def mirror(histograms: Tensor) -> Tensor:
        """The network's histograms of the images flipped from left to right."""

    @abstractmethod
    def predict(self, histograms: Tensor, spec: HOGSpec, size: tuple[int, int]) -> Tensor:
        """Images (B, 1, H, W) of any contrast for histograms (B, colours · bins, rows, cols), float32.

        ``spec`` is one of :func:`.histograms.linear_vote_spec`.
        """


class ResidualBlock(nn.Module):
    """x plus a correction, 0 before training; in training, with a share ``dropout`` of channels dropped."""

    def __init__(self, width: int, dropout: float = 0.0) -> None:
        super().__init__()
        self.a, self.b = (nn.Conv2d(width, width, 3, padding=1) for _ in range(2))
        self.normalise_a, self.normalise_b = (nn.BatchNorm2d(width, momentum=CHANNEL_MOMENTUM) for _ in range(2))
        self.dropout = nn.Dropout2d(dropout)
        set_to_zero(self.b)

    def forward(self, x: Tensor) -> Tensor:
        correction: Tensor = self.b(self.dropout(gelu(self.normalise_b(self.a(gelu(self.normalise_a(x)))))))
        return x + correction


def set_to_zero(layer: nn.Module) -> None:
    """Sets its weights to 0, before training."""
    for weights in layer.parameters():
        nn.init.zeros_(weights)


class NetworkInputs(NamedTuple):
    """What the network for signed descriptors sees, and what its answer has to be multiplied by and added to."""

    cells: Tensor
    """(B, 18 + 31 + 64, R, C): the histograms, their descriptor, and the pixels of the integral."""
    integral: Tensor
    """(B, 1, 8R, 8C): the image of the histograms, normalised."""
    contrast: Tensor
    """(B, 1, R, C): what it was divided by."""
    mean: Tensor
    """(B, 1, R, C): what was subtracted from it before."""


@torch.no_grad()
def network_inputs(histograms: Tensor) -> NetworkInputs:
    """The inputs for histograms (B, 18, R, C) of :meth:`SignedNetwork.rebin`, of any scale."""
    size = CELL_PIXELS * histograms.shape[2], CELL_PIXELS * histograms.shape[3]
    histograms = set_nominal_contrast(histograms, INPUT_SPEC, size)
    integral = integrate(*mean_gradient(histograms, INPUT_SPEC, *size))
    variance = _average_around(integral.square(), TRAINING_CELLS) - _average_around(integral, TRAINING_CELLS).square()
    mean, contrast = _average_around(integral, 2 * TRAINING_CELLS), variance.clamp(min=FLAT_STD**2).sqrt()
    integral = (integral - _interpolate_cells(mean)) / _interpolate_cells(contrast)
    pixel_votes = torch.asinh(histograms / contrast * (_VOTE_FACTOR / CELL_PIXELS**2))
    entries = normalize_reference(histograms, INPUT_SPEC) * _ENTRY_FACTOR
    cells = torch.cat([pixel_votes, entries, pixel_unshuffle(integral, CELL_PIXELS)], dim=1)
    return NetworkInputs(cells, integral, contrast, mean)


def _average_around(images: Tensor, side: int) -> Tensor:
    """The mean of images (B, 1, 8R, 8C) over the square of ``side`` cells around each cell, (B, 1, R, C).

    Of smaller images it is the mean of the whole; near the border it is that of the outermost such square.
    """
    cells = avg_pool2d(images, CELL_PIXELS)
    rows, cols = (min(side, n) for n in cells.shape[2:])
    means = avg_pool2d(cells, (rows, cols), stride=1)
    left, right, top, bottom = (cols - 1) // 2, cols // 2, (rows - 1) // 2, rows // 2
    return pad(means, (left, right, top, bottom), mode="replicate")


def _interpolate_cells(cells: Tensor) -> Tensor:
    """Values of cells (B, 1, R, C), interpolated at their pixels, (B, 1, 8R, 8C)."""
    return interpolate(cells, scale_factor=CELL_PIXELS, mode="bilinear", align_corners=False)


class SignedNetwork(PriorNetwork):
    """From :func:`network_inputs` to images (B, 1, 8R, 8C); before training, the integrals.

    Residual blocks at the resolution of cells and after each of two doublings, which are 1x1 convolutions from one
    pixel to four; a last doubling gives pixels.  2.2 million weights by default.
    """

    KIND = "signed"
    DEFAULT = Architecture((128, 64, 32), (5, 6, 3))

    def __init__(self, architecture: Architecture) -> None:
        super().__init__(architecture)
        widths = architecture.widths
        self.gain = nn.Parameter(torch.ones(1))
        self.inp = nn.Conv2d(_INPUT_CHANNELS, widths[0], 3, padding=1)
        body: list[nn.Module] = []
        for level, (width, blocks) in enumerate(zip(widths, architecture.blocks, strict=True)):
            body += [ResidualBlock(width) for _ in range(blocks)]
            if level + 1 < len(widths):
                body += [nn.Conv2d(width, 4 * widths[level + 1], 1), nn.PixelShuffle(2)]
        self.body = nn.Sequential(*body)
        self.out = nn.Conv2d(widths[-1], PIXELS_PER_OUTPUT**2, 3, padding=1)
        set_to_zero(self.out)

    @staticmethod
    def rebin(histograms: Tensor, spec: HOGSpec, size: tuple[int, int]) -> Tensor:
        """(B, 18, R, C), bins centred at 0°, 20°, …"""
        return rebin_cells(histograms, spec, size, SIGNED_BINS, 0.0, 2 * math.pi)

    @staticmethod
    def mirror(histograms: Tensor) -> Tensor:
        """θ becomes π - θ."""
        return histograms[:, [(SIGNED_BINS // 2 - k) % SIGNED_BINS for k in range(SIGNED_BINS)]].flip(3)

    def predict(self, histograms: Tensor, spec: HOGSpec, size: tuple[int, int]) -> Tensor:
        """The mean of the predictions for the image and for its mirror image."""
        cells = self.rebin(histograms, spec, size)
        images = (self._image(cells) + self._image(self.mirror(cells)).flip(3)) / 2
        return _resize(images, spec.cell_size, size)

    def _image(self, histograms: Tensor) -> Tensor:
        inputs = network_inputs(histograms)
        normalised: Tensor = self(inputs.cells, inputs.integral)
        return normalised * _interpolate_cells(inputs.contrast) + _interpolate_cells(inputs.mean)

    def forward(self, cells: Tensor, integral: Tensor) -> Tensor:
        """Images of about zero mean and unit variance."""
        correction: Tensor = self.out(self.body(self.inp(cells)))
        return self.gain * integral + pixel_shuffle(correction.float(), PIXELS_PER_OUTPUT)


def _resize(images: Tensor, cell_size: tuple[int, int], size: tuple[int, int]) -> Tensor:
    """Images of cells of :data:`CELL_PIXELS` pixels to images (height, width) of cells of ``cell_size``.

    Pixels beyond the last cell repeat the last row or column.
    """
    whole = [n // CELL_PIXELS * side for n, side in zip(images.shape[2:], cell_size, strict=True)]
    if list(images.shape[2:]) != whole:
        images = interpolate(images, size=whole, mode="bicubic", align_corners=False, antialias=True)
    height, width = size
    images = images[..., :height, :width]
    bottom, right = height - images.shape[2], width - images.shape[3]
    return pad(images, (0, right, 0, bottom), mode="replicate") if bottom or right else images
