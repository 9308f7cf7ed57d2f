"""Fitting a network to photographs: the loop that all trainings share, which can be interrupted and resumed."""

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

from .checkpoint import Checkpoint
from .weights import flat

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


def epoch_count(training: Training, epochs: int | None) -> int:
    """``epochs``; if None, as many as have about the training's default number of crops.

    Raises:
        ValueError: ``epochs`` is below 1.
    """
    if epochs is None:
        return max(1, round(training.default_crops / training.crops))
    if epochs < 1:
        raise ValueError(f"epochs must be at least 1, got {epochs}")
    return epochs


def fit(
    make: Callable[[], nn.Module],
    training: Training,
    identity: Mapping[str, object],
    *,
    epochs: int,
    seed: int,
    checkpoint: str | os.PathLike[str] | None,
    device: torch.device | str,
    progress: Callable[[int, int, str], None],
) -> tuple[Tensor, list[float]]:
    """Fits a network by AdamW, at a rate that rises, and falls to nearly 0.

    Args:
        make: the network before training; its weights may be drawn from the global generator, which is not changed.
        training: its batches and its loss.
        identity: what the result depends on, as of :class:`.Checkpoint`.
        epochs: at least 1.
        seed: of the weights, and of what the network draws in training.
        checkpoint: a file that is written after each epoch, and that a training is resumed from; None for no file.
        device: where to compute.
        progress: called with the steps done, their number, and epoch and loss.

    Returns:
        The weights, (n,), float32, on the CPU, and the mean loss of each epoch.

    Raises:
        ValueError: the checkpoint is of another training; the training diverges.
        OSError: the checkpoint cannot be read or written.
    """
    steps = training.steps
    with torch.random.fork_rng(devices=[]):  # layers draw from the global generator, which must not change
        torch.manual_seed(seed)
        network = make().to(device)
    network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # convolutions take a fifth less time
    optimizer = torch.optim.AdamW(network.parameters(), weight_decay=training.weight_decay)
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
    return flat(network.parameters()), losses


def _save(checkpoint: Checkpoint, network: nn.Module, optimizer: torch.optim.AdamW, losses: list[float]) -> None:
    """Saves the weights of ``network``, the moments of its ``optimizer`` and the ``losses`` of all epochs."""
    weights = list(network.parameters())
    state = [weights, *([optimizer.state[weight][moment] for weight in weights] for moment in _MOMENTS)]
    checkpoint.save({"losses": losses, "state": torch.stack([flat(tensors) for tensors in state]).numpy()})


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


def _report(epoch: int, epochs: int, losses: Sequence[float]) -> str:
    return f"epoch {epoch + 1} of {epochs}" + (f", loss {losses[-1]:.4f}" if losses else "")


def one_cycle(progress: float) -> float:
    """The learning rate at ``progress`` 0…1, relative to the largest: up, and down to nearly 0, by half cosines."""
    if progress < WARM_UP:
        return FIRST + (1 - FIRST) * (1 - math.cos(math.pi * progress / WARM_UP)) / 2
    return LAST + (1 - LAST) * (1 + math.cos(math.pi * (progress - WARM_UP) / (1 - WARM_UP))) / 2
