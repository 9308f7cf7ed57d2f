"""A learned prior: the image that a network expects for a descriptor.  The other inversions learn nothing."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor

from ..hog.presets import as_spec
from ..hog.spec import HOGSpec
from ..io.learned_model import SPEC, LearnedModel, account, integers, tensor
from ..io.network_weights import check_weights, with_weights
from .checks import check_descriptor
from .histograms import searchable
from .network import make_network, network_class
from .prior_network import Architecture, PriorNetwork
from .provenance import NetworkLearning
from .start import at_contrast
from .unsigned_network import UnsignedNetwork


@dataclass(frozen=True, eq=False, repr=False)
class LearnedPrior(LearnedModel):
    """A network from a descriptor to an image, near the mean of all photographs that have this descriptor.

    ``nablahog.reconstruct(…, prior=prior)`` finds a pre-image near that image.

    Attributes:
        spec: a dialect that it was learned for; the prior is for all signed dialects, or for all unsigned ones.
        architecture: of its network.
        weights: all of them, (n,), float16, finite.
        learning: how it was learned.

    Raises:
        ValueError: these contradict each other.

    >>> images = {"noise": torch.rand(96, 96, generator=torch.Generator().manual_seed(0))}
    >>> prior = nablahog.train_prior(images, nablahog.presets.uoctti(cell_size=8), epochs=1)

    >>> descriptor = nablahog.hog(torch.rand(1, 1, 32, 32), prior.spec)
    >>> nablahog.reconstruct(descriptor, prior.spec, prior=prior, quality="fast").image.shape
    torch.Size([1, 1, 32, 32])
    """

    KIND = "learned prior"
    NOUN = "prior"
    COMPRESSED = True  # the names of thousands of photographs are a tenth of it
    ARRAYS: ClassVar = {
        "spec": SPEC,
        "widths": integers(),
        "blocks": integers(),
        "weights": tensor(np.float16),
        "training": account(NetworkLearning),
    }

    spec: HOGSpec
    architecture: Architecture
    weights: Tensor
    learning: NetworkLearning

    def __post_init__(self) -> None:
        network_class(self.spec).check(self.spec, self.architecture)
        check_weights(self.weights, partial(make_network, self.spec, self.architecture))

    @cached_property
    def signed(self) -> bool:
        """Whether it is for signed descriptors."""
        return searchable(self.spec).signed

    @property
    def summary(self) -> str:
        return f"{self.learning.summary}, {len(self.weights):,} weights"

    def _values(self) -> dict[str, Any]:
        widths, blocks = self.architecture.widths, self.architecture.blocks
        return {
            "spec": self.spec,
            "widths": widths,
            "blocks": blocks,
            "weights": self.weights,
            "training": self.learning,
        }

    @classmethod
    def _of(cls, values: dict[str, Any]) -> LearnedPrior:
        architecture = Architecture(values["widths"], values["blocks"])
        return cls(values["spec"], architecture, values["weights"], values["training"])

    def check(self, spec: HOGSpec | str) -> None:
        """Raises ValueError if descriptors of ``spec`` are not what it was learned for."""
        spec = as_spec(spec)
        own, other = ("signed" if signed else "unsigned" for signed in (self.signed, searchable(spec).signed))
        if own != other:
            raise ValueError(f"the {self.NOUN} was learned for {own} descriptors, {spec.named} descriptor is {other}")

    @torch.no_grad()
    def expected(self, descriptor: Tensor, spec: HOGSpec | str, image_size: tuple[int, int]) -> Tensor:
        """The images of the network, (B, 1, H, W) around 0.5, at the contrast of the histograms.

        The mean of what it predicts for the image and for the mirrored one.  Of a dialect of the roots of images, the
        expected roots.

        Args:
            descriptor: (B, rows, cols, channels), float32 or float64, on any device.
            spec: its dialect, or the name of a preset with its defaults; signed if the prior's is, else unsigned.
            image_size: (height, width).

        Raises:
            TypeError: the descriptor is no float32 or float64 tensor.
            ValueError: the spec is another one, or the descriptor's shape contradicts it, or it holds NaN or Inf.
        """
        spec = as_spec(spec)
        self.check(spec)
        size = check_descriptor(descriptor, spec, image_size)
        images, votes = self._network.to(descriptor.device).predict(descriptor.float(), spec, size)
        return at_contrast(images, votes, searchable(spec)).to(descriptor.dtype)

    @torch.no_grad()
    def samples(
        self, descriptor: Tensor, spec: HOGSpec | str, image_size: tuple[int, int], count: int, *, seed: int = 0
    ) -> Tensor:
        """Draws of images that the network thinks possible, (B, count, 1, H, W), as :meth:`expected` has them.

        In each draw another share of what the network sees in the large is left out, and which side is bright is drawn
        by :meth:`polarity_confidence`.

        Args:
            descriptor, spec, image_size: as of :meth:`expected`.
            count: draws of each descriptor.
            seed: of the draws; the same for every descriptor of the batch.

        Raises:
            TypeError: as :meth:`expected`.
            ValueError: as :meth:`expected`; the prior is for signed descriptors, which leave no regions open.
        """
        spec = as_spec(spec)
        self.check(spec)
        size = check_descriptor(descriptor, spec, image_size)
        network = self._network.to(descriptor.device)
        if not isinstance(network, UnsignedNetwork):
            raise ValueError("samples are drawn of unsigned descriptors, this prior is for signed ones")
        draws, votes = network.draws(descriptor.float(), spec, size, count, seed)
        images = at_contrast(draws, votes.repeat_interleave(count, dim=0), searchable(spec))
        return images.to(descriptor.dtype).reshape(-1, count, 1, *size)

    @torch.no_grad()
    def polarity_confidence(self, images: Tensor, descriptor: Tensor, spec: HOGSpec | str) -> Tensor:
        """How likely it is that images with unsigned descriptors are no negatives.

        Args:
            images: (B, 1, H, W), of any contrast.
            descriptor: (B, rows, cols, channels), theirs, float32 or float64.
            spec: its dialect, or the name of a preset with its defaults.

        Returns:
            (B,) in 0…1; that of the negatives is the rest to 1.  1 for signed descriptors, which know.

        Raises:
            TypeError, ValueError: as :meth:`expected`.
        """
        spec = as_spec(spec)
        self.check(spec)
        check_descriptor(descriptor, spec, (images.shape[2], images.shape[3]))
        network = self._network.to(descriptor.device)
        if not isinstance(network, UnsignedNetwork):
            return descriptor.new_ones(len(descriptor))
        return network.polarity_confidence(images.float(), descriptor.float(), spec).to(descriptor.dtype)

    @cached_property
    def _network(self) -> PriorNetwork:
        return with_weights(partial(make_network, self.spec, self.architecture), self.weights)
