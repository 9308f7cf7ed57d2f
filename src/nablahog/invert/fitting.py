"""Fitting a network to photographs: the loop that all trainings share, which can be interrupted and resumed."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import islice
from typing import Any, Literal, Protocol, TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.utils import clip_grad_norm_

from ..hog.checks import check_choice
from ..hog.spec import HOGSpec
from ..io.network_weights import flat, fold_statistics, unfold_statistics, with_weights
from ..runtime.seeds import seeded
from .checkpoint import Checkpoint
from .crops import least_side
from .provenance import NetworkLearning, check_images, digest_of_images, digest_of_weights

Precision: TypeAlias = Literal["float32", "bfloat16"]
LARGEST_GRADIENT = 1.0
AGAIN = 0.5  # the largest rate of a training that goes on from another, relative to the usual one
FEW = 20  # batches, of which means and variances are taken before such a training
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

    def calibrate(self, network: Any) -> None:
        """Makes what the trained network says of its own confidence true of images that it was not trained with."""


def default_precision(device: torch.device) -> Precision:
    """``"bfloat16"`` on a GPU that has instructions for it, else ``"float32"``."""
    if device.type == "cuda" and torch.cuda.is_bf16_supported(including_emulation=False):
        return "bfloat16"
    return "float32"


def learn_network(
    images: Mapping[str, Tensor],
    spec: HOGSpec,
    training: Callable[[Sequence[Tensor], HOGSpec, int], Training],
    make: Callable[[], nn.Module],
    architecture: Sequence[object],
    *,
    start: Tensor | None = None,
    epochs: int | None,
    seed: int,
    checkpoint: str | os.PathLike[str] | None,
    device: torch.device | str,
    precision: Precision | None,
    progress: Callable[[int, int, str], None],
) -> tuple[Tensor, NetworkLearning]:
    """Fits a network to photographs.

    Args:
        images: (H, W) each, float32 in 0…1, by name.
        spec: the dialect.
        training: from the images in the order of their names, the spec and the seed.
        make: as of :func:`fit`.
        architecture: of the network, values that are equal after a round trip through JSON.
        start: weights (n,), float16, to go on from; None for random ones.
        epochs: passes over the images; None for as many as have about the training's default number of crops.
        seed, checkpoint, device, progress: as of :func:`fit`.
        precision: as of :func:`fit`; None for :func:`default_precision`.

    Returns:
        The weights, (n,), float16, on the CPU, and how they were learned.

    Raises:
        ValueError: there are no images, or one is too small or holds other values; ``epochs`` is below 1; there is no
            such precision; else, and OSError, as :func:`fit`.
    """
    precision = precision or default_precision(torch.device(device))
    check_choice("precision", precision, Precision)
    names = check_images(images, (least_side(spec.cell_size[0]),) * 2)
    data = training([images[name] for name in names], spec, seed)
    if epochs is None:
        epochs = max(1, round(data.default_crops / data.crops))
    if epochs < 1:
        raise ValueError(f"epochs must be at least 1, got {epochs}")
    digest = digest_of_images(images)
    identity = {
        "images": digest,
        "spec": spec.to_json(),
        "epochs": epochs,
        "seed": seed,
        "architecture": architecture,
        "precision": precision,
    }
    of_start = ""
    if start is not None:
        identity["start"] = of_start = digest_of_weights(start)
    weights, losses = fit(
        make,
        data,
        identity,
        start=start,
        epochs=epochs,
        seed=seed,
        checkpoint=checkpoint,
        device=device,
        precision=precision,
        progress=progress,
    )
    learning = NetworkLearning(
        images=tuple(names),
        sha256=digest,
        seed=seed,
        epochs=epochs,
        losses=tuple(losses),
        start=of_start,
        precision=precision,
    )
    return weights.half(), learning


def fit(
    make: Callable[[], nn.Module],
    training: Training,
    identity: Mapping[str, object],
    *,
    start: Tensor | None = None,
    epochs: int,
    seed: int,
    checkpoint: str | os.PathLike[str] | None,
    device: torch.device | str,
    precision: Precision,
    progress: Callable[[int, int, str], None],
) -> tuple[Tensor, list[float]]:
    """Fits a network by AdamW, at a rate that rises, and falls to nearly 0.

    Args:
        make: the network before training; its weights may be drawn from the global generator, which is not changed.
        training: its batches and its loss.
        identity: what the result depends on, as of :class:`.Checkpoint`.
        start: weights (n,) to go on from, of an earlier training, at a rate that is at most :data:`AGAIN` of the
            largest; None for those of ``make``.
        epochs: at least 1.
        seed: of the weights, and of what the network draws in training.
        checkpoint: a file that is written after each epoch, and that a training is resumed from; None for no file.
        device: where to compute.
        precision: of convolutions and matrix products; ``"bfloat16"`` takes half the time where there are instructions
            for it.  Weights, their moments, and the loss stay float32.
        progress: called with the steps done, their number, and epoch and loss.

    Returns:
        The weights, (n,), float32, on the CPU, and the mean loss of each epoch.

    Raises:
        ValueError: the checkpoint is of another training; the training diverges.
        OSError: the checkpoint cannot be read or written.
    """
    steps = training.steps
    with seeded(seed):  # layers draw from the global generator, which must not change
        network = (make() if start is None else with_weights(make, start)).to(device)
    network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # convolutions take a fifth less time
    optimizer = torch.optim.AdamW(network.parameters(), weight_decay=training.weight_decay)
    saved = Checkpoint(checkpoint, "training", identity, ("losses", "state"))
    if start is not None:
        with seeded(seed):
            unfold_statistics(network, lambda: _losses(training, network, device))
    largest = training.learning_rate * (1.0 if start is None else AGAIN)
    losses = _restore(saved, network, optimizer, epochs, steps)
    for epoch in range(len(losses), epochs):
        of_steps: list[Tensor] = []
        with seeded(seed + epoch):  # what is left out in training
            for step, batch in enumerate(training.batches(epoch)):
                done = epoch * steps + step
                progress(done, epochs * steps, _report(epoch, epochs, losses))
                for group in optimizer.param_groups:
                    group["lr"] = largest * one_cycle((done + 0.5) / (epochs * steps))
                with torch.autocast(torch.device(device).type, torch.bfloat16, enabled=precision == "bfloat16"):
                    loss = training.loss(network, _on(device, batch))
                optimizer.zero_grad()
                loss.backward()  # type: ignore[no-untyped-call]
                clip_grad_norm_(network.parameters(), LARGEST_GRADIENT)
                optimizer.step()
                of_steps.append(loss.detach())  # no number yet: a GPU goes on with the next step
        total = sum(torch.stack(of_steps).tolist())
        if not math.isfinite(total):
            raise ValueError(f"the training has diverged in epoch {epoch + 1}: the loss is {total}")
        losses.append(total / steps)
        _save(saved, network, optimizer, losses)
    fold_statistics(network.eval())
    training.calibrate(network)
    progress(epochs * steps, epochs * steps, _report(epochs - 1, epochs, losses))
    return flat(network.parameters()), losses


def _on(device: torch.device | str, batch: Any) -> Any:
    return type(batch)(*(part.to(device) for part in batch))


def _losses(training: Training, network: nn.Module, device: torch.device | str) -> list[Tensor]:
    """Of the first few batches."""
    return [training.loss(network, _on(device, batch)) for batch in islice(training.batches(0), FEW)]


def _save(checkpoint: Checkpoint, network: nn.Module, optimizer: torch.optim.AdamW, losses: list[float]) -> None:
    """Saves weights and statistics of ``network``, moments of its ``optimizer``, and the ``losses`` of all epochs."""
    moments = [optimizer.state[weight][moment] for moment in _MOMENTS for weight in network.parameters()]
    checkpoint.save({"losses": losses, "state": flat([*network.parameters(), *_statistics(network), *moments]).numpy()})


def _restore(
    checkpoint: Checkpoint, network: nn.Module, optimizer: torch.optim.AdamW, epochs: int, steps: int
) -> list[float]:
    """Sets network and optimizer to the state of the checkpoint, if there is one, of ``epochs`` of ``steps`` each.

    Returns:
        The losses of the epochs that it is after.

    Raises:
        ValueError, OSError: as :meth:`.Checkpoint.restore`.
    """
    trained = list(network.parameters())
    weights = [*trained, *_statistics(network)]
    likes = [*weights, *(weight for _ in _MOMENTS for weight in trained)]
    sizes = [like.numel() for like in likes]
    stored = checkpoint.restore(lambda arrays: _state_in(arrays, sum(sizes), epochs))
    if stored is None:
        return []
    losses, state = stored
    values = [part.view_as(like) for part, like in zip(torch.split(state, sizes), likes, strict=True)]
    for weight, value in zip(weights, values, strict=False):
        weight.data.copy_(value)
    of_weights = values[len(weights) :]
    for k, weight in enumerate(trained):
        optimizer.state[weight] = {
            "step": torch.tensor(float(len(losses) * steps)),
            **{name: of_weights[k + j * len(trained)].clone() for j, name in enumerate(_MOMENTS)},
        }
    return losses


def _statistics(network: nn.Module) -> list[Tensor]:
    """The running means and variances that it normalises by."""
    return [buffer for buffer in network.buffers() if buffer.is_floating_point()]


def _state_in(arrays: dict[str, NDArray[np.generic]], size: int, epochs: int) -> tuple[list[float], Tensor]:
    """The losses, and weights and moments (size,).

    Raises:
        ValueError: they are impossible.
    """
    losses, state = arrays["losses"], arrays["state"]
    if state.dtype != np.float32 or state.shape != (size,) or losses.dtype != np.float64 or losses.ndim != 1:
        raise ValueError(f"expected {size} weights and moments, got {state.shape}")
    if not np.isfinite(state.astype(np.float32)).all() or not 1 <= len(losses) <= epochs:
        raise ValueError(f"the state after {len(losses)} of {epochs} epochs is impossible")
    return [float(loss) for loss in losses], torch.from_numpy(state)


def _report(epoch: int, epochs: int, losses: Sequence[float]) -> str:
    return f"epoch {epoch + 1} of {epochs}" + (f", loss {losses[-1]:.4f}" if losses else "")


def one_cycle(progress: float) -> float:
    """The learning rate at ``progress`` 0…1, relative to the largest: up, and down to nearly 0, by half cosines."""
    if progress < WARM_UP:
        return FIRST + (1 - FIRST) * (1 - math.cos(math.pi * progress / WARM_UP)) / 2
    return LAST + (1 - LAST) * (1 + math.cos(math.pi * (progress - WARM_UP) / (1 - WARM_UP))) / 2
