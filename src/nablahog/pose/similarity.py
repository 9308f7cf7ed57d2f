"""How much a rendering's HOG is like the photograph's (Section 3.2), with its derivative by the pose.

Each similarity is a linear template w of the photograph, ⟨w, φ(P_f)⟩, one of them divided by what it would vary by:

* ``dot``, the paper's: Σ ⟨φ(P_I), φ(P_f)⟩ over the visual elements P_I of the photograph;
* ``whitened``: Σ ⟨Σ⁻¹(φ(P_I) − μ), φ(P_f)⟩ over the same: what photographs have everywhere does not count;
* ``calibrated``: the same over the whole window at once, divided by √(φ(P_f)ᵀ Σ⁻¹ φ(P_f)).  That is the score of the
  rendering's own linear discriminant Σ⁻¹ φ(P_f) on the photograph, in its standard deviations over photographs of
  anything: comparable between poses and models, however many edges they show.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import torch
from torch import Tensor

from ..hog.kernels import steps
from ..hog.spec import HOGSpec
from ..render import Camera, Renderer
from ..render.pose_gradient import pose_vjp
from ..runtime.threads import in_threads
from .canvas import Canvas
from .elements import Elements
from .filter import Whitener

Result = TypeVar("Result")

_BATCH = 32  # renderings at a time: small ones stay in the processor's cache


def describe(images: Tensor, spec: HOGSpec) -> Tensor:
    """φ: gray images (B, 1, H, W) to (B, C, rows, cols)."""
    histograms, normalize = steps(images.device, spec)
    return normalize(histograms(images, spec), spec)


@dataclass(frozen=True, eq=False)
class Template:
    """A photograph to compare renderings with.

    Attributes:
        spec: of both descriptors.
        weights: w, (C, rows, cols), float32.
        whitener: of the ``calibrated`` similarity, else None.
        shrink: pixels of the canvas, along a side, that are one of the images described.
    """

    spec: HOGSpec
    weights: Tensor
    whitener: Whitener | None = None
    shrink: int = 1

    def values(self, descriptors: Tensor) -> Tensor:
        """Similarities (B,) of descriptors (B, C, rows, cols)."""
        values = descriptors.flatten(1) @ self.weights.flatten()
        return values if self.whitener is None else values / deviations(self.whitener.energies(descriptors))

    def scores(self, descriptors: Tensor) -> tuple[Tensor, Tensor]:
        """Similarities (B,) of descriptors (B, C, rows, cols), and their derivatives by these."""
        values = descriptors.flatten(1) @ self.weights.flatten()
        if self.whitener is None:
            return values, self.weights.expand_as(descriptors)
        white = self.whitener(descriptors)
        spread = deviations((descriptors * white).sum(dim=(1, 2, 3)))
        values = values / spread
        slope = (self.weights - (values / spread)[:, None, None, None] * white) / spread[:, None, None, None]
        return values, slope


def deviations(squared: Tensor) -> Tensor:
    """√ of φᵀ Σ⁻¹ φ; infinite for an empty rendering, which looks like nothing: 0, and no way is up."""
    return torch.where(squared > 1e-9, squared, torch.inf).sqrt()


def calibrated(canvas: Canvas, spec: HOGSpec, whitener: Whitener, shrink: int = 1) -> Template:
    """The template of a canvas as a whole, made ``shrink`` times smaller before; its cells beyond the photograph
    are as likely as any, μ."""
    descriptor = whitener.centred(describe(canvas.image, spec))
    x0, y0, x1, y1 = canvas.seen
    y, x = (
        (torch.arange(cells) + 0.5) * cell for cells, cell in zip(descriptor.shape[2:], spec.cell_size, strict=True)
    )
    seen = ((y >= y0) & (y <= y1))[:, None] & (x >= x0) & (x <= x1)
    return Template(spec, whitener(descriptor * seen)[0], whitener, shrink)


def by_elements(found: Elements, patches: Tensor, spec: HOGSpec, rows: int, cols: int) -> Template:
    """The template of a photograph's elements with ``patches`` (N, r, c, C): φ(P_I) itself, or whitened."""
    return Template(spec, found.spread(patches, rows, cols).permute(2, 0, 1).float().contiguous())


def white(camera: Camera) -> Tensor:
    """What renderings have behind them, (1, H, W)."""
    return torch.ones(1, camera.height, camera.width)


def smaller_poses(poses: Tensor, shrink: int) -> Tensor:
    """Poses (B, 6) for a canvas as those for one ``shrink`` times smaller."""
    return poses if shrink == 1 else torch.cat([poses[:, :4], poses[:, 4:] / shrink], 1)


def in_batches(work: Callable[[Tensor], Result], poses: Tensor) -> list[Result]:
    """Of some poses (B, 6) at a time, in as many threads as PyTorch takes."""
    threads = torch.get_num_threads()
    rounds = math.ceil(len(poses) / (_BATCH * threads))  # each of which has a part for every thread
    parts = torch.split(poses, math.ceil(len(poses) / (rounds * threads)))
    return in_threads(lambda k: work(parts[k]), len(parts))


class Similarity:
    """The similarity of renderings to a photograph as a function of their poses.

    Args:
        renderer: before a camera for images of the template's size.
        template: of the photograph.
    """

    def __init__(self, renderer: Renderer, template: Template) -> None:
        self.renderer, self.template = renderer, template
        self.background = white(renderer.camera)
        self.renderings = 0

    def values(self, poses: Tensor) -> Tensor:
        """(B,) at poses (B, 6) for the canvas."""
        return torch.cat(self._in_parts(self._values, poses))

    def derivatives(self, poses: Tensor) -> tuple[Tensor, Tensor]:
        """Values (B,) and derivatives (B, 6) by the parameters of the poses, as :data:`nablahog.render.PARAMETERS`."""
        values, slopes = zip(*self._in_parts(self._derivatives, poses), strict=True)
        by_pose = torch.cat(slopes)
        by_pose[:, 4:] /= self.template.shrink
        return torch.cat(values), by_pose

    def _in_parts(self, work: Callable[[Tensor], Result], poses: Tensor) -> list[Result]:
        self.renderings += len(poses)
        assert self.renderer.compiled  # once, before threads ask for it
        return in_batches(work, smaller_poses(poses, self.template.shrink))

    def _values(self, poses: Tensor) -> Tensor:
        rendering = self.renderer.compiled.render(poses, self.background, False)
        return self.template.values(describe(rendering.image[:, None], self.template.spec)).double()

    def _derivatives(self, poses: Tensor) -> tuple[Tensor, Tensor]:
        rendering = self.renderer.compiled.render(poses, self.background, True)
        images = rendering.image[:, None].requires_grad_(True)
        with torch.enable_grad():
            descriptors = describe(images, self.template.spec)
        values, slope = self.template.scores(descriptors.detach())
        (given,) = torch.autograd.grad(descriptors, images, slope)
        return values.double(), pose_vjp(given[:, 0], rendering.screen_gradient, poses, self.renderer.camera).double()
