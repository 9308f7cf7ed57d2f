"""What a training has reached, on disk: after a kill it goes on from the last whole epoch."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from ..archive import check_format, read_arrays, text
from ..hog.spec import HOGSpec
from ..output import replacing
from .learned import Training
from .network import Architecture

FORMAT = 1
_ARRAYS = ("format", "identity", "losses", "state")
_MOMENTS = ("exp_avg", "exp_avg_sq")  # what AdamW keeps for each weight


class Checkpoint:
    """One training's file.

    Args:
        path: where; None for nowhere.
        spec, architecture, training: what the result depends on.
        network: whose weights are kept.
        optimizer: AdamW of its parameters, whose moments are kept.
    """

    def __init__(
        self,
        path: str | os.PathLike[str] | None,
        spec: HOGSpec,
        architecture: Architecture,
        training: Training,
        network: nn.Module,
        optimizer: torch.optim.AdamW,
    ) -> None:
        self.path = None if path is None else Path(path)
        self.identity = {
            "images": training.sha256,
            "spec": spec.to_json(),
            "epochs": training.epochs,
            "seed": training.seed,
            "architecture": [list(architecture.widths), list(architecture.blocks)],
        }
        self.network, self.optimizer = network, optimizer

    def save(self, losses: list[float]) -> None:
        """Keeps all after an epoch; ``losses`` has one entry for each so far."""
        if self.path is None:
            return
        weights = list(self.network.parameters())
        state = [weights, *([self.optimizer.state[weight][moment] for weight in weights] for moment in _MOMENTS)]
        with replacing(self.path) as file:
            np.savez(
                file,
                format=np.array(FORMAT),
                identity=np.array(json.dumps(self.identity)),
                losses=np.array(losses),
                state=np.stack([_flat(tensors) for tensors in state]),
            )

    def restore(self, steps: int) -> list[float]:
        """Brings network and optimizer to where the file left them.

        Args:
            steps: of an epoch.

        Returns:
            The losses so far, none if there is no file.

        Raises:
            ValueError: it is of another training, damaged, or no such file.
        """
        if self.path is None or not self.path.exists():
            return []
        arrays = read_arrays(self.path, "checkpoint of a training", _ARRAYS)
        try:
            check_format(arrays, "checkpoint", FORMAT)
            identity = json.loads(text(arrays, "identity"))
            differing = [key for key, value in self.identity.items() if identity[key] != value]
        except (KeyError, TypeError, ValueError, RecursionError) as error:
            raise ValueError(f"{self.path}: the checkpoint cannot be read: {error}") from None
        if differing:
            raise ValueError(
                f"{self.path}: the checkpoint of another training (of other {', '.join(differing)}); "
                "finish that one, or remove the file"
            )
        losses, state = arrays["losses"], arrays["state"]
        weights = list(self.network.parameters())
        shape = (1 + len(_MOMENTS), sum(weight.numel() for weight in weights))
        whole = state.dtype == np.float32 and state.shape == shape and losses.dtype == np.float64 and losses.ndim == 1
        if not whole or not np.isfinite(state).all():
            raise ValueError(f"{self.path}: the checkpoint is damaged")
        sizes = [weight.numel() for weight in weights]
        parts = zip(weights, *(row.split(sizes) for row in torch.from_numpy(state)), strict=True)
        for weight, value, *moments in parts:
            weight.data.copy_(value.view_as(weight))
            self.optimizer.state[weight] = {
                "step": torch.tensor(float(len(losses) * steps)),
                **{name: of.view_as(weight).clone() for name, of in zip(_MOMENTS, moments, strict=True)},
            }
        reached: list[float] = losses.tolist()
        return reached


def _flat(tensors: list[Tensor]) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    return torch.cat([tensor.detach().flatten() for tensor in tensors]).numpy()
