"""The state of a network's training after an epoch, to and from a checkpoint."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from .checkpoint import Checkpoint

ARRAYS = ("losses", "state")
_MOMENTS = ("exp_avg", "exp_avg_sq")  # of AdamW, for each weight


def save(checkpoint: Checkpoint, network: nn.Module, optimizer: torch.optim.AdamW, losses: list[float]) -> None:
    """Saves the weights of ``network``, the moments of its ``optimizer`` and the ``losses`` of all epochs."""
    weights = list(network.parameters())
    state = [weights, *([optimizer.state[weight][moment] for weight in weights] for moment in _MOMENTS)]
    checkpoint.save({"losses": losses, "state": np.stack([_flat(tensors) for tensors in state])})


def restore(checkpoint: Checkpoint, network: nn.Module, optimizer: torch.optim.AdamW, steps: int) -> list[float]:
    """Sets network and optimizer to the state of the checkpoint, if there is one, after epochs of ``steps`` each.

    Returns:
        The losses of these epochs.

    Raises:
        ValueError: as :meth:`.Checkpoint.restore`.
    """
    arrays = checkpoint.restore()
    if arrays is None:
        return []
    losses, state = arrays["losses"], arrays["state"]
    weights = list(network.parameters())
    shape = (1 + len(_MOMENTS), sum(weight.numel() for weight in weights))
    valid = state.dtype == np.float32 and state.shape == shape and losses.dtype == np.float64 and losses.ndim == 1
    if not valid or not np.isfinite(state.astype(np.float32)).all():
        raise checkpoint.damaged()
    sizes = [weight.numel() for weight in weights]
    parts = zip(weights, *(row.split(sizes) for row in torch.from_numpy(state)), strict=True)
    for weight, value, *moments in parts:
        weight.data.copy_(value.view_as(weight))
        optimizer.state[weight] = {
            "step": torch.tensor(float(len(losses) * steps)),
            **{name: moment.view_as(weight).clone() for name, moment in zip(_MOMENTS, moments, strict=True)},
        }
    return [float(loss) for loss in losses]


def _flat(tensors: list[Tensor]) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    return torch.cat([tensor.detach().flatten() for tensor in tensors]).numpy()
