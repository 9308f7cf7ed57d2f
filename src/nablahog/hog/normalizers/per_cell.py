"""Normalisers that make of each cell's histogram a vector of as many numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal, TypeAlias

from .base import Footprint, Normalizer, root

if TYPE_CHECKING:
    from torch import Tensor

GlobalForm: TypeAlias = Literal["printed", "robust"]


class PerCell(Normalizer):
    """A normaliser that makes of each cell's histogram a vector of as many numbers, one for each bin."""

    def channels(self, bins: int, signed: bool) -> int:
        """As many as bins."""
        return bins

    def footprint(self, axis: int) -> Footprint:
        """Each cell."""
        return Footprint()

    def channel_names(self, bins: list[str], axes: list[str]) -> list[str]:
        """As bins are."""
        return bins

    def cell_entries(self, channels: Tensor, bins: int, signed: bool) -> Tensor:
        """All of it."""
        return channels


@dataclass(frozen=True)
class GlobalNorm(PerCell):
    """One normaliser for the whole descriptor, Eq. 7.

    Attributes:
        epsilon: the small positive constant ε, in units of votes on images of the spec's ``value_range``.
        form: ``"printed"`` is v / √(‖v‖ + ε), letter by letter what Eq. 7 says; ``"robust"`` is v / √(‖v‖² + ε²),
            Dalal and Triggs's L2-norm, which the paper's prose names.

    >>> from dataclasses import replace
    >>> from nablahog.hog import GlobalNorm
    >>> spec = replace(nablahog.presets.paper(), normalizer=GlobalNorm(form="robust"))
    >>> round(float(nablahog.hog(torch.rand(1, 1, 32, 32), spec).norm()), 3)  # the whole descriptor has length 1
    1.0
    """

    epsilon: float = 1e-5
    form: GlobalForm = "printed"
    kind: ClassVar[str] = "global"
    has_loops: ClassVar[bool] = True

    def reach(self) -> int | None:
        """The whole image."""
        return None

    def normalize(self, histograms: Tensor, signed: bool) -> Tensor:
        """Eq. 7: v / √(‖v‖ + ε), or v / √(‖v‖² + ε²), with v all cells and bins of one image."""
        energy = histograms.square().sum(dim=(1, 2, 3), keepdim=True)
        if self.form == "robust":
            return histograms * (energy + self.epsilon**2).rsqrt()
        # the derivative of v·‖v‖ vanishes where v does, so ‖v‖ may be taken as constant there
        return histograms * (root(energy) + self.epsilon).rsqrt()

    def image_factor(self, energy: float) -> float:
        """1 / √(‖v‖ + ε) or 1 / √(‖v‖² + ε²), rounded as in the compiled loops."""
        length = energy + self.epsilon**2 if self.form == "robust" else math.sqrt(energy) + self.epsilon
        return 1 / math.sqrt(length)

    def native_constants(self, bins: int, signed: bool) -> tuple[float, ...]:
        """ε and the form."""
        return self.epsilon, self.form == "robust"

    @property
    def fixes_contrast(self) -> bool:
        """As printed, the descriptor scales with the square root of the contrast."""
        return self.form == "printed"

    def invert(self, channels: Tensor) -> Tensor | None:
        """Eq. 7 solved for v: d = v / √(‖v‖ + ε) gives ‖v‖² - ‖d‖²‖v‖ - ‖d‖²ε = 0; the robust form keeps no scale."""
        if self.form == "robust":
            return channels
        energy = channels.square().sum(dim=(1, 2, 3), keepdim=True)
        norm = (energy + (energy.square() + 4 * energy * self.epsilon).sqrt()) / 2
        return channels * (norm + self.epsilon).sqrt()


@dataclass(frozen=True)
class CellNorm(PerCell):
    """Each cell's histogram for itself: v / max(‖v‖, ε) (MaskFeat).

    Attributes:
        epsilon: ε, in votes at the spec's ``value_range``.

    >>> from dataclasses import replace
    >>> from nablahog.hog import CellNorm
    >>> spec = replace(nablahog.presets.paper(), normalizer=CellNorm())
    >>> nablahog.hog(torch.rand(1, 1, 32, 32), spec).norm(dim=3).min().round(decimals=3)  # each cell has length 1
    tensor(1.)
    """

    epsilon: float = 1e-12
    kind: ClassVar[str] = "cell"
    has_loops: ClassVar[bool] = True
    fixes_contrast = False
    """Each cell has length 1."""

    def reach(self) -> int | None:
        """None but its own."""
        return 0

    def normalize(self, histograms: Tensor, signed: bool) -> Tensor:
        """(B, bins, rows, cols) to the same shape."""
        import torch

        length = root(histograms.square().sum(dim=1, keepdim=True))
        return histograms / torch.maximum(length, length.new_tensor(self.epsilon))

    def native_constants(self, bins: int, signed: bool) -> tuple[float, ...]:
        """ε."""
        return (self.epsilon,)

    def invert(self, channels: Tensor) -> Tensor | None:
        """The entries: nothing tells one cell's level from another's."""
        return channels


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
