"""Training of a network for signed descriptors: windows of photographs with their histograms, and the loss."""

from __future__ import annotations

import random
from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d, mse_loss

from ..hog import presets
from ..hog.descriptor import hog
from ..hog.spec import HOGSpec
from .histograms import recover_histograms, searchable
from .prior_network import HISTOGRAM_EVALUATIONS
from .signed_network import cell_votes, network_inputs
from .training_windows import CELL, WindowTraining

CROPS = 90_000  # of a training by default
LEARNING_RATE, WEIGHT_DECAY = 2e-3, 1e-3
UOCTTI, VLFEAT, DPM = presets.uoctti(CELL), presets.vlfeat(cell_size=CELL), presets.dpm(CELL)
PIOTR, CNN_HOG = presets.piotr(CELL), presets.cnn_hog(CELL)
DIALECTS = [[UOCTTI, VLFEAT]] * 3 + [
    [UOCTTI, DPM],
    [UOCTTI, PIOTR],
    [DPM, CNN_HOG],
]  # of equal parts of a batch
GRIDS = [(15, 15)] * 4 + [(16, 16)] * 2 + [(12, 16), (16, 12), (12, 12), (10, 14)]  # of 128x128: cells begin anywhere
GAMMA, SHRUNK = 0.2, 0.5  # the latter is the share of windows that are shrunk, where photographs are large enough
LEAST_CONTRAST = 0.02  # standard deviation in 0…1; windows below it have less weight
STRUCTURE = 0.5  # weight of 1 - SSIM beside the mean square error


class _Batch(NamedTuple):
    """The network's inputs, and the windows (B, 1, 8R, 8C)."""

    cells: Tensor
    integral: Tensor
    windows: Tensor


class SignedTraining(WindowTraining):
    """The batches of each epoch, and the loss.

    The loss is the mean square error at unit contrast, whose minimum is the mean of all photographs with the
    histograms, plus half of 1 - SSIM, which makes the image less blurred.  The histograms are recovered from the
    descriptors of several dialects.
    """

    default_crops, learning_rate, weight_decay = CROPS, LEARNING_RATE, WEIGHT_DECAY
    grids, gamma = GRIDS, GAMMA

    def _batch(self, images: Sequence[Tensor], grid: tuple[int, int], rng: random.Random) -> _Batch:
        specs = rng.choice(DIALECTS)
        windows = torch.cat([self._window(image, grid, rng) for image in images])
        cells = [_cells(part, spec) for part, spec in zip(windows.chunk(len(specs)), specs, strict=False)]
        return _Batch(*network_inputs(torch.cat(cells)), windows)

    def _scale(self, largest: float, rng: random.Random) -> float:
        """Windows are enlarged only if the photograph is smaller: enlarged windows have no details."""
        return min(largest, rng.uniform(1, max(1, largest)) if rng.random() < SHRUNK else 1.0)

    def loss(self, network: nn.Module, batch: _Batch) -> Tensor:
        """The mean over the windows."""
        windows, image = batch.windows, network(batch.cells, batch.integral)
        mean = windows.mean(dim=(2, 3), keepdim=True)
        contrast = windows.std(dim=(2, 3), keepdim=True, correction=0).clamp(min=LEAST_CONTRAST)
        similarity = _ssim(image * contrast + mean, windows)
        return mse_loss(image, (windows - mean) / contrast) + STRUCTURE * (1 - similarity)


def _cells(windows: Tensor, spec: HOGSpec) -> Tensor:
    """The network's histograms (B, 18, R, C) of windows (B, 1, 8R, 8C), as recovered from their descriptors."""
    size, searched = (windows.shape[2], windows.shape[3]), searchable(spec)
    votes = recover_histograms(hog(windows, spec), searched, size, max_evaluations=HISTOGRAM_EVALUATIONS)
    return cell_votes(votes, searched, size)


def _ssim(a: Tensor, b: Tensor) -> Tensor:
    """SSIM of images in 0…1 in windows of 7x7 pixels, differentiable, with its usual constants."""

    def window(x: Tensor) -> Tensor:
        return avg_pool2d(x, 7, 1)

    mean_a, mean_b = window(a), window(b)
    squares = window(a * a) + window(b * b) - mean_a**2 - mean_b**2
    products = window(a * b) - mean_a * mean_b
    alike = (2 * mean_a * mean_b + 1e-4) * (2 * products + 9e-4)
    return (alike / ((mean_a**2 + mean_b**2 + 1e-4) * (squares + 9e-4))).mean()
