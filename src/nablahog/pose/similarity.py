"""How much a rendering's HOG is like the photograph's (Section 3.2), with its derivative by the pose.

* ``patches``, the paper's: Σ ⟨φ(P_I), φ(P_f)⟩ over the visual elements P_I of the photograph.  φ is ∇HOG, Eq. 1-7, of
  a patch of pixels as an image of its own, so that each patch has its own normaliser, Eq. 7; P_f is the patch of the
  rendering in the same region as P_I;
* ``calibrated``: ⟨Σ⁻¹(φ(I) − μ), φ(f)⟩ / √(φ(f)ᵀ Σ⁻¹ φ(f)) over the whole window: the score on the photograph of the
  rendering's linear discriminant Σ⁻¹ φ(f), in its standard deviations over arbitrary photographs.  Poses and models
  can be compared by it, however many edges they show.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeAlias, TypeVar

import torch
from torch import Tensor
from torch.nn import functional

from ..hog import hog
from ..hog.descriptor import histograms, normalize
from ..hog.spec import HOGSpec
from ..inputs.boxes import Box
from ..render import Renderer
from ..render.camera import pose_vjp
from ..runtime.pytorch import in_threads
from .background import COARSE_CELL, default_background, pose_spec
from .crop import ObjectCrop
from .whitening import Background, Whitener, cached_whitener

T = TypeVar("T")

_BATCH = 32  # renderings at a time, few enough for the processor's cache
_SIDELOBES = 2, 6  # cells: as far from its place a rendering is compared, too; neighbouring places are much alike
_SHRINK = 2  # of the crop in the coarse search, which finds as many poses in less time


def describe(images: Tensor, spec: HOGSpec) -> Tensor:
    """φ: gray images (B, 1, H, W) to descriptors (B, C, rows, cols)."""
    return normalize(histograms(images, spec), spec)


@lru_cache(maxsize=8)
def coarse_background(own: Background | None = None) -> tuple[Background, int]:
    """The background of the coarse search, by default that of :func:`.pose_spec`, and how much the crop is shrunk."""
    return (own, 1) if own is not None else (default_background(pose_spec(COARSE_CELL // _SHRINK)), _SHRINK)


@dataclass(frozen=True, eq=False)
class CalibratedTemplate:
    """The whitened descriptor of a whole crop, with which those of renderings are compared."""

    spec: HOGSpec  # of both descriptors
    weights: Tensor  # w = Σ⁻¹(φ(I) − μ), (C, rows, cols), float32
    whitener: Whitener  # Σ⁻¹
    shrink: int = 1  # factor by which the crop is made smaller before it is described

    def similarities(self, images: Tensor) -> Tensor:
        """Similarities (B,) of images (B, 1, H, W)."""
        return self.values(describe(images, self.spec))

    def similarities_and_gradients(self, images: Tensor) -> tuple[Tensor, Tensor]:
        """Similarities (B,) of images (B, 1, H, W), and their gradients with respect to these."""
        images = images.requires_grad_(True)
        with torch.enable_grad():
            descriptors = describe(images, self.spec)
            values, grad_descriptors = self.values_and_gradients(descriptors.detach())
            product = (descriptors * grad_descriptors).sum()  # a scalar: else PyTorch imports SymPy, for half a second
        (grad_images,) = torch.autograd.grad(product, images)
        return values, grad_images

    def values(self, descriptors: Tensor) -> Tensor:
        """Similarities (B,) of descriptors (B, C, rows, cols)."""
        values = descriptors.flatten(1) @ self.weights.flatten()
        return values / deviations(self.whitener.energies(descriptors))

    def values_and_gradients(self, descriptors: Tensor) -> tuple[Tensor, Tensor]:
        """Similarities (B,) of descriptors (B, C, rows, cols), and their gradients with respect to these."""
        values = descriptors.flatten(1) @ self.weights.flatten()
        whitened = self.whitener(descriptors)
        spread = deviations((descriptors * whitened).sum(dim=(1, 2, 3)))
        values = values / spread
        gradients = (self.weights - (values / spread)[:, None, None, None] * whitened) / spread[:, None, None, None]
        return values, gradients

    def sidelobe(self, image: Tensor) -> float:
        """The highest similarity of an image (1, 1, H, W) that is moved by some cells, as a share of that in its place.

        In 0…1, and 1 if it is not similar at all.  A regular pattern is as similar elsewhere, an object is not.
        """
        nearest, farthest = _SIDELOBES
        moved = functional.conv2d(self.weights[None], describe(image, self.spec), padding=farthest)[0, 0]
        offsets = torch.arange(-farthest, farthest + 1).abs()
        elsewhere, place = moved[torch.maximum(offsets[:, None], offsets) >= nearest].max(), moved[farthest, farthest]
        return float((elsewhere / place).clamp(0, 1)) if place > 0 else 1.0


def deviations(squared: Tensor) -> Tensor:
    """√(φᵀ Σ⁻¹ φ) from its square; infinite for an empty rendering, whose similarity and gradient become 0."""
    return torch.where(squared > 1e-9, squared, torch.inf).sqrt()


def calibrated_template(crop: ObjectCrop, background: Background, shrink: int = 1) -> CalibratedTemplate:
    """The template Σ⁻¹(φ − μ) of a whole crop, made ``shrink`` times smaller.

    Cells beyond the photograph are replaced by the mean μ.
    """
    small, spec = crop.downsample(shrink) if shrink > 1 else crop, background.spec
    whitener = cached_whitener(background, *spec.grid(*small.image.shape[2:]))
    descriptor = whitener.subtract_mean(describe(small.image, spec))
    x0, y0, x1, y1 = small.valid
    y, x = (
        (torch.arange(cells, dtype=torch.float32) + 0.5) * cell
        for cells, cell in zip(descriptor.shape[2:], spec.cell_size, strict=True)
    )
    valid = ((y >= y0) & (y <= y1))[:, None] & (x >= x0) & (x <= x1)
    return CalibratedTemplate(spec, whitener(descriptor * valid)[0], whitener, shrink)


@dataclass(frozen=True, eq=False)
class PatchTemplate:
    """The patches of a photograph's visual elements, with which the same patches of renderings are compared."""

    spec: HOGSpec  # of φ
    regions: tuple[Box, ...]  # of the N patches in the crop, whole pixels, all of one size, h x w
    descriptors: Tensor  # φ(P_I), (N, rows, cols, C)
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


Template: TypeAlias = CalibratedTemplate | PatchTemplate
"""What renderings are compared with: a photograph's crop, made ``shrink`` times smaller."""


def patch_template(image: Tensor, regions: Sequence[Box], spec: HOGSpec) -> PatchTemplate:
    """The template of the regions of one image (1, 1, H, W)."""
    descriptors = hog(cut_out(image, regions)[0], spec)
    return PatchTemplate(spec, tuple(regions), descriptors)


def cut_out(images: Tensor, regions: Sequence[Box]) -> Tensor:
    """Patches (B, N, 1, h, w) of images (B, 1, H, W) in N regions of one size."""
    return torch.stack([images[:, :, rows, cols] for rows, cols in _slices(regions)], dim=1)


def _slices(regions: Sequence[Box]) -> list[tuple[slice, slice]]:
    return [(region.rows, region.cols) for region in regions]


def downsample_poses(poses: Tensor, factor: int) -> Tensor:
    """Poses (B, 6) for a crop as those for one ``factor`` times smaller."""
    return poses if factor == 1 else torch.cat([poses[:, :4], poses[:, 4:] / factor], 1)


def run_in_batches(work: Callable[[Tensor], T], poses: Tensor) -> list[T]:
    """Results of ``work`` on some poses (B, 6) at a time, in as many threads as PyTorch uses."""
    threads = torch.get_num_threads()
    rounds = math.ceil(len(poses) / (_BATCH * threads))  # each gives every thread a part
    parts = torch.split(poses, math.ceil(len(poses) / (rounds * threads)))
    return in_threads(lambda k: work(parts[k]), len(parts))


class Similarity:
    """The similarity of renderings to a template as a function of their poses; it counts the renderings compared."""

    def __init__(self, renderer: Renderer, template: Template) -> None:
        self.renderer, self.template = renderer, template
        self.renderings = 0

    def values(self, poses: Tensor) -> Tensor:
        """Similarities (B,) at poses (B, 6) for the crop, angles in degrees."""
        return torch.cat(self._run_in_batches(self._values, poses))

    def derivatives(self, poses: Tensor) -> tuple[Tensor, Tensor]:
        """Values (B,) and their derivatives (B, 6) by the parameters of poses (B, 6), per degree, unit and pixel."""
        values, slopes = zip(*self._run_in_batches(self._derivatives, poses), strict=True)
        by_pose = torch.cat(slopes)
        by_pose[:, 4:] /= self.template.shrink
        return torch.cat(values), by_pose

    def _run_in_batches(self, work: Callable[[Tensor], T], poses: Tensor) -> list[T]:
        self.renderings += len(poses)
        return run_in_batches(work, downsample_poses(poses, self.template.shrink))

    def _values(self, poses: Tensor) -> Tensor:
        rendering = self.renderer.render(poses, derivative=False)
        return self.template.similarities(rendering.image[:, None]).double()

    def _derivatives(self, poses: Tensor) -> tuple[Tensor, Tensor]:
        rendering = self.renderer.render(poses, derivative=True)
        values, grad_images = self.template.similarities_and_gradients(rendering.image[:, None])
        grad_poses = pose_vjp(grad_images[:, 0], rendering.screen_gradient, poses, self.renderer.camera)
        return values.double(), grad_poses.double()
