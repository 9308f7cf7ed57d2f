"""Sums over pixels that the derivatives by all parameters of a pose are made of."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from ...runtime.compile import compiled


def moments(given: Tensor, moved: Tensor, x: Tensor, y: Tensor) -> Tensor:
    """Σ over pixels of ``given`` (B, H, W) times each of ``moved`` (B, 4, H, W), times powers of the pixels' x and y.

    Args:
        x, y: (B, 1, W) and (B, H, 1).

    Returns:
        (B, 4, 3, 3), float64: [..., m, n] is that with x^m y^n.
    """
    try:
        arrays = [part.numpy(force=True) for part in (given, moved, x[:, 0], y[:, :, 0])]
    except RuntimeError:  # inside a function transform tensors have numbers but show no memory
        powers_of_x = torch.cat([torch.ones_like(x), x, x * x], 1)[:, None].double()
        powers_of_y = torch.cat([torch.ones_like(y), y, y * y], 2)[:, None].double()
        return powers_of_x @ (moved * given[:, None]).double().mT @ powers_of_y
    sums = np.zeros((*moved.shape[:2], 3, 3))
    _moments(*map(np.ascontiguousarray, arrays), sums)
    return torch.from_numpy(sums)


@compiled
def _moments(given: Any, moved: Any, x: Any, y: Any, sums: Any) -> None:
    batch, kinds, height, width = moved.shape
    columns = np.empty((3, width))
    for b in range(batch):
        for kind in range(kinds):
            columns[:] = 0
            for i in range(height):
                first = np.float64(y[b, i])
                second = first * first
                for j in range(width):  # side by side, which a sum would not be
                    part = np.float64(given[b, i, j] * moved[b, kind, i, j])
                    columns[0, j] += part
                    columns[1, j] += part * first
                    columns[2, j] += part * second
            for n in range(3):
                for j in range(width):
                    part, first = columns[n, j], np.float64(x[b, j])
                    sums[b, kind, 0, n] += part
                    sums[b, kind, 1, n] += part * first
                    sums[b, kind, 2, n] += part * first * first
