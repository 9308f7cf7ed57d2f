"""Inversion by a feed-forward network that has learned images of descriptors (:mod:`.upconv_network`)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from typing import ClassVar

import numpy as np
from torch import Tensor

from ...hog.spec import HOGSpec
from ...invert.provenance import NetworkLearning
from ...io.learned_model import SPEC, account, integers, tensor
from ...io.network_weights import check_weights, with_weights
from .upconv_network import UpconvNetwork, check_widths, network_input
from .window_model import WindowModel

BATCH = 8  # descriptors whose images are computed at a time


@dataclass(frozen=True, eq=False, repr=False)
class Upconv(WindowModel):
    """A network from a descriptor to the image, near the mean of all photographs that have this descriptor.

    Brightness and contrast are its own; what exceeds 0…1 is clipped.

    Attributes:
        spec: the dialect that it was learned for.
        widths: channels at each resolution, from cells to pixels.
        weights: all of them, (n,), float16, finite.
        learning: how it was learned.

    Raises:
        ValueError: these contradict each other.
    """

    KIND = "up-convolutional network"
    NOUN = "network"
    ARRAYS: ClassVar = {
        "spec": SPEC,
        "widths": integers(),
        "weights": tensor(np.float16),
        "learning": account(NetworkLearning),
    }

    spec: HOGSpec
    widths: tuple[int, ...]
    weights: Tensor
    learning: NetworkLearning

    def __post_init__(self) -> None:
        check_widths(self.spec, self.widths)
        check_weights(self.weights, self._make)

    @property
    def summary(self) -> str:
        return f"{self.learning.summary}, {len(self.weights):,} weights"

    def _batch_size(self, rows: int, cols: int) -> int:
        return BATCH

    def _invert(self, descriptor: Tensor, size: tuple[int, int]) -> Tensor:
        height, width = size
        image: Tensor = self._network(network_input(descriptor, self.spec, height, width))
        return image[..., :height, :width].clamp(0, 1)

    @property
    def _make(self) -> partial[UpconvNetwork]:
        return partial(UpconvNetwork, self.spec, self.widths)

    @cached_property
    def _network(self) -> UpconvNetwork:
        return with_weights(self._make, self.weights)
