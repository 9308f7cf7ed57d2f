"""A learned prior: the image that a network expects for a descriptor.  The other inversions learn nothing."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor
from torch.nn.utils import vector_to_parameters

from ..hog.channels import mirrored
from ..hog.presets import as_spec
from ..hog.spec import HOGSpec
from ..io.learned_model import SPEC, LearnedModel, account, check_tensor, integers, tensor
from .checks import check_descriptor
from .network import Architecture, PriorNetwork, check_spec, network_inputs, weight_count
from .options import Objective, Search
from .preimage import reconstruct
from .provenance import Learning
from .quality import QualityName
from .reconstruction import Reconstruction
from .start import at_contrast

LARGEST = float(torch.finfo(torch.float16).max)


@dataclass(frozen=True, kw_only=True)
class PriorLearning(Learning):
    """How a prior was learned.

    Attributes:
        epochs: passes over the images.
        losses: the mean loss of each epoch.
    """

    epochs: int
    losses: tuple[float, ...]


@dataclass(frozen=True, eq=False, repr=False)
class LearnedPrior(LearnedModel):
    """A network from a descriptor to an image, near the mean of all photographs that have this descriptor.

    :meth:`reconstruct` finds a pre-image near that image.

    Attributes:
        spec: the dialect that it was learned for; signed, with square cells of 2, 4, 8 or 16 pixels.
        architecture: of its network.
        weights: all of them, (n,), float16, finite.
        learning: how it was learned.

    Raises:
        ValueError: these contradict each other.

    >>> images = {"noise": torch.rand(96, 96, generator=torch.Generator().manual_seed(0))}
    >>> prior = nablahog.train_prior(images, nablahog.presets.uoctti(cell_size=8), epochs=1)

    >>> descriptor = nablahog.hog(torch.rand(1, 1, 32, 32), prior.spec)
    >>> search = nablahog.invert.Search(max_evaluations=10)
    >>> prior.reconstruct(descriptor, prior.spec, search=search).image.shape
    torch.Size([1, 1, 32, 32])
    """

    KIND = "learned prior"
    NOUN = "prior"
    ARRAYS: ClassVar = {
        "spec": SPEC,
        "widths": integers(),
        "blocks": integers(),
        "weights": tensor(np.float16),
        "training": account(PriorLearning),
    }

    spec: HOGSpec
    architecture: Architecture
    weights: Tensor
    learning: PriorLearning

    def __post_init__(self) -> None:
        check_spec(self.spec, self.architecture)
        shape = (weight_count(self.spec, self.architecture),)
        check_tensor("weights", self.weights, torch.float16, shape, -LARGEST, LARGEST)

    @property
    def summary(self) -> str:
        learning = self.learning
        return (
            f"{len(learning.images)} images, {learning.epochs} epochs, last loss {learning.losses[-1]:.4f}, "
            f"{len(self.weights):,} weights"
        )

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
        self.spec.check_same(as_spec(spec), f"the {self.NOUN}")

    @torch.no_grad()
    def expected(self, descriptor: Tensor, spec: HOGSpec | str, image_size: tuple[int, int]) -> Tensor:
        """The images of the network, (B, 1, H, W) around 0.5, at the contrast of the histograms.

        Where the descriptor determines that of the mirrored image, the mean of both predictions is taken.

        Args:
            descriptor: (B, rows, cols, channels), float32 or float64, on any device.
            spec: its dialect, or the name of a preset with its defaults; it must be the prior's.
            image_size: (height, width).

        Raises:
            TypeError: the descriptor is no float32 or float64 tensor.
            ValueError: the spec is another one, or the descriptor's shape contradicts it, or it holds NaN or Inf.
        """
        spec = as_spec(spec)
        self.check(spec)
        height, width = check_descriptor(descriptor, spec, image_size)
        single = descriptor.float()
        network = self._network.to(descriptor.device)
        inputs = network_inputs(single, spec, height, width)
        image: Tensor = network(inputs)[..., :height, :width]
        mirrored_descriptor = mirrored(single, spec, width)
        if mirrored_descriptor is not None:
            other: Tensor = network(network_inputs(mirrored_descriptor, spec, height, width))[..., :height, :width]
            image = (image + other.flip(3)) / 2
        return at_contrast(image, inputs.votes, spec).to(descriptor.dtype)

    def reconstruct(
        self,
        descriptor: Tensor,
        spec: HOGSpec | str,
        image_size: Sequence[int] | None = None,
        *,
        quality: QualityName = "best",
        seed: int = 0,
        start: Tensor | None = None,
        search: Search = Search(),
        objective: Objective = Objective(),
        progress: Callable[[int, int], None] | None = None,
    ) -> Reconstruction:
        """:func:`nablahog.reconstruct` near :meth:`expected`, with its other options.

        Raises:
            TypeError, ValueError: as :func:`nablahog.reconstruct`; the spec is not the prior's.
        """
        began, spec = time.perf_counter(), as_spec(spec)
        self.check(spec)
        size = check_descriptor(descriptor, spec, image_size)
        result = reconstruct(
            descriptor,
            spec,
            size,
            quality=quality,
            seed=seed,
            start=start,
            expected=self.expected(descriptor, spec, size),
            search=search,
            objective=objective,
            progress=progress,
        )
        return replace(result, seconds=time.perf_counter() - began)

    @cached_property
    def _network(self) -> PriorNetwork:
        with torch.device("meta"):
            network = PriorNetwork(self.spec, self.architecture)
        network.to_empty(device="cpu")
        vector_to_parameters(self.weights.float().cpu(), network.parameters())
        return network.eval()
