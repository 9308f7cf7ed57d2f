"""Each cell's histogram normalised for itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from .base import PerCell, root

if TYPE_CHECKING:
    from torch import Tensor


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
