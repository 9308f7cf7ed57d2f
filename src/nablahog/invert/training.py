"""Learning a prior from photographs."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.utils import clip_grad_norm_

from ..hog.presets import as_spec
from ..hog.spec import HOGSpec
from .checkpoint import Checkpoint
from .crops import least_side
from .learned import LearnedPrior, PriorLearning
from .network import make_network, network_class
from .prior_network import Architecture
from .provenance import check_images, digest_of_images
from .signed_training import SignedTraining
from .unsigned_training import UnsignedTraining

LARGEST_GRADIENT = 1.0
WARM_UP = 0.1  # share of the steps in which the rate rises
FIRST, LAST = 1 / 25, 1e-5  # the first and the last rate, relative to the largest
_MOMENTS = ("exp_avg", "exp_avg_sq")  # of AdamW, for each weight


class Training(Protocol):
    """What a network is trained with.

    Attributes:
        steps: of an epoch.
        crops: of an epoch.
        default_crops: of all epochs, by default.
        learning_rate: the largest.
        weight_decay: of AdamW.
    """

    steps: int
    crops: int
    default_crops: int
    learning_rate: float
    weight_decay: float

    def batches(self, epoch: int) -> Iterator[Any]:
        """Those of an epoch, NamedTuples of tensors; what is random depends on the seed and the epoch alone."""

    def loss(self, network: Any, batch: Any) -> Tensor:
        """Of the network in training, for one batch."""

    def finish(self, network: Any) -> None:
        """What is left to do when the network is trained."""


def train_prior(
    images: Mapping[str, Tensor],
    spec: HOGSpec | str,
    *,
    epochs: int | None = None,
    seed: int = 0,
    architecture: Architecture | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    device: torch.device | str = "cpu",
    progress: Callable[[int, int, str], None] = lambda done, total, what: None,
) -> LearnedPrior:
    """Learns, from photographs, which image to expect for a descriptor.

    The network predicts random crops, up to brightness and contrast: of signed descriptors pixel by pixel
    (:mod:`.signed_training`), of unsigned ones their regions, and which side of these is bright
    (:mod:`.unsigned_training`); a prior for one unsigned dialect is a prior for all.

    The result depends on the images, the spec, epochs, seed and architecture alone, as long as PyTorch, its number of
    threads and the device stay the same.

    Args:
        images: (H, W) each, float32 in 0…1, by name.
        spec: the dialect, or the name of a preset with its defaults; if it is signed, with square cells of 2, 4, 8 or
            16 pixels.
        epochs: passes over the images, in which larger ones give several crops to learn a signed spec from; by default
            as many as give 23,000 crops in all, or 300,000 of an unsigned spec.
        seed: of everything random.
        architecture: of the network; by default of 5.9 million weights for UoCTTI with cells of 8, of 5.3 million for
            unsigned specs.
        checkpoint: a file that is written after each epoch.  If it exists and is of the same training, this training is
            resumed, with the same result.  The file is not removed.  A damaged one is renamed, and the training starts
            afresh.
        device: where to compute.
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
    architecture = architecture or network_class(spec).default_architecture(spec)
    network_class(spec).check(spec, architecture)
    names = check_images(images, (least_side(spec.cell_size[0]),) * 2)
    kind = SignedTraining if spec.signed else UnsignedTraining
    training: Training = kind([images[name] for name in names], spec, seed)
    steps = training.steps
    if epochs is None:
        epochs = max(1, round(training.default_crops / training.crops))
    if epochs < 1:
        raise ValueError(f"epochs must be at least 1, got {epochs}")
    with torch.random.fork_rng(devices=[]):  # layers draw from the global generator, which must not change
        torch.manual_seed(seed)
        network = make_network(spec, architecture).to(device)
    network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # convolutions take a fifth less time
    optimizer = torch.optim.AdamW(network.parameters(), weight_decay=training.weight_decay)
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
    for epoch in range(len(losses), epochs):
        total = 0.0
        with torch.random.fork_rng():  # of what is left out in training
            torch.manual_seed(seed + epoch)
            for step, batch in enumerate(training.batches(epoch)):
                done = epoch * steps + step
                progress(done, epochs * steps, _report(epoch, epochs, losses))
                for group in optimizer.param_groups:
                    group["lr"] = training.learning_rate * one_cycle((done + 0.5) / (epochs * steps))
                loss = training.loss(network, type(batch)(*(part.to(device) for part in batch)))
                optimizer.zero_grad()
                loss.backward()  # type: ignore[no-untyped-call]
                clip_grad_norm_(network.parameters(), LARGEST_GRADIENT)
                optimizer.step()
                total += loss.item()
        if not math.isfinite(total):
            raise ValueError(f"the training has diverged in epoch {epoch + 1}: the loss is {total}")
        losses.append(total / steps)
        _save(saved, network, optimizer, losses)
    training.finish(network.eval())
    progress(epochs * steps, epochs * steps, _report(epochs - 1, epochs, losses))
    weights = torch.from_numpy(_flat(list(network.parameters()))).half()
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
    return torch.cat([tensor.detach().flatten() for tensor in tensors]).cpu().numpy()


def _report(epoch: int, epochs: int, losses: Sequence[float]) -> str:
    return f"epoch {epoch + 1} of {epochs}" + (f", loss {losses[-1]:.4f}" if losses else "")


def one_cycle(progress: float) -> float:
    """The learning rate at ``progress`` 0…1, relative to the largest: up, and down to nearly 0, by half cosines."""
    if progress < WARM_UP:
        return FIRST + (1 - FIRST) * (1 - math.cos(math.pi * progress / WARM_UP)) / 2
    return LAST + (1 - LAST) * (1 + math.cos(math.pi * (progress - WARM_UP) / (1 - WARM_UP))) / 2
