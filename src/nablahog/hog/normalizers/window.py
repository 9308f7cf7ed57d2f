"""Each cell's histogram normalised by its surroundings."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from ..checks import check_positive
from .base import PerCell

if TYPE_CHECKING:
    from torch import Tensor


@dataclass(frozen=True)
class WindowNorm(PerCell):
    """Each cell's histogram by the energy around it: v / √(Σ_j w_j ‖v_j‖² + ε²) (Dalal and Triggs, Section 6.4).

    The weight of a cell at a distance of d cells is exp(-d² / 2σ²), along either axis 0 beyond 3σ.  There are no cells
    beyond the grid.

    Attributes:
        sigma: σ, in cells.
        epsilon: ε, in votes at the spec's ``value_range``.
    """

    sigma: float = 1.0
    epsilon: float = 1e-5
    kind: ClassVar[str] = "window"

    def __post_init__(self) -> None:
        check_positive("sigma", self.sigma)
        check_positive("epsilon", self.epsilon)

    def reach(self) -> int | None:
        """3σ."""
        return math.floor(3 * self.sigma)

    def normalize(self, histograms: Tensor, signed: bool) -> Tensor:
        """(B, bins, rows, cols) to the same shape."""
        energy = histograms.square().sum(dim=1, keepdim=True)
        by_row, by_col = (self._window(cells, energy) for cells in energy.shape[2:])
        return histograms * (by_row @ energy @ by_col + self.epsilon**2).rsqrt()

    def _window(self, cells: int, like: Tensor) -> Tensor:
        """Weights (cells, cells) along an axis."""
        import torch

        cell = torch.arange(cells, device=like.device)
        apart = (cell - cell.unsqueeze(1)).to(like)
        return torch.where(apart.abs() <= 3 * self.sigma, torch.exp(-(apart**2) / (2 * self.sigma**2)), 0.0)

    @property
    def fixes_contrast(self) -> bool:
        """Votes and their surroundings scale alike."""
        return False
