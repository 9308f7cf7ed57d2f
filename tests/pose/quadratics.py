"""Quadratics whose maxima are known, in place of a similarity."""

from __future__ import annotations

from typing import cast

import torch
from torch import Tensor

from nablahog.pose.ascent import UNITS
from nablahog.pose.similarity import Similarity

START = torch.tensor([100.0, 10, 3, 0, 5, -5], dtype=torch.float64)


class Quadratic:
    """A quadratic with its maximum at ``top``, in units of the parameters, jagged by ``jags``."""

    def __init__(self, top: Tensor, bend: Tensor, jags: float = 0.0) -> None:
        self.top, self.bend, self.jags, self.samples = top, bend, jags, 0

    def values(self, poses: Tensor) -> Tensor:
        return self.derivatives(poses)[0]

    def derivatives(self, poses: Tensor) -> tuple[Tensor, Tensor]:
        self.samples += len(poses)
        u = (poses - self.top) / UNITS
        jag, steep = self.jags * torch.sin(50 * u), 50 * self.jags * torch.cos(50 * u)
        values = 7 - 0.5 * torch.einsum("ni,ij,nj->n", u, self.bend, u) + jag.sum(1)
        return values, (steep - u @ self.bend) / UNITS


def quadratic(top: Tensor, jags: float = 0.0) -> tuple[Quadratic, Similarity]:
    mixed = torch.randn(6, 6, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    function = Quadratic(top, torch.eye(6, dtype=torch.float64) + 0.2 * mixed @ mixed.T, jags)
    return function, cast(Similarity, function)
