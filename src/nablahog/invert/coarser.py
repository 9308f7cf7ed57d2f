"""What multi-scale-more knows of an image beside its own descriptor: those of the image shrunk."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

from ..hog.descriptor import histograms
from ..hog.engines import steps
from ..hog.spec import HOGSpec
from ..hog.steps import normalize_reference
from .priors import Prior


@dataclass(frozen=True, eq=False)
class CoarserDescriptor(Prior):
    """‖φ(Î') - φ(I')‖² / ‖φ(I')‖², where I' is the image at a coarser scale: a pixel is the mean of those it covers.

    0 where I' has no texture, and so φ(I') = 0.

    Attributes:
        descriptor: (B, rows, cols, channels), φ(I').
        spec: its dialect, as :func:`.histograms.searchable` gives it.  Of the roots of images, means of roots are taken
            for roots of means.
        factor: pixels that a pixel of I' covers, along each axis.
    """

    descriptor: Tensor
    spec: HOGSpec
    factor: int

    def terms(self, image: Tensor) -> Tensor:
        cells = histograms(avg_pool2d(image, self.factor), self.spec)
        difference = normalize_reference(cells, self.spec) - self.descriptor.permute(0, 3, 1, 2)
        return difference.flatten(1) * self._scale().sqrt().unsqueeze(1)

    def __call__(self, image: Tensor) -> Tensor:
        to_cells, normalize = steps(image.device, self.spec)
        cells = to_cells(avg_pool2d(image, self.factor), self.spec)
        difference = normalize(cells, self.spec) - self.descriptor.permute(0, 3, 1, 2)
        return self.weight * difference.square().sum(dim=(1, 2, 3)) * self._scale()

    def of(self, index: Tensor | slice) -> CoarserDescriptor:
        return replace(self, descriptor=self.descriptor[index])

    def _scale(self) -> Tensor:
        """1 / ‖φ(I')‖² (B,), 0 where that is 0."""
        size = self.descriptor.square().sum(dim=(1, 2, 3))
        return torch.where(size > 0, 1 / torch.where(size > 0, size, 1), 0)
