"""Each cell's histogram normalised by its surroundings."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

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

    >>> from dataclasses import replace
    >>> from nablahog.hog import WindowNorm
    >>> spec = replace(nablahog.presets.paper(), normalizer=WindowNorm(sigma=1.0))
    >>> nablahog.hog(torch.rand(1, 1, 32, 32), spec).shape
    torch.Size([1, 4, 4, 9])
    """

    sigma: float = 1.0
    epsilon: float = 1e-5
    kind: ClassVar[str] = "window"
    fixes_contrast = False
    """Votes and their surroundings scale alike."""

    def reach(self) -> int | None:
        """3σ."""
        return math.floor(3 * self.sigma)

    def normalize(self, histograms: Tensor, signed: bool) -> Tensor:
        """(B, bins, rows, cols) to the same shape."""
        energy = histograms.square().sum(dim=1, keepdim=True)
        for axis in (-2, -1):
            energy = self._weighted_sum(energy, axis)
        return histograms * (energy + self.epsilon**2).rsqrt()

    def _weighted_sum(self, energy: Tensor, axis: int) -> Tensor:
        """Sums along an axis, always in the same order: a strip has the bits of the whole image."""
        from torch.nn.functional import pad

        cells = energy.shape[axis]
        reach = min(math.floor(3 * self.sigma), cells - 1)
        around = pad(energy, (reach, reach) if axis == -1 else (0, 0, reach, reach))
        total = energy  # its own weight is 1
        for apart in range(1, reach + 1):
            pair = around.narrow(axis, reach - apart, cells) + around.narrow(axis, reach + apart, cells)
            total = total + math.exp(-(apart**2) / (2 * self.sigma**2)) * pair
        return total
