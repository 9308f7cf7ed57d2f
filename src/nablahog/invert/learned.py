"""A learned prior: what photographs look like, given a descriptor.  The other ways to invert one learn nothing."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.utils import vector_to_parameters

from ..hog.spec import HOGSpec
from ..io.npz import account_of, account_to_text, check_format, naming, read_arrays, text, write_arrays
from .mirror import mirrored
from .network import Architecture, PriorNetwork, check_spec, network_inputs, weight_count
from .preimage import Reconstruction, check_descriptor, reconstruct
from .start import at_contrast

FORMAT = 1
_ARRAYS = ("format", "spec", "widths", "blocks", "weights", "training")


@dataclass(frozen=True)
class Training:
    """How a prior was learned.

    Attributes:
        images: the names of the images, sorted.
        sha256: of the images, in this order, hexadecimal.
        epochs: passes over them.
        seed: of everything random.
        losses: the mean loss of each epoch.
    """

    images: tuple[str, ...]
    sha256: str
    epochs: int
    seed: int
    losses: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class LearnedPrior:
    """A network that expects, from a descriptor, an image: near the mean of all photographs that have it.

    :meth:`reconstruct` then finds an image near it that has the descriptor.

    Attributes:
        spec: the dialect that it was learned for; signed, with square cells of 2, 4, 8 or 16 pixels.
        architecture: of its network.
        weights: all of them, (n,), float16, finite.
        training: how it was learned.

    Raises:
        ValueError: these contradict each other.
    """

    spec: HOGSpec
    architecture: Architecture
    weights: Tensor
    training: Training

    def __post_init__(self) -> None:
        check_spec(self.spec, self.architecture)
        shape = (weight_count(self.spec, self.architecture),)
        if self.weights.dtype != torch.float16 or self.weights.shape != shape:
            raise ValueError(
                f"the weights must be float16 of shape {shape}, got {self.weights.dtype} of {tuple(self.weights.shape)}"
            )
        if not torch.isfinite(self.weights).all():
            raise ValueError("the weights must be finite, got NaN or Inf")

    def check(self, spec: HOGSpec) -> None:
        """Raises ValueError if descriptors of ``spec`` are not what it was learned for."""
        self.spec.check_same(spec, "the prior")

    @torch.no_grad()
    def expected(self, descriptor: Tensor, spec: HOGSpec, image_size: tuple[int, int]) -> Tensor:
        """The images to expect, (B, 1, H, W) around 0.5, at the contrast of the histograms.

        Where the mirrored image's descriptor is known, what is expected of it is averaged in.

        Args:
            descriptor: (B, rows, cols, channels), float32 or float64, on any device.
            spec: its dialect, which must be the prior's.
            image_size: (height, width).

        Raises:
            ValueError: the spec is another one, or the descriptor's shape contradicts it, or it holds NaN or Inf.
        """
        self.check(spec)
        height, width = image_size
        shape = (*spec.grid(height, width), spec.channels)
        if descriptor.dim() != 4 or descriptor.shape[1:] != shape:
            raise ValueError(
                f"{spec.named} descriptor of an image of {height}x{width} pixels must have shape "
                f"{shape} (rows, cols, channels) after that of the batch, got {tuple(descriptor.shape)}"
            )
        if not torch.isfinite(descriptor).all():
            raise ValueError("the descriptor must be finite, got NaN or Inf")
        single = descriptor.float()
        network = self._network.to(descriptor.device)
        inputs = network_inputs(single, spec, height, width)
        image: Tensor = network(inputs)[..., :height, :width]
        mirror = mirrored(single, spec, width)
        if mirror is not None:
            other: Tensor = network(network_inputs(mirror, spec, height, width))[..., :height, :width]
            image = (image + other.flip(3)) / 2
        return at_contrast(image, inputs.votes, spec).to(descriptor.dtype)

    def reconstruct(
        self,
        descriptor: Tensor,
        spec: HOGSpec,
        image_size: tuple[int, int] | None = None,
        **options: Any,
    ) -> Reconstruction:
        """:func:`nablahog.reconstruct` with what this prior expects, and its other ``options``.

        Raises:
            TypeError, ValueError: as :func:`nablahog.reconstruct`; the spec is not the prior's.
        """
        self.check(spec)
        size = check_descriptor(descriptor, spec, image_size)
        began = time.perf_counter()
        expected = self.expected(descriptor, spec, size)
        found = reconstruct(descriptor, spec, size, expected=expected, **options)
        return replace(found, seconds=time.perf_counter() - began)

    @cached_property
    def _network(self) -> PriorNetwork:
        with torch.device("meta"):
            network = PriorNetwork(self.spec, self.architecture)
        network.to_empty(device="cpu")
        vector_to_parameters(self.weights.float().cpu(), network.parameters())
        return network.eval()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes it to the file ``path``, whatever its name ends in.  The file is replaced whole or not at all.

        It is an .npz archive of the arrays ``format`` (1), ``spec`` (its JSON), ``widths``, ``blocks``, ``weights`` and
        ``training`` (JSON).

        Raises:
            OSError: the file cannot be written.
        """
        arrays = {
            "spec": self.spec.to_json(),
            "widths": self.architecture.widths,
            "blocks": self.architecture.blocks,
            "weights": self.weights.cpu().numpy(),
            "training": account_to_text(self.training),
        }
        write_arrays(path, FORMAT, arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> LearnedPrior:
        """The prior that :meth:`save` wrote.  Never unpickles, so nothing in the file is ever run.

        Raises:
            FileNotFoundError: there is no such file.
            ValueError: it is no such archive, is damaged, lacks an array, holds pickled objects, NaN or Inf, or its
                arrays contradict each other.
        """
        arrays = read_arrays(path, "learned prior", _ARRAYS)
        with naming(path):
            check_format(arrays, "learned prior", FORMAT)
            widths, blocks = (_integers(name, arrays[name]) for name in ("widths", "blocks"))
            weights = arrays["weights"]
            if weights.dtype != np.float16:
                raise ValueError(f"the weights must be float16, got {weights.dtype}")
            return cls(
                HOGSpec.from_json(text(arrays, "spec")),
                Architecture(widths, blocks),
                torch.from_numpy(weights),
                account_of(Training, text(arrays, "training")),
            )


def _integers(name: str, array: NDArray[Any]) -> tuple[int, ...]:
    if array.ndim != 1 or array.dtype.kind not in "iu":
        raise ValueError(f"{name} must be a list of integers, got {array.dtype} of shape {array.shape}")
    return tuple(array.tolist())
