"""Section 3.1 as published: from noise to the minimum of Eq. 9 over gray values, by Powell's dogleg.

The Jacobian of HOG is that of the normaliser (Eq. 7), on a few cells, times that of the histograms (Eq. 1-6), in which
a pixel votes into its neighbouring cells only.  A product with it is a pass through each.  The equations of a
Gauss-Newton step couple all pixels, through ξ²L, where L is the discrete Laplacian of the smoothness: conjugate
gradients alone would take thousands of products.  The cosine basis diagonalises L, so it is the preconditioner.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import torch
from torch import Tensor

from ..hog.descriptor import histograms, histograms_jvp, normalize
from ..hog.spec import HOGSpec
from ..hog.steps import normalize_reference
from ..optimize import dogleg
from ..runtime.pytorch import memory_for
from .arguments import AsPublished
from .histograms import linear_vote_spec
from .prior.terms import differences
from .reconstruction import Reconstruction, SearchRecord, Watch, build_reconstruction, split_batch, to_gray_values
from .starts import noise
from .unknowns import from_cosines, to_cosines

# ξ and the standard deviation of the start where the descriptor leaves the contrast open: with so little noise the
# smoothness of the start weighs as much as its distance
PUBLISHED_SMOOTHNESS, PUBLISHED_NOISE = 100.0, 1e-4
FIXED_CONTRAST_SMOOTHNESS, FIXED_CONTRAST_NOISE = 0.3, 1e-2  # the same where the descriptor fixes it
CG_TOLERANCE, CG_ITERATIONS = 1e-4, 200  # of a Gauss-Newton step: residual relative to the right side, most iterations
TRIAL_EVALUATIONS = 50  # evaluations of an iteration besides the products of its step: far more than needed
PIXELS_AT_ONCE = 2**20  # pixels of the images that are searched together on a CPU
NUMBERS_PER_PIXEL = 128  # held per pixel in a search, for vectors, their images and the graph; an estimate
SEARCH_MEMORY_SHARE = 0.5  # of a GPU's free memory for searches
DIAGONAL_SHARE = 1e-5  # of the mean diagonal of JᵀJ, which stands for HOG in the preconditioner


def choose_smoothness(options: AsPublished, spec: HOGSpec) -> float:
    """ξ, or its default for descriptors of ``spec``."""
    if options.smoothness is not None:
        return options.smoothness
    return FIXED_CONTRAST_SMOOTHNESS if spec.normalizer.fixes_contrast else PUBLISHED_SMOOTHNESS


def reconstruct_as_published(
    descriptor: Tensor,
    spec: HOGSpec,
    size: tuple[int, int],
    options: AsPublished,
    *,
    seed: int = 0,
    start: Tensor | None = None,
    progress: Callable[[int, int], None] | None = None,
    watch: Watch | None = None,
) -> Reconstruction:
    """Images with the given descriptor by the paper's search: :func:`.preimage.reconstruct` for valid arguments.

    Where the descriptor leaves the contrast open, images ``start`` get the contrast of the noise: against a strong
    contrast the smoothness would count for more.
    """
    began = time.perf_counter()
    batch, height, width = len(descriptor), *size
    spread = FIXED_CONTRAST_NOISE if spec.normalizer.fixes_contrast else PUBLISHED_NOISE
    grain = noise(descriptor, height, width, 1, seed, spread)[0]
    first = grain.expand(batch, -1, -1, -1) if start is None else _centre(start, grain, spec)
    pixel = NUMBERS_PER_PIXEL * descriptor.element_size()
    memory = memory_for(descriptor.device, PIXELS_AT_ONCE * pixel, SEARCH_MEMORY_SHARE)
    at_once = max(1, memory // (pixel * height * width))
    searches = []
    for part, report in split_batch(batch, at_once, progress):
        searches.append(_Search(descriptor[part], spec, size, options, watch, part))
        searches[-1].run(first[part], report)
    image = to_gray_values(torch.cat([search.image for search in searches]), spec)
    iterates = None
    if options.keep_iterates:
        iterates = torch.cat([search.iterates.flatten(0, 1) for search in searches])
        iterates = to_gray_values(iterates, spec).reshape(batch, -1, 1, height, width).transpose(0, 1)
    return replace(build_reconstruction(image, descriptor, spec, searches, began), iterates=iterates)


def _centre(start: Tensor, grain: Tensor, spec: HOGSpec) -> Tensor:
    """Images (B, 1, H, W) around 0, of the contrast of the noise ``grain`` where the descriptor leaves it open.

    A constant image is replaced by the noise: all derivatives vanish there, and no search would leave it.
    """
    centred = start - start.mean(dim=(1, 2, 3), keepdim=True)
    spread = centred.square().mean(dim=(1, 2, 3), keepdim=True).sqrt()
    if not spec.normalizer.fixes_contrast:
        centred = centred * (grain.square().mean().sqrt() / torch.where(spread > 0, spread, 1))
    return torch.where((start == start[..., :1, :1]).flatten(1).all(dim=1).reshape(-1, 1, 1, 1), grain, centred)


class _Search(SearchRecord):
    """The minimisation of a part of a batch.  Gray values are around 0: a small contrast would be rounded at 0.5.

    Iterates (B, iterations + 1, 1, H, W) begin with the start; a search that has ended repeats its last.
    """

    def __init__(
        self,
        descriptor: Tensor,
        dialect: HOGSpec,
        size: tuple[int, int],
        options: AsPublished,
        watch: Watch | None,
        part: slice,
    ) -> None:
        super().__init__(descriptor, dialect, watch, part)
        self.options, smoothness = options, choose_smoothness(options, dialect)
        self.objective = PublishedObjective(descriptor, linear_vote_spec(dialect), size, smoothness)

    def run(self, start: Tensor, progress: Callable[[int, int], None] | None) -> None:
        options, self.image = self.options, start
        if options.keep_iterates:
            self.iterates = start.unsqueeze(1).repeat(1, options.iterations + 1, 1, 1, 1)
        most = options.max_evaluations
        minimum = dogleg(
            self.objective,
            start.flatten(1),
            max_evaluations=options.iterations * (CG_ITERATIONS + TRIAL_EVALUATIONS) if most is None else most,
            max_iterations=options.iterations,
            cg_iterations=CG_ITERATIONS,
            cg_tolerance=CG_TOLERANCE,
            watch=self._evaluated,
            accepted=partial(self._accepted, progress),
        )
        self.image = self.objective.images(minimum.x)
        self.stop_reason = minimum.stop_reason

    def _evaluated(self, index: Tensor, evaluations: Tensor) -> None:
        self.evaluations = self.evaluations.index_copy(0, index, evaluations)
        self.history.add(evaluations, index, self.objective.distance[index])

    def _accepted(
        self, progress: Callable[[int, int], None] | None, index: Tensor, iterations: Tensor, points: Tensor
    ) -> None:
        """Keeps and shows the points (A, H·W) of the problems ``index`` after an iteration."""
        images, most = self.objective.images(points), self.options.iterations
        if self.options.keep_iterates:
            later = torch.arange(most + 1, device=index.device) >= iterations.unsqueeze(1)  # (A, most + 1)
            iterates = torch.where(later[..., None, None, None], images.unsqueeze(1), self.iterates[index])
            self.iterates[index] = iterates
        if progress is not None:
            progress(int(iterations.max()), most)
        if self.watch is not None:
            self.image = self.image.index_copy(0, index, images)
            self.show(self.objective.distance, self.image.unsqueeze(1))


class PublishedObjective:
    """Eq. 9, squared: ‖φ(I) - φ(Î)‖² + ξ² Σ (i_p - i_q)² over the four neighbours of each pixel.

    HOG ignores the brightness: the unknowns are gray values around 0.  A :class:`~nablahog.optimize.Linearizable`
    problem.

    Attributes:
        distance: (B,), ‖φ(I) - φ(Î)‖ / ‖φ(I)‖, at the points evaluated last.
    """

    def __init__(self, descriptor: Tensor, spec: HOGSpec, size: tuple[int, int], smoothness: float) -> None:
        self.spec, self.size, self.smoothness = spec, size, smoothness
        self.descriptor = descriptor.permute(0, 3, 1, 2)
        length = descriptor.flatten(1).norm(dim=1)
        self.length = length.masked_fill(length == 0, 1)
        self.distance = torch.zeros_like(self.length)

    def images(self, points: Tensor) -> Tensor:
        return points.reshape(-1, 1, *self.size)

    def neighbour_differences(self, images: Tensor) -> Tensor:
        """ξ (i_p - i_q) over the neighbours of images (A, 1, H, W), each pair once: (A, K)."""
        return self.smoothness * torch.cat([d.flatten(1) for d in differences(images)], dim=1)

    def __call__(self, points: Tensor, index: Tensor) -> tuple[Tensor, Tensor]:
        with torch.enable_grad():
            points = points.detach().requires_grad_()
            images = self.images(points)
            difference = normalize(histograms(images, self.spec), self.spec) - self.descriptor[index]
            value = torch.cat([difference.flatten(1), self.neighbour_differences(images)], dim=1).square().sum(1)
        (gradient,) = torch.autograd.grad(value.sum(), points)
        self.distance[index] = difference.detach().flatten(1).norm(dim=1) / self.length[index]
        return value.detach(), gradient

    def residuals(self, points: Tensor, index: Tensor) -> Tensor:
        images = self.images(points)
        difference = normalize_reference(histograms(images, self.spec), self.spec) - self.descriptor[index]
        return torch.cat([difference.flatten(1), self.neighbour_differences(images)], dim=1)

    def linearize(self, points: Tensor, index: Tensor) -> PublishedJacobian:
        return PublishedJacobian(self, points)


class PublishedJacobian:
    """The Jacobians of :class:`PublishedObjective` at points (A, H·W), each the product of the Jacobians of its steps.

    The jvp of the normaliser is its double vjp, on the cells alone, whose graph is kept.
    """

    def __init__(self, objective: PublishedObjective, points: Tensor) -> None:
        self._objective, spec = objective, objective.spec
        with torch.enable_grad():
            self._images = objective.images(points.detach()).requires_grad_()
            self._cells = histograms(self._images, spec)
            self._leaf = self._cells.detach().requires_grad_()
            self._descriptor = normalize(self._leaf, spec)
            described = normalize_reference(self._leaf, spec)
            self._cotangents = torch.zeros_like(described, requires_grad=True)
            (self._norm_vjp,) = torch.autograd.grad(described, self._leaf, self._cotangents, create_graph=True)
            self._neighbour_differences = objective.neighbour_differences(self._images)
        self._lengths = [described[0].numel(), self._neighbour_differences.shape[1]]
        self.size = sum(self._lengths)
        self._spectrum = self._preconditioner()

    @torch.no_grad()
    def jvp(self, vectors: Tensor) -> Tensor:
        images = self._objective.images(vectors)
        return torch.cat([self._hog_jvp(images).flatten(1), self._objective.neighbour_differences(images)], dim=1)

    @torch.no_grad()
    def vjp(self, vectors: Tensor) -> Tensor:
        grad_entries, neighbour_differences = torch.split(vectors, self._lengths, dim=1)
        grad_descriptor = grad_entries.reshape(self._descriptor.shape)
        (grad_cells,) = torch.autograd.grad(self._descriptor, self._leaf, grad_descriptor, retain_graph=True)
        outputs, grads = (self._cells, self._neighbour_differences), (grad_cells, neighbour_differences)
        (grad_images,) = torch.autograd.grad(outputs, self._images, grads, retain_graph=True)
        return grad_images.flatten(1)

    @torch.no_grad()
    def precondition(self, vectors: Tensor) -> Tensor:
        """(ξ²L + d)⁻¹·v, (A, H·W), where d is a share of the mean diagonal of HOG's JᵀJ."""
        return from_cosines(to_cosines(self._objective.images(vectors)) / self._spectrum).flatten(1)

    def _hog_jvp(self, tangents: Tensor) -> Tensor:
        """Tangents of images (A, 1, H, W) to those of descriptors (A, channels, rows, cols)."""
        cell_tangents = histograms_jvp(self._images, tangents, self._objective.spec)
        (product,) = torch.autograd.grad(self._norm_vjp, self._cotangents, cell_tangents, retain_graph=True)
        return product

    def _preconditioner(self) -> Tensor:
        """Eigenvalues of ξ²L + d for the cosines of the images, (A, 1, H, W)."""
        height, width = self._objective.size
        cos_y, cos_x = (torch.cos(math.pi * torch.arange(n, dtype=torch.float32) / n) for n in (height, width))
        laplacian = ((2 - 2 * cos_y).unsqueeze(1) + (2 - 2 * cos_x)).to(self._images)
        generator = torch.Generator().manual_seed(0)
        signs = torch.randint(0, 2, (1, 1, height, width), generator=generator).to(self._images) * 2 - 1
        # Hutchinson's estimate of the trace: ‖J s‖² for random signs s, one sample
        trace = self._hog_jvp(signs.expand_as(self._images).contiguous()).flatten(1).square().sum(1)
        diagonal = (DIAGONAL_SHARE * trace / (height * width)).clamp(min=torch.finfo(trace.dtype).tiny)
        return self._objective.smoothness**2 * laplacian + diagonal.reshape(-1, 1, 1, 1)
