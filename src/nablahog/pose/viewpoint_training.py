"""Learning a viewpoint prior from descriptors of known azimuth."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from torch import Tensor

from ..io.network_weights import flat, fold_statistics
from ..runtime.seeds import seeded
from .placement import equidistant_azimuths
from .viewpoint_network import WIDTH, ViewpointNetwork, mirrored
from .views import VIEW_COUNT

EPOCHS = 16
_BATCH = 64
_RATE, _DECAY = 2e-3, 0.01  # of AdamW, at its highest
_SPREAD = 8.0  # degrees: σ of the probabilities that it learns, around the true azimuth


def train_viewpoints(
    descriptors: Tensor,
    azimuths: Tensor,
    *,
    epochs: int = EPOCHS,
    width: int = WIDTH,
    seed: int = 0,
    progress: Callable[[int, int, str], None] = lambda done, total, what: None,
) -> tuple[Tensor, tuple[float, ...]]:
    """Weights (n,), float16, of a :class:`.viewpoint_network.ViewpointNetwork`, and the mean loss of each epoch.

    Half of the scenes are mirrored, at random.  The loss is the cross entropy with probabilities around the azimuth.

    Args:
        descriptors: (N, C, 16, 16), float32.
        azimuths: (N,), degrees.
        epochs: passes over them.
        width: of the network.
        seed: of the first weights, the order and what is mirrored.
        progress: called with the epochs done, their number, and the loss.

    Raises:
        ValueError: there are fewer than 64 descriptors, or not as many azimuths; ``epochs`` is below 1; the training
            diverges.
    """
    count = len(descriptors)
    if count < _BATCH or azimuths.shape != (count,) or epochs < 1:
        raise ValueError(
            f"expected at least {_BATCH} descriptors, as many azimuths and 1 epoch, "
            f"got {count}, {tuple(azimuths.shape)} and {epochs}"
        )
    with seeded(seed):
        network = ViewpointNetwork(descriptors.shape[1], width).train()
        optimizer = torch.optim.AdamW(network.parameters(), weight_decay=_DECAY)
        batches = count // _BATCH
        schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, _RATE, total_steps=epochs * batches)
        losses: list[float] = []
        for epoch in range(epochs):
            progress(epoch, epochs, f"loss {losses[-1]:.4f}" if losses else "")
            total = torch.zeros(())
            for some in torch.randperm(count)[: batches * _BATCH].reshape(batches, _BATCH):
                inputs, flips = descriptors[some], torch.rand(_BATCH) < 0.5
                inputs = torch.where(flips[:, None, None, None], mirrored(inputs), inputs)
                likely = likely_azimuths(torch.where(flips, -azimuths[some], azimuths[some]))
                loss = -(likely * network(inputs).log_softmax(1)).sum(1).mean()
                optimizer.zero_grad()
                loss.backward()
                optimizer.step()
                schedule.step()
                total += loss.detach()
            losses.append(float(total) / batches)
            if not math.isfinite(losses[-1]):
                raise ValueError(f"the training diverges: its loss is {losses[-1]} in epoch {epoch + 1}")
    fold_statistics(network)
    return flat(network.parameters()).half(), tuple(losses)


def likely_azimuths(azimuths: Tensor) -> Tensor:
    """Probabilities (N, 48) of the azimuths 0°, 7.5°, … around those (N,), degrees."""
    apart = (azimuths[:, None].double() - equidistant_azimuths(VIEW_COUNT) + 180) % 360 - 180
    return (-0.5 * (apart / _SPREAD).square()).softmax(1).float()
