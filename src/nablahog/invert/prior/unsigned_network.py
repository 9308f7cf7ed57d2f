"""The network of a prior for unsigned descriptors: from the histograms of cells to a coarse image.

An unsigned histogram does not tell which side of an edge is the brighter one.  The statistics of photographs often do:
backgrounds are even, the sky is bright and above, objects have parts.  So the network sees the whole image at once, in
cells so large that they are at most :data:`MAX_FIRST_CELLS` along a side, and predicts a coarse image, two pixels a
cell along each axis.  Then it sees cells half as large together with that image, and so on until they are the
descriptor's.  The details come from the descriptor.

That image is one up to its sign.  A second part, the polarity, predicts the probability that an image is the photograph
and not its negative.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn.functional import adaptive_avg_pool2d, gelu, interpolate, pixel_shuffle, pixel_unshuffle

from ...hog.spec import HOGSpec
from ..histograms import rebin_cells
from .signed_network import Architecture, PriorNetwork, ResidualBlock, set_to_zero

UNSIGNED_BINS = 9  # of 20° each
PIXELS_PER_CELL = 2  # pixels of the prediction per cell, along each axis
CONTRAST = 4.0  # of histograms, relative to their mean, before the logarithm
MAX_FIRST_CELLS = 20  # rows or columns that are seen at first
MAX_LAST_CELLS = 64  # rows or columns that are seen at last, at most
COARSEST = 4  # cells for a pixel at the network's coarsest resolution, along each axis
LEAST_CELLS = 2 * COARSEST
WHOLE_PARTS = 4  # parts along each axis, for the layers over the whole image
WHOLE_CHANNELS, WHOLE_UNITS = 64, 256  # channels of each part, and units for all of them
DROPOUT = 0.1  # share of channels and units dropped in training, in the layers over the whole image
SAMPLE_DROPOUT = 0.3  # the same share for samples: the best of eight is better than with 0.1, and as good as with 0.5
POLARITY_WIDTHS = (48, 96, 128)
FLAT_UNIT_STD = 1e-6  # standard deviation below which an image of unit contrast counts as flat


def compress(histograms: Tensor) -> Tensor:
    """Histograms of any scale, compressed: log(1 + 4 · votes / their mean over the image)."""
    mean = histograms.mean(dim=(1, 2, 3), keepdim=True)
    return torch.log1p(CONTRAST * histograms / torch.where(mean > 0, mean, 1))


def normalise(images: Tensor) -> Tensor:
    """Images (B, 1, H, W) of zero mean and unit variance; 0 where they are flat."""
    images = images - images.mean(dim=(2, 3), keepdim=True)
    contrast = images.std(dim=(2, 3), keepdim=True, correction=0)
    return torch.where(contrast > FLAT_UNIT_STD, images / contrast.clamp(min=FLAT_UNIT_STD), 0)


def align_sign(images: Tensor, references: Tensor) -> Tensor:
    """Images (B, 1, H, W), those negated that correlate negatively with the references."""
    return torch.where((images * references).sum(dim=(1, 2, 3), keepdim=True) < 0, -images, images)


class _WholeImage(nn.Module):
    """x plus a correction from the whole image, in 4x4 parts; 0 before training."""

    def __init__(self, width: int) -> None:
        super().__init__()
        size = WHOLE_CHANNELS * WHOLE_PARTS**2
        self.inp, self.out = nn.Conv2d(width, WHOLE_CHANNELS, 1), nn.Conv2d(WHOLE_CHANNELS, width, 1)
        self.a, self.b = nn.Linear(size, WHOLE_UNITS), nn.Linear(WHOLE_UNITS, size)
        self.dropout = nn.Dropout(DROPOUT)
        set_to_zero(self.out)

    def forward(self, x: Tensor) -> Tensor:
        parts = adaptive_avg_pool2d(self.inp(gelu(x)), WHOLE_PARTS)
        mixed = self.b(self.dropout(gelu(self.a(parts.flatten(1))))).view_as(parts)
        correction: Tensor = self.out(gelu(mixed))
        if correction.shape != x.shape:
            correction = interpolate(correction, size=x.shape[2:], mode="bilinear", align_corners=False)
        return x + correction


class _Polarity(nn.Module):
    """From histograms (B, 9, R, C) and images (B, 1, 2R, 2C) to log-odds (B,) that these are not negatives.

    It also sees the prediction up to its sign, with the sign of the images.  The log-odds are a function of both minus
    the same function of their negatives.
    """

    def __init__(self) -> None:
        super().__init__()
        first, second, third = POLARITY_WIDTHS
        self.body = nn.Sequential(
            nn.Conv2d(UNSIGNED_BINS + 2 * PIXELS_PER_CELL**2, first, 3, padding=1),
            ResidualBlock(first),
            nn.GELU(),
            nn.Conv2d(first, second, 2, stride=2),
            ResidualBlock(second),
            nn.GELU(),
            nn.Conv2d(second, third, 2, stride=2),
            ResidualBlock(third, DROPOUT),
            nn.GELU(),
            nn.AdaptiveAvgPool2d(WHOLE_PARTS),
            nn.Flatten(),
            nn.Linear(third * WHOLE_PARTS**2, 64),
            nn.GELU(),
            nn.Dropout(0.5),
        )
        self.out = nn.Linear(64, 1, bias=False)

    def forward(self, histograms: Tensor, regions: Tensor, images: Tensor) -> Tensor:
        pixels = pixel_unshuffle(torch.cat([align_sign(regions, images), images], dim=1), PIXELS_PER_CELL)
        pairs = torch.cat([torch.cat([compress(histograms), sign * pixels], dim=1) for sign in (1.0, -1.0)])
        positive, negative = self.body(pairs).chunk(2)  # in one batch, so that both are normalised alike
        odds: Tensor = self.out(positive - negative)
        return odds.squeeze(1).float()


class _Draw(nn.Module):
    """A layer of dropout whose random numbers are those of a generator of its own, not of all threads."""

    def __init__(self, layer: nn.Dropout | nn.Dropout2d, generator: torch.Generator) -> None:
        super().__init__()
        self.channels_only, self.generator = isinstance(layer, nn.Dropout2d), generator

    def forward(self, x: Tensor) -> Tensor:
        mask = torch.empty_like(x[:, :, :1, :1] if self.channels_only else x)
        mask.bernoulli_(1 - SAMPLE_DROPOUT, generator=self.generator).div_(1 - SAMPLE_DROPOUT)
        return x * mask


class LargestCells(NamedTuple):
    """Histograms (B, 9, R, C) of the cells seen first, and the prediction for them, (B, 1, 2R, 2C), up to its sign."""

    histograms: Tensor
    regions: Tensor


class UnsignedNetwork(PriorNetwork):
    """From histograms (B, 9, R, C) and coarser images (B, 1, 2R, 2C) to images of that size, up to their sign.

    A U-Net, down to a quarter of the grid and up again, and the polarity; 5.3 million weights by default.
    """

    KIND = "unsigned"
    DEFAULT = Architecture((64, 128, 256), (1, 2, 1))

    def __init__(self, architecture: Architecture) -> None:
        super().__init__(architecture)
        widths, last = architecture.widths, len(architecture.widths) - 1

        def blocks(level: int) -> nn.Sequential:
            share = DROPOUT if level == last else 0.0
            return nn.Sequential(*(ResidualBlock(widths[level], share) for _ in range(architecture.blocks[level])))

        self.inp = nn.Conv2d(UNSIGNED_BINS + PIXELS_PER_CELL**2, widths[0], 3, padding=1)
        self.down, self.up = (nn.ModuleList(blocks(level) for level in range(last + 1)) for _ in range(2))
        steps = list(pairwise(widths))
        self.shrink = nn.ModuleList(nn.Conv2d(fine, coarse, 2, stride=2) for fine, coarse in steps)
        self.enlarge = nn.ModuleList(nn.Conv2d(coarse, 4 * fine, 1) for fine, coarse in steps)
        self.whole = _WholeImage(widths[-1])
        self.out = nn.Conv2d(widths[0], PIXELS_PER_CELL**2, 3, padding=1)
        self.polarity = _Polarity()

    def forward(self, histograms: Tensor, coarser: Tensor) -> Tensor:
        """Images of about unit variance; the coarser ones of zero mean and unit variance, or 0."""
        x, skips = self.inp(torch.cat([compress(histograms), pixel_unshuffle(coarser, PIXELS_PER_CELL)], dim=1)), []
        for blocks, shrink in zip(self.down[:-1], self.shrink, strict=True):
            skips.append(blocks(x))
            x = shrink(gelu(skips[-1]))
        x = self.up[-1](self.whole(self.down[-1](x)))
        for level in range(len(skips) - 1, -1, -1):
            x = self.up[level](skips[level] + pixel_shuffle(self.enlarge[level](gelu(x)), 2))
        return pixel_shuffle(self.out(gelu(x)), PIXELS_PER_CELL).float()

    @staticmethod
    def rebin(histograms: Tensor, spec: HOGSpec, size: tuple[int, int]) -> Tensor:
        """(B, 9, R, C), bins centred at 10°, 30°, …; cells are square, R and C are multiples of :data:`COARSEST`."""
        tiling = rebin_cells(histograms, spec, size, UNSIGNED_BINS, 0.5, math.pi)
        height, width = (n * side for n, side in zip(tiling.shape[2:], spec.cell_size, strict=True))
        side = max(math.sqrt(spec.cell_size[0] * spec.cell_size[1]), max(height, width) / MAX_LAST_CELLS)
        return _resample(tiling, height / side, width / side)

    @staticmethod
    def mirror(histograms: Tensor) -> Tensor:
        """10° becomes 170°."""
        return histograms.flip(1, 3)

    def predict(self, histograms: Tensor, spec: HOGSpec, size: tuple[int, int]) -> Tensor:
        """The mean of the predictions for the image and for its mirror image; the likelier of it and its negative."""
        inputs = self.rebin(histograms, spec, size)
        largest = self.largest_cells(inputs)
        regions = self.predict_regions(inputs, largest)
        images = torch.where(self.log_odds(regions, largest).reshape(-1, 1, 1, 1) < 0, -regions, regions)
        return interpolate(images, size=size, mode="bicubic", align_corners=False)

    def draw(
        self,
        histograms: Tensor,
        spec: HOGSpec,
        size: tuple[int, int],
        count: int,
        seed: int,
        polarity: Callable[[Tensor], Tensor],
    ) -> Tensor:
        """Random possible images (B · count, 1, H, W), as :meth:`predict`.

        ``polarity`` makes probabilities of log-odds (count,).
        """
        images = []
        for cells in self.rebin(histograms, spec, size):
            generator = torch.Generator(cells.device).manual_seed(seed)
            network, inputs = self._with_dropout(generator), cells.expand(count, -1, -1, -1)
            largest = network.largest_cells(inputs)
            regions = network.predict_regions(inputs, largest)
            likely = polarity(self.log_odds(regions, largest))
            chances = torch.empty_like(likely).uniform_(generator=generator)
            is_positive = (chances < likely).reshape(-1, 1, 1, 1)
            images.append(torch.where(is_positive, regions, -regions))
        return interpolate(torch.cat(images), size=size, mode="bicubic", align_corners=False)

    def _with_dropout(self, generator: torch.Generator) -> UnsignedNetwork:
        """A network of the same weights that drops channels, others for each of a batch."""
        network = copy.deepcopy(self, {id(weight): weight for weight in self.parameters()})
        for name, layer in list(network.named_modules()):
            if isinstance(layer, nn.Dropout | nn.Dropout2d):
                network.set_submodule(name, _Draw(layer, generator))
        return network

    def largest_cells(self, histograms: Tensor) -> LargestCells:
        """What is seen at first, in cells so large that they are at most :data:`MAX_FIRST_CELLS` along a side."""
        while max(histograms.shape[2:]) > MAX_FIRST_CELLS:
            histograms = _enlarge_cells(histograms)
        nothing = histograms.new_zeros(
            len(histograms), 1, PIXELS_PER_CELL * histograms.shape[2], PIXELS_PER_CELL * histograms.shape[3]
        )
        return LargestCells(histograms, self._average_mirrored(histograms, nothing))

    def predict_regions(self, histograms: Tensor, largest: LargestCells) -> Tensor:
        """Images up to their sign (B, 1, 2R, 2C) for histograms (B, 9, R, C), given what was seen at first."""
        if max(histograms.shape[2:]) <= MAX_FIRST_CELLS:
            return largest.regions
        return self._average_mirrored(histograms, self.coarser(histograms, largest))

    def coarser(self, histograms: Tensor, largest: LargestCells) -> Tensor:
        """Images (B, 1, 2R, 2C) up to their sign, predicted for cells twice as large."""
        regions = normalise(self.predict_regions(_enlarge_cells(histograms), largest))
        size = (PIXELS_PER_CELL * histograms.shape[2], PIXELS_PER_CELL * histograms.shape[3])
        return interpolate(regions, size=size, mode="bilinear", align_corners=False)

    def _average_mirrored(self, histograms: Tensor, coarser: Tensor) -> Tensor:
        """The mean of the predictions for the image and for its mirror image, up to its sign."""
        regions: Tensor = self(histograms, coarser)
        mirrored: Tensor = self(self.mirror(histograms), coarser.flip(3))
        return (regions + align_sign(mirrored.flip(3), regions)) / 2

    def log_odds(self, images: Tensor, largest: LargestCells) -> Tensor:
        """Log-odds (B,) that images (B, 1, H, W) are not negatives: the mean over image and mirror image.

        They are 0 for flat images, which are their own negatives.
        """
        histograms, regions = largest
        size = (regions.shape[2], regions.shape[3])
        small = normalise(interpolate(images, size=size, mode="bilinear", align_corners=False, antialias=True))
        regions = normalise(regions)
        odds: Tensor = self.polarity(histograms, regions, small)
        mirrored: Tensor = self.polarity(self.mirror(histograms), regions.flip(3), small.flip(3))
        return (odds + mirrored) / 2 * small.flatten(1).any(1)


def _enlarge_cells(histograms: Tensor) -> Tensor:
    """Histograms (B, 9, R, C) of cells about twice as large."""
    return _resample(histograms, histograms.shape[2] / 2, histograms.shape[3] / 2)


def _resample(histograms: Tensor, rows: float, cols: float) -> Tensor:
    """Histograms (B, 9, R, C) at a grid of about so many rows and columns, multiples of :data:`COARSEST`."""
    grid = [max(LEAST_CELLS, round(n / COARSEST) * COARSEST) for n in (rows, cols)]
    if list(histograms.shape[2:]) == grid:
        return histograms
    return interpolate(histograms, size=grid, mode="bilinear", align_corners=False, antialias=True)
