"""Windows of photographs, with their histograms, to train the networks of priors on, and the losses."""

from __future__ import annotations

import math
import random
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import PurePosixPath
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn
from torch.nn.functional import affine_grid, avg_pool2d, grid_sample, interpolate, logsigmoid, mse_loss

from ...hog import presets
from ...hog.descriptor import histograms, hog
from ...hog.spec import HOGSpec
from ..histograms import linear_vote_spec, recover_histograms
from .signed_network import CELL_PIXELS, TRAINING_CELLS, SignedNetwork, network_inputs
from .unsigned_network import MAX_FIRST_CELLS, PIXELS_PER_CELL, UnsignedNetwork, align_sign, normalise

WINDOWS_PER_BATCH = 32  # windows of at most :data:`TRAINING_CELLS` cells a side; of larger ones fewer
HELD_OUT = 25  # one folder of 25 is held out from training, or one image where there are fewer folders
LEAST_WINDOW_STD = 0.02  # standard deviation in 0…1; windows below it have less weight

SHRUNK_SHARE = 0.5  # share of signed windows that are shrunk, where photographs are large enough
SSIM_WEIGHT = 0.5  # weight of 1 - SSIM beside the mean square error
UOCTTI, VLFEAT, DPM = presets.uoctti(CELL_PIXELS), presets.vlfeat(cell_size=CELL_PIXELS), presets.dpm(CELL_PIXELS)
PIOTR, CNN_HOG = presets.piotr(CELL_PIXELS), presets.cnn_hog(CELL_PIXELS)

LEAST_SIDE_SHARE = 0.5  # least side of unsigned windows, relative to the largest possible
LARGEST_SHARE = 0.6  # share of windows that are the largest possible
TURNED_SHARE = 0.5  # share of windows that are turned and stretched
MAX_TURN, MAX_STRETCH = 12.0, 0.15  # most degrees; largest log-ratio of the stretches
PAPER, SKIMAGE, OPENCV, MASKFEAT = presets.paper(CELL_PIXELS), presets.skimage(), presets.opencv(), presets.maskfeat()
DALAL_TRIGGS = presets.dalal_triggs()
# whose descriptors do not determine histograms: values are clipped, cells lose contrast
LOSSY = [OPENCV, MASKFEAT, DALAL_TRIGGS]
RECOVERY_EVALUATIONS = 40  # evaluations for their histograms


class WindowTraining(ABC):
    """The batches of windows and the loss of a training, with at most as many windows as images in an epoch.

    Of a folder of n images of s pixels a side each is drawn with a chance of √(s / n): large folders do not decide
    alone, and large images have more windows.  Everything random depends only on the seed and the epoch, so that an
    interruption does not change it.
    """

    default_crops: int  # of all epochs
    learning_rate: float  # the largest
    weight_decay: float  # of AdamW
    dialects: Sequence[Sequence[HOGSpec]]  # of equal parts of a batch; each batch has one of these lists
    grids: Sequence[tuple[int, int]]  # cells of the windows of a batch
    gamma: float  # the largest logarithm of the exponent of gray values

    def __init__(self, images: Mapping[str, Tensor], seed: int) -> None:
        folders = [PurePosixPath(name).parent for name in images]
        in_folder = Counter(folders)
        sides = [math.sqrt(image.numel()) for image in images.values()]
        chances = [math.sqrt(side / in_folder[folder]) for side, folder in zip(sides, folders, strict=True)]
        held_out = _choose_held_out(list(images), folders)
        self.held_out = {name: image for name, image in images.items() if name in held_out}
        drawn = [(images[name], chance) for name, chance in zip(images, chances, strict=True) if name not in held_out]
        self.images, self.chances = [image for image, _ in drawn], [chance for _, chance in drawn]
        self.seed = seed
        self.steps = max(1, len(self.images) // WINDOWS_PER_BATCH)
        self.crops = self.steps * min(WINDOWS_PER_BATCH, len(self.images))

    @abstractmethod
    def loss(self, network: Any, batch: Any) -> Tensor:
        """The loss of the network for one batch, the mean over its windows."""

    def batches(self, epoch: int) -> Iterator[Any]:
        """The batches of an epoch, NamedTuples of tensors."""
        for step in range(self.steps):
            rng = random.Random(f"{self.seed} {epoch} {step}")
            grid, specs = rng.choice(self.grids), rng.choice(self.dialects)
            most = WINDOWS_PER_BATCH * TRAINING_CELLS**2 // math.prod(grid)
            count = max(1, min(WINDOWS_PER_BATCH, len(self.images), most))
            images = rng.choices(self.images, self.chances, k=count)
            windows = self._change(torch.cat([self._window(image, grid, rng) for image in images]), rng)
            parts = zip(windows.chunk(len(specs)), specs, strict=False)
            yield self._batch(torch.cat([self._compute_histograms(part, spec) for part, spec in parts]), windows)

    @abstractmethod
    def _scale(self, largest: float, rng: random.Random) -> float:
        """Pixels of the photograph per pixel of the window, along each axis; at most ``largest``."""

    def _change(self, windows: Tensor, rng: random.Random) -> Tensor:
        return windows

    @abstractmethod
    def _compute_histograms(self, windows: Tensor, spec: HOGSpec) -> Tensor:
        """The network's histograms of windows (B, 1, 8R, 8C)."""

    @abstractmethod
    def _batch(self, histograms: Tensor, windows: Tensor) -> Any:
        """A batch of histograms and their windows."""

    def _window(self, image: Tensor, grid: tuple[int, int], rng: random.Random) -> Tensor:
        """A window (1, 1, 8R, 8C) of an image (H, W): its place, size, mirroring and gamma are random."""
        height, width = (CELL_PIXELS * n for n in grid)
        scale = self._scale(min(image.shape[0] / height, image.shape[1] / width), rng)
        rows, cols = (max(1, math.floor(n * scale)) for n in (height, width))
        top, left = (rng.randrange(n - size + 1) for n, size in zip(image.shape, (rows, cols), strict=True))
        window = resize(image[top : top + rows, left : left + cols], height, width)
        window = window ** math.exp(rng.uniform(-self.gamma, self.gamma))
        return window.flip(3) if rng.random() < 0.5 else window


def _choose_held_out(names: Sequence[str], folders: Sequence[PurePosixPath]) -> set[str]:
    """The names of the images to hold out: whole folders, because images of one kind are alike."""
    kinds = sorted(set(folders))
    if len(kinds) < HELD_OUT:
        return set(names[HELD_OUT // 2 :: HELD_OUT])
    chosen = set(kinds[HELD_OUT // 2 :: HELD_OUT])
    return {name for name, folder in zip(names, folders, strict=True) if folder in chosen}


class _SignedBatch(NamedTuple):
    """The network's inputs, and the windows (B, 1, 8R, 8C)."""

    cells: Tensor
    integral: Tensor
    windows: Tensor


class SignedTraining(WindowTraining):
    """For signed descriptors.

    The loss is the mean square error at unit contrast, whose minimum is the mean of all photographs with the
    histograms, plus half of 1 - SSIM, which makes the image less blurred.  The histograms are recovered from the
    descriptors of several dialects.
    """

    default_crops, learning_rate, weight_decay, gamma = 90_000, 2e-3, 1e-3, 0.2
    dialects = ([UOCTTI, VLFEAT],) * 3 + ([UOCTTI, DPM], [UOCTTI, PIOTR], [DPM, CNN_HOG])
    # of 128x128 pixels: cells begin anywhere
    grids = ((15, 15),) * 4 + ((16, 16),) * 2 + ((12, 16), (16, 12), (12, 12), (10, 14))

    def _scale(self, largest: float, rng: random.Random) -> float:
        """Windows are enlarged only if the photograph is smaller: enlarged windows have no details."""
        return min(largest, rng.uniform(1, max(1, largest)) if rng.random() < SHRUNK_SHARE else 1.0)

    def _compute_histograms(self, windows: Tensor, spec: HOGSpec) -> Tensor:
        descriptor, size = hog(windows, spec), (windows.shape[2], windows.shape[3])
        spec = linear_vote_spec(spec)
        return SignedNetwork.rebin(recover_histograms(descriptor, spec, size), spec, size)

    def _batch(self, histograms: Tensor, windows: Tensor) -> _SignedBatch:
        inputs = network_inputs(histograms)
        return _SignedBatch(inputs.cells, inputs.integral, windows)

    def loss(self, network: nn.Module, batch: _SignedBatch) -> Tensor:
        windows, image = batch.windows, network(batch.cells, batch.integral)
        mean = windows.mean(dim=(2, 3), keepdim=True)
        contrast = windows.std(dim=(2, 3), keepdim=True, correction=0).clamp(min=LEAST_WINDOW_STD)
        similarity = _ssim(image * contrast + mean, windows)
        return mse_loss(image, (windows - mean) / contrast) + SSIM_WEIGHT * (1 - similarity)


def _ssim(a: Tensor, b: Tensor) -> Tensor:
    """SSIM of images in 0…1 in windows of 7x7 pixels, differentiable, with its usual constants."""

    def window(x: Tensor) -> Tensor:
        return avg_pool2d(x, 7, 1)

    mean_a, mean_b = window(a), window(b)
    squares = window(a * a) + window(b * b) - mean_a**2 - mean_b**2
    products = window(a * b) - mean_a * mean_b
    numerator = (2 * mean_a * mean_b + 1e-4) * (2 * products + 9e-4)
    return (numerator / ((mean_a**2 + mean_b**2 + 1e-4) * (squares + 9e-4))).mean()


class _UnsignedBatch(NamedTuple):
    """Histograms (B, 9, R, C) for the network, and normalised images of two pixels a cell, (B, 1, 2R, 2C)."""

    histograms: Tensor
    images: Tensor


class UnsignedTraining(WindowTraining):
    """For unsigned descriptors.

    The loss is the smaller of the squared errors to the image and to its negative, so that the signs of regions can
    become consistent whichever side is the brighter one; and, of the polarity, the cross entropy of the choice between
    an image, a mixture of the prediction and the true image, and its negative.  Windows of smaller cells are seen
    together with the prediction for cells twice as large, which has the right sign.

    Histograms are those of several dialects; for lossy descriptors they are recovered from the descriptor.
    """

    default_crops = 300_000  # about an hour and a half on two cores, estimated from the time of a step
    learning_rate, weight_decay, gamma = 1.2e-3, 0.03, 0.45
    dialects = ([PAPER, SKIMAGE],) * 3 + (
        [PAPER, OPENCV],
        [SKIMAGE, OPENCV],
        [PAPER, MASKFEAT],
        [PAPER, DALAL_TRIGGS],
        [OPENCV, DALAL_TRIGGS],
    )
    grids = ((16, 16),) * 6 + ((12, 16), (16, 12), (12, 12), (16, 8)) + ((32, 32),) * 2

    def _scale(self, largest: float, rng: random.Random) -> float:
        return largest * (1.0 if rng.random() < LARGEST_SHARE else rng.uniform(LEAST_SIDE_SHARE, 1))

    def _change(self, windows: Tensor, rng: random.Random) -> Tensor:
        return _turn(windows, rng)

    def _compute_histograms(self, windows: Tensor, spec: HOGSpec) -> Tensor:
        """Those of windows or, for lossy dialects, their descriptors."""
        size = (windows.shape[2], windows.shape[3])
        if spec in LOSSY:
            cells = recover_histograms(hog(windows, spec), spec, size, max_evaluations=RECOVERY_EVALUATIONS)
        else:
            cells = histograms(windows, spec)
        return UnsignedNetwork.rebin(cells, spec, size)

    def _batch(self, histograms: Tensor, windows: Tensor) -> _UnsignedBatch:
        return _UnsignedBatch(histograms, _make_target(windows))

    def loss(self, network: UnsignedNetwork, batch: _UnsignedBatch) -> Tensor:
        histograms, images = batch
        if max(histograms.shape[2:]) > MAX_FIRST_CELLS:
            with torch.no_grad():
                coarser = network.coarser(histograms, network.largest_cells(histograms))
            return mse_loss(network(histograms, align_sign(coarser, images)), images)
        regions = network(histograms, torch.zeros_like(images))
        positive_error, negative_error = (
            (regions - sign * images).square().mean(dim=(1, 2, 3)) for sign in (1.0, -1.0)
        )
        predicted = align_sign(normalise(regions.detach()), images)
        share = torch.rand(len(images), 1, 1, 1, dtype=images.dtype, device=images.device)
        share = torch.where(share < 0.5, 0, 2 * share - 1)  # of the true image in the mixture
        odds = network.polarity(histograms, predicted, normalise(share * images + (1 - share) * predicted))
        return torch.minimum(positive_error, negative_error).mean() - logsigmoid(odds).mean()


def _turn(windows: Tensor, rng: random.Random) -> Tensor:
    """Windows (B, 1, H, W), some of them rotated and stretched, and mirrored at their borders."""
    height, width = windows.shape[2:]
    affine = []
    for _ in windows:
        angle = math.radians(rng.uniform(-MAX_TURN, MAX_TURN))
        along_x, along_y = (math.exp(sign * rng.uniform(0, MAX_STRETCH) / 2) for sign in rng.choice([(1, -1), (-1, 1)]))
        cos, sin = math.cos(angle), math.sin(angle)
        rows = [[cos * along_x, -sin * along_y * height / width, 0], [sin * along_x * width / height, cos * along_y, 0]]
        affine.append(rows if rng.random() < TURNED_SHARE else [[1, 0, 0], [0, 1, 0]])
    grid = affine_grid(windows.new_tensor(affine), list(windows.shape), align_corners=False)
    return grid_sample(windows, grid, padding_mode="reflection", align_corners=False).clamp(0, 1)


def _make_target(windows: Tensor) -> Tensor:
    """Windows (B, 1, 8R, 8C) in 0…1 to images of two pixels a cell, of unit variance if they are not flat."""
    small = avg_pool2d(windows, CELL_PIXELS // PIXELS_PER_CELL)
    small = small - small.mean(dim=(2, 3), keepdim=True)
    return small / windows.std(dim=(2, 3), keepdim=True, correction=0).clamp(min=LEAST_WINDOW_STD)


def resize_whole(image: Tensor) -> Tensor:
    """A whole image (H, W), resized to at most :data:`TRAINING_CELLS` cells a side, (1, 1, 8R, 8C)."""
    shrink = TRAINING_CELLS * CELL_PIXELS / max(image.shape)
    size = [max(2, round(n * shrink / CELL_PIXELS / 4)) * 4 * CELL_PIXELS for n in image.shape]
    return resize(image, size[0], size[1])


def resize(image: Tensor, height: int, width: int) -> Tensor:
    """An image (H, W) as (1, 1, height, width)."""
    if image.shape == (height, width):
        return image[None, None]
    return interpolate(image[None, None], (height, width), mode="bilinear", antialias=True, align_corners=False)
