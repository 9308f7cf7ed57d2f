"""The paper's similarity (Section 3.2): Σ ⟨φ(P_I), φ(P_f)⟩ over the visual elements P_I of the photograph.

φ is ∇HOG, Eq. 1-7, of a patch of pixels as an image of its own, so that each patch has its own normaliser, Eq. 7; P_f
is the patch of the rendering in the same region as P_I.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from ..hog import HOGSpec, hog
from ..hog.box import Box


@dataclass(frozen=True, eq=False)
class PatchTemplate:
    """The patches of a photograph's visual elements, which those of renderings are compared with.

    Attributes:
        spec: of φ.
        regions: of the N patches in the crop, whole pixels, all of one size, h x w.
        descriptors: φ(P_I), (N, rows, cols, C).
        shrink: 1, the crop is described as it is.
    """

    spec: HOGSpec
    regions: tuple[Box, ...]
    descriptors: Tensor
    shrink: int = 1

    def similarities(self, images: Tensor) -> Tensor:
        """Σ ⟨φ(P_I), φ(P_f)⟩, (B,), of images (B, 1, H, W)."""
        return self._products(cut_out(images, self.regions))

    def similarities_and_gradients(self, images: Tensor) -> tuple[Tensor, Tensor]:
        """Similarities (B,) of images (B, 1, H, W), and their gradients with respect to these."""
        patches = cut_out(images, self.regions).requires_grad_(True)
        with torch.enable_grad():
            similarities = self._products(patches)
        (grad_patches,) = torch.autograd.grad(similarities.sum(), patches)
        grad_images = torch.zeros_like(images)
        for (rows, cols), grad in zip(_slices(self.regions), grad_patches.unbind(1), strict=True):
            grad_images[:, :, rows, cols] += grad  # regions may overlap
        return similarities.detach(), grad_images

    def _products(self, patches: Tensor) -> Tensor:
        """The similarities (B,) of the patches P_f, (B, N, 1, h, w), all described at once."""
        descriptors = hog(patches.flatten(0, 1), self.spec).reshape(len(patches), -1)
        return descriptors @ self.descriptors.flatten()


def patch_template(image: Tensor, regions: Sequence[Box], spec: HOGSpec) -> PatchTemplate:
    """The template of the regions of one image (1, 1, H, W)."""
    descriptors = hog(cut_out(image, regions)[0], spec)
    return PatchTemplate(spec, tuple(regions), descriptors)


def cut_out(images: Tensor, regions: Sequence[Box]) -> Tensor:
    """Patches (B, N, 1, h, w) of images (B, 1, H, W) in N regions of one size."""
    return torch.stack([images[:, :, rows, cols] for rows, cols in _slices(regions)], dim=1)


def _slices(regions: Sequence[Box]) -> list[tuple[slice, slice]]:
    return [(region.rows, region.cols) for region in regions]
