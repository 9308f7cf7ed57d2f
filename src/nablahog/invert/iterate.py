"""Where a search is, for those who look on while it runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import torch
from torch import Tensor

from ..hog.spec import HOGSpec
from .reconstruction import as_returned, relative_distance


@dataclass(frozen=True, eq=False, repr=False)
class Iterate:
    """The images that a search evaluated last, of some descriptors of a batch.

    Attributes:
        descriptors: which ones of the batch.
        evaluations: (b,), operator evaluations spent on each so far.
        distance: (b,), ‖φ(image) - descriptor‖ / ‖descriptor‖; of several samples for a descriptor, the mean of theirs.
        candidates: (b, K, 1, H, W), the samples for each, or its one image; of any brightness and contrast.  They are
            overwritten by the next evaluation.
        spec: the dialect.
    """

    descriptors: slice
    evaluations: Tensor
    distance: Tensor
    candidates: Tensor
    spec: HOGSpec

    @property
    def image(self) -> Tensor:
        """(b, 1, H, W) in 0…1, a copy; of several samples their mean, which is what they know of the image."""
        return as_returned(self.candidates.mean(dim=1), self.spec)


def at_start(images: Tensor, descriptor: Tensor, spec: HOGSpec) -> Iterate:
    """The images (B, 1, H, W) that a search begins with, before its first evaluation.

    Args:
        images: of any brightness and contrast; roots, where the dialect takes these.
        descriptor: (B, rows, cols, channels), that is searched for.
        spec: its dialect.
    """
    none = torch.zeros(len(images), dtype=torch.long, device=images.device)
    distance = relative_distance(as_returned(images, spec), descriptor, spec)
    return Iterate(slice(None), none, distance, images.unsqueeze(1), spec)


Watch: TypeAlias = Callable[[Iterate], None]
"""Called after each round of evaluations; what it raises ends the search."""
