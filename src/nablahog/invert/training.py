"""Learning a prior from photographs."""

from __future__ import annotations

import math
import os
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d, mse_loss
from torch.nn.utils import clip_grad_norm_, parameters_to_vector

from ..hog.descriptor import hog
from ..hog.presets import as_spec
from ..hog.spec import HOGSpec
from .checkpoint import Checkpoint
from .crops import crop_count, draw_crops, least_side
from .learned import LearnedPrior, PriorLearning
from .network import Architecture, Inputs, PriorNetwork, check_spec, default_architecture, network_inputs
from .provenance import check_images, digest_of_images

BATCH = 12
CROPS = 23_000  # of a training by default: about an hour and a half on one core
ROUNDS = 6  # epochs until the same crops come again
CACHED = 400  # batches whose inputs stay in memory until then: about a gigabyte
LEARNING_RATE, WEIGHT_DECAY, LARGEST_GRADIENT = 1.5e-3, 1e-3, 1.0
WARM_UP = 0.1  # share of the steps in which the rate rises
FIRST, LAST = 1 / 25, 1e-5  # the first and the last rate, relative to the largest
LEAST_CONTRAST = 0.02  # standard deviation of a crop, in 0…1, from which on it has its full weight
STRUCTURE = 0.5  # weight of 1 - SSIM beside the mean square error
_MOMENTS = ("exp_avg", "exp_avg_sq")  # of AdamW, for each weight


def train_prior(
    images: Mapping[str, Tensor],
    spec: HOGSpec | str,
    *,
    epochs: int | None = None,
    seed: int = 0,
    architecture: Architecture | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    progress: Callable[[int, int, str], None] = lambda done, total, what: None,
) -> LearnedPrior:
    """Learns, from photographs, which image to expect for a descriptor.

    The network predicts random crops from their descriptors, up to brightness and contrast.  The loss is the mean
    square error at unit contrast, whose minimum is the mean of all photographs with the descriptor, plus half of
    1 - SSIM, which makes that less blurred.

    The result depends on the images, the spec, epochs, seed and architecture alone, as long as PyTorch, its number of
    threads and the processor stay the same.

    Args:
        images: (H, W) each, float32 in 0…1, by name.
        spec: the dialect, or the name of a preset with its defaults; signed, with square cells of 2, 4, 8 or 16
            pixels.
        epochs: passes over the images, in which larger ones give several crops; by default about 23,000 crops in all.
        seed: of everything random.
        architecture: of the network; by default :func:`.network.default_architecture`.
        checkpoint: a file that is written after each epoch.  If it exists and is of the same training, this training is
            resumed, with the same result.  The file is not removed.  A damaged one is renamed, and the training starts
            afresh.
        progress: called with the steps done, their number, and epoch and loss.

    Raises:
        ValueError: there are no images, or one is too small or holds other values; there can be no prior for the spec;
            there is no such preset; ``epochs`` is below 1; the checkpoint is of another training; the training
            diverges.
        OSError: the checkpoint cannot be read or written.

    >>> images = {"noise": torch.rand(96, 96, generator=torch.Generator().manual_seed(0))}
    >>> prior = nablahog.train_prior(images, nablahog.presets.uoctti(cell_size=8), epochs=1)

    >>> prior.learning.images, len(prior.learning.losses)
    (('noise',), 1)
    """
    spec = as_spec(spec)
    architecture = architecture or default_architecture(spec)
    check_spec(spec, architecture)
    names = check_images(images, (least_side(spec.cell_size[0]),) * 2)
    order = [images[name] for name in names for _ in range(crop_count(*images[name].shape))]
    steps = max(1, len(order) // BATCH)
    if epochs is None:
        epochs = max(1, round(CROPS / (steps * min(BATCH, len(order)))))
    if epochs < 1:
        raise ValueError(f"epochs must be at least 1, got {epochs}")
    with torch.random.fork_rng(devices=[]):  # layers draw from the global generator, which must not change
        torch.manual_seed(seed)
        network = PriorNetwork(spec, architecture)
    optimizer = torch.optim.AdamW(network.parameters(), weight_decay=WEIGHT_DECAY)
    digest = digest_of_images(images)
    identity = {
        "images": digest,
        "spec": spec.to_json(),
        "epochs": epochs,
        "seed": seed,
        "architecture": [list(architecture.widths), list(architecture.blocks)],
    }
    saved = Checkpoint(checkpoint, "training", identity, ("losses", "state"))
    losses = _restore(saved, network, optimizer, epochs, steps)
    batches = _Batches(order, steps, spec, seed)
    for epoch in range(len(losses), epochs):
        total = 0.0
        for step, batch in enumerate(batches(epoch)):
            done = epoch * steps + step
            progress(done, epochs * steps, _report(epoch, epochs, losses))
            for group in optimizer.param_groups:
                group["lr"] = LEARNING_RATE * one_cycle((done + 0.5) / (epochs * steps))
            loss = _loss(network, batch)
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            clip_grad_norm_(network.parameters(), LARGEST_GRADIENT)
            optimizer.step()
            total += loss.item()
        if not math.isfinite(total):
            raise ValueError(f"the training has diverged in epoch {epoch + 1}: the loss is {total}")
        losses.append(total / steps)
        _save(saved, network, optimizer, losses)
    progress(epochs * steps, epochs * steps, _report(epochs - 1, epochs, losses))
    weights = parameters_to_vector(network.parameters()).detach().half()
    learning = PriorLearning(images=tuple(names), sha256=digest, seed=seed, epochs=epochs, losses=tuple(losses))
    return LearnedPrior(spec, architecture, weights, learning)


def _save(checkpoint: Checkpoint, network: nn.Module, optimizer: torch.optim.AdamW, losses: list[float]) -> None:
    """Saves the weights of ``network``, the moments of its ``optimizer`` and the ``losses`` of all epochs."""
    weights = list(network.parameters())
    state = [weights, *([optimizer.state[weight][moment] for weight in weights] for moment in _MOMENTS)]
    checkpoint.save({"losses": losses, "state": np.stack([_flat(tensors) for tensors in state])})


def _restore(
    checkpoint: Checkpoint, network: nn.Module, optimizer: torch.optim.AdamW, epochs: int, steps: int
) -> list[float]:
    """Sets network and optimizer to the state of the checkpoint, if there is one, of ``epochs`` of ``steps`` each.

    Returns:
        The losses of the epochs that it is after.

    Raises:
        ValueError, OSError: as :meth:`.Checkpoint.restore`.
    """
    weights = list(network.parameters())
    sizes = [weight.numel() for weight in weights]
    stored = checkpoint.restore(lambda arrays: _state_in(arrays, (1 + len(_MOMENTS), sum(sizes)), epochs))
    if stored is None:
        return []
    losses, state = stored
    parts = zip(weights, *(row.split(sizes) for row in state), strict=True)
    for weight, value, *moments in parts:
        weight.data.copy_(value.view_as(weight))
        optimizer.state[weight] = {
            "step": torch.tensor(float(len(losses) * steps)),
            **{name: moment.view_as(weight).clone() for name, moment in zip(_MOMENTS, moments, strict=True)},
        }
    return losses


def _state_in(
    arrays: dict[str, NDArray[np.generic]], shape: tuple[int, int], epochs: int
) -> tuple[list[float], Tensor]:
    """The losses, and weights and moments of a shape.

    Raises:
        ValueError: they are impossible.
    """
    losses, state = arrays["losses"], arrays["state"]
    if state.dtype != np.float32 or state.shape != shape or losses.dtype != np.float64 or losses.ndim != 1:
        raise ValueError(f"expected the state of {shape}, got {state.shape}")
    if not np.isfinite(state.astype(np.float32)).all() or not 1 <= len(losses) <= epochs:
        raise ValueError(f"the state after {len(losses)} of {epochs} epochs is impossible")
    return [float(loss) for loss in losses], torch.from_numpy(state)


def _flat(tensors: list[Tensor]) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    return torch.cat([tensor.detach().flatten() for tensor in tensors]).numpy()


class _Batch(NamedTuple):
    """Crops, and the network's inputs for them."""

    inputs: Inputs
    crops: Tensor


class _Batches:
    """The batches of each epoch.

    Inputs take a third of a step, so the crops of an epoch come again every few epochs.  What is random depends on the
    seed and the epoch alone, so that an interruption does not change it.

    Args:
        order: the images, each as often as it gives crops.
        steps: of an epoch.
        spec: the dialect.
        seed: of everything random.
    """

    def __init__(self, order: Sequence[Tensor], steps: int, spec: HOGSpec, seed: int) -> None:
        self.order, self.steps, self.spec, self.seed = order, steps, spec, seed
        self._cache: dict[tuple[int, int], _Batch] = {}

    def __call__(self, epoch: int) -> Iterator[_Batch]:
        """The batches of an epoch, in its own order."""
        number = epoch % ROUNDS
        shuffled = random.Random(f"{self.seed} {number}").sample(range(len(self.order)), len(self.order))
        for step in random.Random(f"{self.seed} {epoch} steps").sample(range(self.steps), self.steps):
            batch = self._cache.get((number, step))
            if batch is None:
                images = [self.order[k] for k in shuffled[step * BATCH : (step + 1) * BATCH]]
                crops = draw_crops(images, self.spec.cell_size[0], random.Random(f"{self.seed} {number} {step}"))
                inputs = network_inputs(hog(crops, self.spec), self.spec, *crops.shape[2:])
                batch = _Batch(inputs, crops)
                if len(self._cache) < CACHED:
                    self._cache[number, step] = batch
            yield batch


def _report(epoch: int, epochs: int, losses: Sequence[float]) -> str:
    return f"epoch {epoch + 1} of {epochs}" + (f", loss {losses[-1]:.4f}" if losses else "")


def one_cycle(progress: float) -> float:
    """The learning rate at ``progress`` 0…1, relative to the largest: up, and down to nearly 0, by half cosines."""
    if progress < WARM_UP:
        return FIRST + (1 - FIRST) * (1 - math.cos(math.pi * progress / WARM_UP)) / 2
    return LAST + (1 - LAST) * (1 + math.cos(math.pi * (progress - WARM_UP) / (1 - WARM_UP))) / 2


def _loss(network: PriorNetwork, batch: _Batch) -> Tensor:
    crops = batch.crops
    height, width = crops.shape[2:]
    image: Tensor = network(batch.inputs)[..., :height, :width]
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
