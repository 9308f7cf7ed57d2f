"""Where the training of a network is after an epoch, to be kept and to go on from."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from .checkpoint import Checkpoint

ARRAYS = ("losses", "state")
_MOMENTS = ("exp_avg", "exp_avg_sq")  # what AdamW keeps for each weight


def keep(checkpoint: Checkpoint, network: nn.Module, optimizer: torch.optim.AdamW, losses: list[float]) -> None:
    """Keeps the weights of ``network`` and the moments of its ``optimizer``; ``losses`` has one entry an epoch."""
    weights = list(network.parameters())
    state = [weights, *([optimizer.state[weight][moment] for weight in weights] for moment in _MOMENTS)]
    checkpoint.save({"losses": losses, "state": np.stack([_flat(tensors) for tensors in state])})


def restore(checkpoint: Checkpoint, network: nn.Module, optimizer: torch.optim.AdamW, steps: int) -> list[float]:
    """Brings network and optimizer to where they were kept, after epochs of ``steps`` each.

    Returns:
        The losses so far, none if nothing is kept.

    Raises:
        ValueError: as :meth:`.Checkpoint.restore`.
    """
    arrays = checkpoint.restore()
    if arrays is None:
        return []
    losses, state = arrays["losses"], arrays["state"]
    weights = list(network.parameters())
    shape = (1 + len(_MOMENTS), sum(weight.numel() for weight in weights))
    whole = state.dtype == np.float32 and state.shape == shape and losses.dtype == np.float64 and losses.ndim == 1
    if not whole or not np.isfinite(state.astype(np.float32)).all():
        raise checkpoint.damaged()
    sizes = [weight.numel() for weight in weights]
    parts = zip(weights, *(row.split(sizes) for row in torch.from_numpy(state)), strict=True)
    for weight, value, *moments in parts:
        weight.data.copy_(value.view_as(weight))
        optimizer.state[weight] = {
            "step": torch.tensor(float(len(losses) * steps)),
            **{name: of.view_as(weight).clone() for name, of in zip(_MOMENTS, moments, strict=True)},
        }
    reached: list[float] = losses.tolist()
    return reached


def _flat(tensors: list[Tensor]) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    return torch.cat([tensor.detach().flatten() for tensor in tensors]).numpy()
