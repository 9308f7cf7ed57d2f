"""Training of a network for unsigned descriptors: windows of photographs with their votes, and the loss."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import affine_grid, avg_pool2d, grid_sample, softplus

from ..hog import presets
from ..hog.descriptor import histograms, hog
from ..hog.spec import HOGSpec
from .histograms import recover_histograms
from .prior_network import HISTOGRAM_EVALUATIONS
from .training_windows import CELL, WindowTraining, resized
from .unsigned_network import FINER, UnsignedNetwork, cell_votes, normalised

CROPS = 300_000  # of a training by default: about an hour and a half on two cores, by the time of a step
LEARNING_RATE, WEIGHT_DECAY = 1.2e-3, 0.03
PAPER, SKIMAGE, OPENCV, MASKFEAT = presets.paper(CELL), presets.skimage(), presets.opencv(), presets.maskfeat()
DIALECTS = [[PAPER, SKIMAGE]] * 3 + [
    [PAPER, OPENCV],
    [SKIMAGE, OPENCV],
    [PAPER, MASKFEAT],
]  # of equal parts of a batch
LOSSY = [OPENCV, MASKFEAT]  # descriptors do not determine histograms: values are clipped, cells lose contrast
GRIDS = [(16, 16)] * 6 + [(12, 16), (16, 12), (12, 12), (16, 8)]  # cells of the windows of a batch
LEAST_SIDE, LARGE = 0.5, 0.6  # side of windows, relative to the largest possible; the share of windows of that size
GAMMA = 0.45  # the largest logarithm of the exponent of gray values
TURNED, TURN, STRETCH = 0.5, 12.0, 0.15  # share of windows, degrees, and logarithm of the change of proportions
UP_TO_SIGN = 0.75  # share of the regions' loss that is the same for an image and its negative
LEAST_CONTRAST = 0.02  # standard deviation in 0…1; windows below it have less weight
FEWEST = 8  # images held out, to calibrate the confidence


class _Batch(NamedTuple):
    """:func:`.unsigned_network.cell_votes` (B, 9, R, C), and normalised images of two pixels a cell, (B, 1, 2R, 2C)."""

    votes: Tensor
    images: Tensor


class UnsignedTraining(WindowTraining):
    """The batches of each epoch, and the loss.

    A quarter of the regions' loss is the squared error to the image, the rest the smaller of the errors to the image
    and to its negative: the signs of regions can thus become consistent before the polarity is learned.  The loss of
    the polarity is the cross entropy of the choice between an image, a mixture of the regions and the true image, and
    its negative.

    Votes are those of several dialects; for lossy descriptors they are recovered from the descriptor.
    """

    default_crops, learning_rate, weight_decay = CROPS, LEARNING_RATE, WEIGHT_DECAY
    grids, gamma = GRIDS, GAMMA

    def _batch(self, images: Sequence[Tensor], grid: tuple[int, int], rng: random.Random) -> _Batch:
        specs = rng.choice(DIALECTS)
        windows = _turned(torch.cat([self._window(image, grid, rng) for image in images]), rng)
        parts = windows.chunk(len(specs))
        votes = torch.cat([_votes(part, spec) for part, spec in zip(parts, specs, strict=False)])
        return _Batch(votes, _target(windows))

    def _scale(self, largest: float, rng: random.Random) -> float:
        return largest * (1.0 if rng.random() < LARGE else rng.uniform(LEAST_SIDE, 1))

    def loss(self, network: UnsignedNetwork, batch: _Batch) -> Tensor:
        """The mean over the windows, of regions and polarity."""
        images, regions = batch.images, network.regions(batch.votes)
        apart, negative = ((regions - sign * images).square().mean(dim=(1, 2, 3)) for sign in (1.0, -1.0))
        loss: Tensor = ((1 - UP_TO_SIGN) * apart + UP_TO_SIGN * torch.minimum(apart, negative)).mean()
        answer = normalised(regions.detach())
        share = torch.rand(len(images), 1, 1, 1, device=images.device)
        share = torch.where(share < 0.5, 0, 2 * share - 1)  # of the true image in the mixture
        positive = torch.where((answer * images).sum(dim=(1, 2, 3), keepdim=True) < 0, -answer, answer)
        known = (torch.rand_like(share) < 0.7).to(answer)  # in the others, the polarity part does not see the regions
        odds = network.polarity(batch.votes, known * answer, normalised(share * images + (1 - share) * positive))
        return loss + softplus(-odds).mean()

    @torch.no_grad()
    def calibrate(self, network: UnsignedNetwork) -> None:
        """Scales the log-odds of the polarity to maximise the likelihood of the images held out."""
        if len(self.held_out) < FEWEST:
            return
        odds = torch.cat([self._odds(network, image) for image in self.held_out])
        factors = torch.logspace(-1, 1, 201)
        likelihood = softplus(-factors[:, None] * odds).mean(dim=1)
        network.polarity.out.weight *= float(factors[likelihood.argmin()])

    def _odds(self, network: UnsignedNetwork, image: Tensor) -> Tensor:
        """The log-odds (1,) of the network's prediction for a whole image, negative if its polarity is wrong."""
        device = network.polarity.out.weight.device
        window = _whole(image)
        votes = _votes(window, PAPER).to(device)
        regions = network.regions_of(votes)
        right = (normalised(regions) * _target(window).to(device)).sum(dim=(1, 2, 3))
        return (network.log_odds(votes, regions, regions) * torch.sign(right)).cpu()


def _turned(windows: Tensor, rng: random.Random) -> Tensor:
    """Windows (B, 1, H, W), some of them rotated and stretched, and mirrored at their borders."""
    height, width = windows.shape[2:]
    affine = []
    for _ in windows:
        angle = math.radians(rng.uniform(-TURN, TURN))
        along_x, along_y = (math.exp(sign * rng.uniform(0, STRETCH) / 2) for sign in rng.choice([(1, -1), (-1, 1)]))
        cos, sin = math.cos(angle), math.sin(angle)
        rows = [[cos * along_x, -sin * along_y * height / width, 0], [sin * along_x * width / height, cos * along_y, 0]]
        affine.append(rows if rng.random() < TURNED else [[1, 0, 0], [0, 1, 0]])
    grid = affine_grid(windows.new_tensor(affine), list(windows.shape), align_corners=False)
    return grid_sample(windows, grid, padding_mode="reflection", align_corners=False).clamp(0, 1)


def _votes(windows: Tensor, spec: HOGSpec) -> Tensor:
    """The network's input for windows (B, 1, H, W), by their histograms or, for lossy dialects, their descriptors."""
    size = (windows.shape[2], windows.shape[3])
    if spec in LOSSY:
        votes = recover_histograms(hog(windows, spec), spec, size, max_evaluations=HISTOGRAM_EVALUATIONS)
    else:
        votes = histograms(windows, spec)
    return cell_votes(votes, spec, size)


def _target(windows: Tensor) -> Tensor:
    """Windows (B, 1, 8R, 8C) in 0…1 to images of two pixels a cell, of unit variance if they are not flat."""
    small = avg_pool2d(windows, CELL // FINER)
    small = small - small.mean(dim=(2, 3), keepdim=True)
    return small / windows.std(dim=(2, 3), keepdim=True, correction=0).clamp(min=LEAST_CONTRAST)


def _whole(image: Tensor) -> Tensor:
    """A whole image (H, W), resized to at most 16 cells a side, (1, 1, 8R, 8C)."""
    shrink = 16 * CELL / max(image.shape)
    size = [max(2, round(n * shrink / CELL / 4)) * 4 * CELL for n in image.shape]
    return resized(image, size[0], size[1])
