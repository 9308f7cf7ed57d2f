"""What networks of learned priors have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import NamedTuple

from torch import Tensor, nn
from torch.nn.functional import gelu

from ..hog.spec import HOGSpec

MOMENTUM = 0.02  # of the running means and variances of channels


@dataclass(frozen=True)
class Architecture:
    """Sizes of a network, an entry for each of its resolutions.

    For signed descriptors, the first is that of cells, and each other one twice as fine, to pixels; for unsigned ones,
    the first is that of cells, and each other one half as fine.

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


class Prediction(NamedTuple):
    """What a network predicts for descriptors.

    Attributes:
        images: (B, 1, H, W), of any brightness and contrast.
        votes: (B, colours · bins, rows, cols), the histograms recovered from the descriptors.
    """

    images: Tensor
    votes: Tensor


class PriorNetwork(nn.Module, ABC):
    """A network from descriptors to images.

    Args:
        spec: the dialect that it is for.
        architecture: as :meth:`check` allows.
    """

    @classmethod
    @abstractmethod
    def default_architecture(cls, spec: HOGSpec) -> Architecture:
        """The default architecture for ``spec``.

        Raises:
            ValueError: there can be no such network for descriptors of ``spec``.
        """

    @classmethod
    @abstractmethod
    def check(cls, spec: HOGSpec, architecture: Architecture) -> None:
        """Raises ValueError unless there can be a network of this architecture for descriptors of ``spec``."""

    @abstractmethod
    def predict(self, descriptor: Tensor, spec: HOGSpec, size: tuple[int, int]) -> Prediction:
        """From descriptors (B, rows, cols, channels), float32, of images of a size (height, width)."""


class ResidualBlock(nn.Module):
    """x plus a correction, 0 before training; in training, with a share ``dropout`` of channels left out."""

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
    """Its weights, before training."""
    for weights in layer.parameters():
        nn.init.zeros_(weights)
