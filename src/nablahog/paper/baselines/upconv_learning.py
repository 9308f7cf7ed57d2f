"""Learning an up-convolutional network from photographs.

As Dosovitskiy and Brox (CVPR 2016): the squared Euclidean error between images, Adam with β = 0.9 and 0.999, weight
decay, a learning rate that falls towards the end.  Different here: photographs of one's own instead of ImageNet's,
batches of 12 crops of at most 128x128 pixels, weight decay beside Adam's step instead of in the gradient (AdamW), and
a rate that also rises in the beginning.
"""

from __future__ import annotations

import os
import random
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn.functional import mse_loss

from ...hog.descriptor import hog
from ...hog.spec import HOGSpec
from ...invert.crops import CropTraining, draw_crops
from ...invert.fitting import Precision, learn_network
from .upconv import Upconv
from .upconv_network import UpconvNetwork, check_widths, default_widths, network_input

BATCH = 12
CROPS = 60_000  # of a training by default: about an hour and a half on one core, by the time of the first steps
LEARNING_RATE, WEIGHT_DECAY = 1e-3, 4e-4  # at a rate of 1e-4 the error falls more slowly in so few steps


class _Batch(NamedTuple):
    """The network's input (B, channels, R, C), and its crops (B, 1, h, w)."""

    cells: Tensor
    crops: Tensor


class UpconvTraining(CropTraining):
    """The batches of each epoch, and the loss.  What is random depends on the seed and the epoch alone."""

    batch, default_crops, learning_rate, weight_decay = BATCH, CROPS, LEARNING_RATE, WEIGHT_DECAY

    def batches(self, epoch: int) -> Iterator[_Batch]:
        """The batches of an epoch, in its own order."""
        shuffled = random.Random(f"{self.seed} {epoch}").sample(self.order, len(self.order))
        for step in range(self.steps):
            images = shuffled[step * self.batch : (step + 1) * self.batch]
            crops = draw_crops(images, self.spec.cell_size[0], random.Random(f"{self.seed} {epoch} {step}"))
            yield _Batch(network_input(hog(crops, self.spec), self.spec, *crops.shape[2:]), crops)

    def loss(self, network: nn.Module, batch: _Batch) -> Tensor:
        """The mean square error of a pixel."""
        height, width = batch.crops.shape[2:]
        return mse_loss(network(batch.cells)[..., :height, :width], batch.crops)


def learn_upconv(
    images: Mapping[str, Tensor],
    spec: HOGSpec,
    *,
    epochs: int | None = None,
    seed: int = 0,
    widths: tuple[int, ...] | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    device: torch.device | str = "cpu",
    precision: Precision | None = None,
    progress: Callable[[int, int, str], None] = lambda done, total, what: None,
) -> Upconv:
    """Learns, from photographs, the image of a descriptor.

    The result depends on the images, the spec, epochs, seed and widths alone, as long as PyTorch, its number of threads
    and the device stay the same.

    Args:
        images: (H, W) each, float32 in 0…1, by name; both sides of at least 32 pixels and four cells.
        spec: the dialect, with an entry for each cell, and square cells of 2, 4, 8 or 16 pixels.
        epochs: passes over the images, in which larger ones give several crops; by default as many as give 60,000 crops
            in all.
        seed: of everything random.
        widths: of the network, from cells to pixels; by default of 4.2 million weights for UoCTTI with cells of 8.
        checkpoint: a file that is written after each epoch.  If it exists and is of the same training, this training is
            resumed, with the same result.  The file is not removed.  A damaged one is renamed, and the training starts
            afresh.
        device: where to compute.
        precision: as of :func:`~nablahog.train_prior`.
        progress: called with the steps done, their number, and epoch and loss.

    Raises:
        ValueError: there are no images, or one is too small or holds other values; there can be no network of the
            widths for the spec; there is no such precision; ``epochs`` is below 1; the checkpoint is of another
            training; the training diverges.
        OSError: the checkpoint cannot be read or written.
    """
    widths = widths or default_widths(spec)
    check_widths(spec, widths)
    weights, learning = learn_network(
        images,
        spec,
        UpconvTraining,
        partial(UpconvNetwork, spec, widths),
        ["upconv", *widths],
        epochs=epochs,
        seed=seed,
        checkpoint=checkpoint,
        device=device,
        precision=precision,
        progress=progress,
    )
    return Upconv(spec, widths, weights, learning)
