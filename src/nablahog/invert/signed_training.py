"""What a network for signed descriptors is trained with: crops with their descriptors, and the loss."""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from torch import Tensor, nn
from torch.nn.functional import avg_pool2d, mse_loss

from ..hog.descriptor import hog
from ..hog.spec import HOGSpec
from .crops import CropTraining, draw_crops
from .signed_network import network_inputs

BATCH = 12
CROPS = 23_000  # of a training by default: about an hour and a half on one core
ROUNDS = 6  # epochs until the same crops come again
CACHED = 400  # batches whose inputs stay in memory until then: about a gigabyte
LEARNING_RATE, WEIGHT_DECAY = 1.5e-3, 1e-3
LEAST_CONTRAST = 0.02  # standard deviation of a crop, in 0…1, from which on it has its full weight
STRUCTURE = 0.5  # weight of 1 - SSIM beside the mean square error


class _Batch(NamedTuple):
    """Crops (B, 1, h, w), and the network's inputs for them."""

    cells: Tensor
    integral: Tensor
    crops: Tensor


class SignedTraining(CropTraining):
    """The batches of each epoch, and the loss.

    The loss is the mean square error at unit contrast, whose minimum is the mean of all photographs with the
    descriptor, plus half of 1 - SSIM, which makes that less blurred.

    Inputs take a third of a step, so the crops of an epoch come again every few epochs.  What is random depends on the
    seed and the epoch alone, so that an interruption does not change it.
    """

    batch, default_crops, learning_rate, weight_decay = BATCH, CROPS, LEARNING_RATE, WEIGHT_DECAY

    def __init__(self, images: Sequence[Tensor], spec: HOGSpec, seed: int) -> None:
        super().__init__(images, spec, seed)
        self._cache: dict[tuple[int, int], _Batch] = {}

    def batches(self, epoch: int) -> Iterator[_Batch]:
        """The batches of an epoch, in its own order."""
        number = epoch % ROUNDS
        shuffled = random.Random(f"{self.seed} {number}").sample(range(len(self.order)), len(self.order))
        for step in random.Random(f"{self.seed} {epoch} steps").sample(range(self.steps), self.steps):
            batch = self._cache.get((number, step))
            if batch is None:
                images = [self.order[k] for k in shuffled[step * self.batch : (step + 1) * self.batch]]
                crops = draw_crops(images, self.spec.cell_size[0], random.Random(f"{self.seed} {number} {step}"))
                inputs = network_inputs(hog(crops, self.spec), self.spec, *crops.shape[2:])
                batch = _Batch(inputs.cells, inputs.integral, crops)
                if len(self._cache) < CACHED:
                    self._cache[number, step] = batch
            yield batch

    def loss(self, network: nn.Module, batch: _Batch) -> Tensor:
        """The mean over the crops."""
        crops = batch.crops
        height, width = crops.shape[2:]
        image: Tensor = network(batch.cells, batch.integral)[..., :height, :width]
        mean = crops.mean(dim=(2, 3), keepdim=True)
        contrast = crops.std(dim=(2, 3), keepdim=True, correction=0).clamp(min=LEAST_CONTRAST)
        similarity = _ssim(image * contrast + mean, crops)
        return mse_loss(image, (crops - mean) / contrast) + STRUCTURE * (1 - similarity)


def _ssim(a: Tensor, b: Tensor) -> Tensor:
    """SSIM of images in 0…1 in windows of 7x7 pixels, differentiable, with its usual constants."""

    def window(x: Tensor) -> Tensor:
        return avg_pool2d(x, 7, 1)

    mean_a, mean_b = window(a), window(b)
    squares = window(a * a) + window(b * b) - mean_a**2 - mean_b**2
    products = window(a * b) - mean_a * mean_b
    alike = (2 * mean_a * mean_b + 1e-4) * (2 * products + 9e-4)
    return (alike / ((mean_a**2 + mean_b**2 + 1e-4) * (squares + 9e-4))).mean()
