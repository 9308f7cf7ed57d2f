"""The base of learned priors' networks."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from torch import Tensor, nn
from torch.nn.functional import gelu

from ..hog.spec import HOGSpec

MOMENTUM = 0.02  # of the running means and variances of channels
HISTOGRAM_EVALUATIONS = 60  # of the normaliser, to recover histograms; enough for a network, the search uses more


@dataclass(frozen=True)
class Architecture:
    """Sizes of a network, an entry for each of its resolutions.

    The first resolution is that of cells.  For signed descriptors each other one is twice as fine, down to two pixels;
    for unsigned ones, half as fine.

    Attributes:
        widths: channels, 1 … 1024.
        blocks: residual blocks, 0 … 64.

    Raises:
        ValueError: they are out of their range, or not of the same length.
    """

    widths: tuple[int, ...]
    blocks: tuple[int, ...]

    def __post_init__(self) -> None:
        if not self.widths or len(self.widths) != len(self.blocks):
            raise ValueError(f"expected as many widths as blocks, got {self.widths} and {self.blocks}")
        for name, numbers, least, most in (("widths", self.widths, 1, 1024), ("blocks", self.blocks, 0, 64)):
            if not all(type(n) is int and least <= n <= most for n in numbers):
                raise ValueError(f"{name} must be integers of {least} … {most}, got {numbers}")


class PriorNetwork(nn.Module, ABC):
    """A network from descriptors to images, made from an :class:`Architecture`.

    Attributes:
        KIND: of its descriptors.
        DEFAULT: its default architecture.
    """

    KIND: ClassVar[str]
    DEFAULT: ClassVar[Architecture]

    @abstractmethod
    def __init__(self, architecture: Architecture) -> None:
        super().__init__()

    @classmethod
    def check(cls, architecture: Architecture) -> None:
        """Raises ValueError unless the network can have this architecture."""
        resolutions = len(cls.DEFAULT.widths)
        if len(architecture.widths) != resolutions:
            raise ValueError(f"a prior for {cls.KIND} descriptors has {resolutions} widths, got {architecture.widths}")

    @abstractmethod
    def predict(self, descriptor: Tensor, spec: HOGSpec, size: tuple[int, int]) -> tuple[Tensor, Tensor]:
        """Images (B, 1, H, W) of any contrast, and the histograms recovered from the descriptors, in float32."""


class ResidualBlock(nn.Module):
    """x plus a correction, 0 before training; in training, with a share ``dropout`` of channels dropped."""

    def __init__(self, width: int, dropout: float = 0.0) -> None:
        super().__init__()
        self.a, self.b = (nn.Conv2d(width, width, 3, padding=1) for _ in range(2))
        self.normalise_a, self.normalise_b = (nn.BatchNorm2d(width, momentum=MOMENTUM) for _ in range(2))
        self.dropout = nn.Dropout2d(dropout)
        set_to_zero(self.b)

    def forward(self, x: Tensor) -> Tensor:
        correction: Tensor = self.b(self.dropout(gelu(self.normalise_b(self.a(gelu(self.normalise_a(x)))))))
        return x + correction


def set_to_zero(layer: nn.Module) -> None:
    """Sets its weights to 0, before training."""
    for weights in layer.parameters():
        nn.init.zeros_(weights)
