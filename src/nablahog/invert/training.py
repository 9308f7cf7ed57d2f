"""Learning a prior from photographs."""

from __future__ import annotations

import math
import os
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d, mse_loss
from torch.nn.utils import clip_grad_norm_, parameters_to_vector

from ..hog.descriptor import hog
from ..hog.spec import HOGSpec
from . import training_state
from .checkpoint import Checkpoint
from .crops import crop_count, draw_crops, least_side
from .learned import LearnedPrior, Training
from .network import Architecture, Inputs, PriorNetwork, check_spec, default_architecture, network_inputs
from .provenance import digest_of_images

BATCH = 12
CROPS = 23_000  # that a training sees if nothing is said: about an hour and a half on one core
ROUNDS = 6  # epochs until the same crops come again
KEPT = 400  # batches whose inputs stay in memory until then: about a gigabyte
RATE, WEIGHT_DECAY, LARGEST_GRADIENT = 1.5e-3, 1e-3, 1.0
WARM_UP = 0.1  # share of the steps in which the rate rises
FIRST, LAST = 1 / 25, 1e-5  # shares of the rate to begin and to end with
LEAST_CONTRAST = 0.02  # standard deviation of a crop, in 0…1, that is learned at its full weight
STRUCTURE = 0.5  # weight of 1 - SSIM beside the mean square error


def train_prior(
    images: Mapping[str, Tensor],
    spec: HOGSpec,
    *,
    epochs: int | None = None,
    seed: int = 0,
    architecture: Architecture | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    progress: Callable[[int, int, str], None] = lambda done, total, what: None,
) -> LearnedPrior:
    """Learns, from photographs, which image to expect for a descriptor.

    Random crops are described by ``spec``, and a network learns to give them back, up to brightness and contrast: the
    loss is their mean square error at unit contrast, which the mean of all fitting photographs would make least, and
    half of 1 - SSIM, which keeps that from being more blurred than it must.

    The result depends on the images, the spec, epochs, seed and architecture, and on nothing else as long as PyTorch,
    its number of threads and the processor stay the same.

    Args:
        images: (H, W) each, float32 in 0…1, by name.
        spec: the dialect; signed, with square cells of 2, 4, 8 or 16 pixels.
        epochs: passes over the images, in which larger ones give several crops; by default as many as it takes to see
            about 23,000 crops.
        seed: of everything random.
        architecture: of the network; by default :func:`.network.default_architecture`.
        checkpoint: a file to keep what is learned in, after each epoch.  If there is one, of the same training, that
            training goes on, with the same result.  It stays behind.
        progress: called with the steps done, their number and where the training is.

    Raises:
        ValueError: there are no images, or one is too small or holds other values; there can be no prior for the spec;
            ``epochs`` is below 1; the checkpoint is of another training, or damaged; the training diverges.
        OSError: the checkpoint cannot be written.
    """
    architecture = architecture or default_architecture(spec)
    check_spec(spec, architecture)
    names = sorted(images)
    for name in names:
        _check(name, images[name], spec)
    order = [images[name] for name in names for _ in range(crop_count(*images[name].shape))]
    if not order:
        raise ValueError("expected images to learn from, got none")
    steps = max(1, len(order) // BATCH)
    if epochs is None:
        epochs = max(1, round(CROPS / (steps * min(BATCH, len(order)))))
    if epochs < 1:
        raise ValueError(f"epochs must be at least 1, got {epochs}")
    network, optimizer = _beginning(spec, architecture, seed)
    training = Training(tuple(names), digest_of_images(names, images), epochs, seed, ())
    identity = {
        "images": training.sha256,
        "spec": spec.to_json(),
        "epochs": epochs,
        "seed": seed,
        "architecture": [list(architecture.widths), list(architecture.blocks)],
    }
    kept = Checkpoint(checkpoint, "training", identity, training_state.ARRAYS)
    losses = training_state.restore(kept, network, optimizer, steps)
    lessons = _Lessons(order, steps, spec, seed)
    for epoch in range(len(losses), epochs):
        total = 0.0
        for step, lesson in enumerate(lessons(epoch)):
            done = epoch * steps + step
            progress(done, epochs * steps, _where(epoch, epochs, losses))
            for group in optimizer.param_groups:
                group["lr"] = RATE * one_cycle((done + 0.5) / (epochs * steps))
            loss = _loss(network, lesson)
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            clip_grad_norm_(network.parameters(), LARGEST_GRADIENT)
            optimizer.step()
            total += loss.item()
        if not math.isfinite(total):
            raise ValueError(f"the training has diverged in epoch {epoch + 1}: the loss is {total}")
        losses.append(total / steps)
        training_state.keep(kept, network, optimizer, losses)
    progress(epochs * steps, epochs * steps, _where(epochs - 1, epochs, losses))
    weights = parameters_to_vector(network.parameters()).detach().half()
    return LearnedPrior(
        spec, architecture, weights, Training(tuple(names), training.sha256, epochs, seed, tuple(losses))
    )


def _check(name: str, image: Tensor, spec: HOGSpec) -> None:
    least = least_side(spec.cell_size[0])
    if image.dim() != 2 or image.dtype != torch.float32 or not (image.min() >= 0 and image.max() <= 1):
        raise ValueError(f"{name}: expected an image (H, W) of float32 in 0…1")
    if min(image.shape) < least:
        raise ValueError(f"{name}: expected at least {least}x{least} pixels, got {image.shape[0]}x{image.shape[1]}")


def _beginning(spec: HOGSpec, architecture: Architecture, seed: int) -> tuple[PriorNetwork, torch.optim.AdamW]:
    with torch.random.fork_rng(devices=[]):  # layers begin with numbers of the global generator, which is not ours
        torch.manual_seed(seed)
        network = PriorNetwork(spec, architecture)
    return network, torch.optim.AdamW(network.parameters(), weight_decay=WEIGHT_DECAY)


class _Lesson(NamedTuple):
    """A batch of crops, and what the network is given for them."""

    inputs: Inputs
    crops: Tensor


class _Lessons:
    """The batches of each epoch.

    Finding the inputs takes a third of a step, so the crops of an epoch come again every few epochs.  What is random
    depends on the seed and the epoch alone, so that it is the same after an interruption.

    Args:
        order: the images, each as often as it gives crops.
        steps: of an epoch.
        spec: the dialect.
        seed: of everything random.
    """

    def __init__(self, order: Sequence[Tensor], steps: int, spec: HOGSpec, seed: int) -> None:
        self.order, self.steps, self.spec, self.seed = order, steps, spec, seed
        self._kept: dict[tuple[int, int], _Lesson] = {}

    def __call__(self, epoch: int) -> Iterator[_Lesson]:
        """The batches of an epoch, in an order of its own."""
        number = epoch % ROUNDS
        shuffled = random.Random(f"{self.seed} {number}").sample(range(len(self.order)), len(self.order))
        for step in random.Random(f"{self.seed} {epoch} steps").sample(range(self.steps), self.steps):
            lesson = self._kept.get((number, step))
            if lesson is None:
                images = [self.order[k] for k in shuffled[step * BATCH : (step + 1) * BATCH]]
                lesson = self._drawn(images, random.Random(f"{self.seed} {number} {step}"))
                if len(self._kept) < KEPT:
                    self._kept[number, step] = lesson
            yield lesson

    def _drawn(self, images: Sequence[Tensor], rng: random.Random) -> _Lesson:
        crops = draw_crops(images, self.spec.cell_size[0], rng)
        height, width = crops.shape[2:]
        return _Lesson(network_inputs(hog(crops, self.spec), self.spec, height, width), crops)


def _where(epoch: int, epochs: int, losses: Sequence[float]) -> str:
    return f"epoch {epoch + 1} of {epochs}" + (f", loss {losses[-1]:.4f}" if losses else "")


def one_cycle(progress: float) -> float:
    """The learning rate at ``progress`` 0…1, relative to the largest: up, and down to nearly 0, by half cosines."""
    if progress < WARM_UP:
        return FIRST + (1 - FIRST) * (1 - math.cos(math.pi * progress / WARM_UP)) / 2
    return LAST + (1 - LAST) * (1 + math.cos(math.pi * (progress - WARM_UP) / (1 - WARM_UP))) / 2


def _loss(network: PriorNetwork, lesson: _Lesson) -> Tensor:
    crops = lesson.crops
    height, width = crops.shape[2:]
    found: Tensor = network(lesson.inputs)[..., :height, :width]
    mean = crops.mean(dim=(2, 3), keepdim=True)
    contrast = crops.std(dim=(2, 3), keepdim=True, correction=0).clamp(min=LEAST_CONTRAST)
    similar = _similarity(found * contrast + mean, crops)
    return mse_loss(found, (crops - mean) / contrast) + STRUCTURE * (1 - similar)


def _similarity(a: Tensor, b: Tensor) -> Tensor:
    """SSIM of images in 0…1 in windows of 7x7 pixels, differentiable, with its usual constants."""

    def window(x: Tensor) -> Tensor:
        return avg_pool2d(x, 7, 1)

    mean_a, mean_b = window(a), window(b)
    squares = window(a * a) + window(b * b) - mean_a**2 - mean_b**2
    products = window(a * b) - mean_a * mean_b
    alike = (2 * mean_a * mean_b + 1e-4) * (2 * products + 9e-4)
    return (alike / ((mean_a**2 + mean_b**2 + 1e-4) * (squares + 9e-4))).mean()
