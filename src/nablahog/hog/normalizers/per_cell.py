"""Normalisers that make of each cell's histogram a vector of as many numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal, TypeAlias

from .base import Footprint, Identity, Normalizer, root

if TYPE_CHECKING:
    from torch import Tensor

GlobalForm: TypeAlias = Literal["printed", "robust"]


class PerCell(Normalizer):
    """A normaliser that makes of each cell's histogram a vector of as many numbers, one for each bin."""

    def channels(self, bins: int, signed: bool) -> int:
        return bins

    def footprint(self, axis: int) -> Footprint:
        return Footprint()

    def channel_names(self, bins: list[str], axes: list[str]) -> list[str]:
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

    def reach(self) -> int | None:
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

    def identities(self, channels: Tensor, bins: int, signed: bool, tolerance: float) -> Iterator[Identity]:
        """In the robust form the whole descriptor has length 1."""
        if self.form == "robust":
            lengths = channels.flatten(1).norm(dim=1)
            # so has any vector that was normalised afterwards
            yield Identity("the whole vector has length 1", lengths[lengths > 0] - 1, share=0.0)

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
    fixes_contrast = False
    """Each cell has length 1."""

    def reach(self) -> int | None:
        return 0

    def normalize(self, histograms: Tensor, signed: bool) -> Tensor:
        """(B, bins, rows, cols) to the same shape."""
        import torch

        length = root(histograms.square().sum(dim=1, keepdim=True))
        return histograms / torch.maximum(length, length.new_full((), self.epsilon))

    def identities(self, channels: Tensor, bins: int, signed: bool, tolerance: float) -> Iterator[Identity]:
        """Each histogram has length 1, if it is not 0."""
        lengths = channels.norm(dim=1)
        yield Identity(f"every {bins} numbers have length 1", lengths[lengths > 0] - 1)

    def native_constants(self, bins: int, signed: bool) -> tuple[float, ...]:
        """ε."""
        return (self.epsilon,)

    def invert(self, channels: Tensor) -> Tensor | None:
        """The entries: nothing tells one cell's level from another's."""
        return channels
