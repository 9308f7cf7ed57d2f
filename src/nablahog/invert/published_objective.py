"""Eq. 8-9 as a dogleg minimises them: gray values as unknowns, and Jacobians that are products of local ones.

The Jacobian of HOG is that of the normaliser (Eq. 7), on a few cells, times that of the histograms (Eq. 1-6), in which
a pixel votes into its neighbouring cells only.  A product with it is a pass through each.  The equations of a
Gauss-Newton step couple all pixels, through ξ²L, where L is the discrete Laplacian of the smoothness: conjugate
gradients alone would take thousands of products.  The cosine basis diagonalises L, so it is the preconditioner.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..hog.engines import histograms_jvp, steps
from ..hog.spec import HOGSpec
from ..hog.steps import normalize_reference
from .cosine_transform import from_cosines, to_cosines
from .method import Neighbours, Norms
from .priors import EPSILON, differences

DIAGONAL = 1e-5  # of the mean diagonal of JᵀJ, which stands for HOG in the preconditioner


class PublishedObjective:
    """Eq. 9: ‖φ(I) - φ(Î)‖² + ξ² Σ (i_p - i_q)², or as printed, ‖φ(I) - φ(Î)‖ + ξ Σ |i_p - i_q|.

    As printed |d| is d² / √(d² + ε²): nearly the same, and a sum of squares.  HOG sees no brightness: the unknowns are
    gray values around 0.  A :class:`~nablahog.optimize.Linearizable` problem.

    Args:
        descriptor: (B, rows, cols, channels), φ(I).
        spec: the dialect.
        size: (height, width) of the images.
        smoothness: ξ.
        norms: ``"squared"`` or ``"printed"``.
        neighbours: 4 or 8.

    Attributes:
        distance: (B,), ‖φ(I) - φ(Î)‖ / ‖φ(I)‖, at the points evaluated last.
    """

    def __init__(
        self,
        descriptor: Tensor,
        spec: HOGSpec,
        size: tuple[int, int],
        smoothness: float,
        norms: Norms,
        neighbours: Neighbours = 4,
    ) -> None:
        self.spec, self.size, self.smoothness, self.printed = spec, size, smoothness, norms == "printed"
        self.neighbours: Neighbours = neighbours
        self.descriptor = descriptor.permute(0, 3, 1, 2)
        self.length = descriptor.flatten(1).norm(dim=1).clamp(min=torch.finfo(descriptor.dtype).tiny)
        self.distance = torch.zeros_like(self.length)
        self.histograms, self.normalize = steps(descriptor.device, spec)

    def images(self, points: Tensor) -> Tensor:
        """Points (A, H·W) to images (A, 1, H, W)."""
        return points.reshape(-1, 1, *self.size)

    def of_neighbours(self, images: Tensor) -> Tensor:
        """i_p - i_q over the neighbours of images (A, 1, H, W), each pair once: (A, K)."""
        return torch.cat([d.flatten(1) for d in differences(images, self.neighbours)], dim=1)

    def __call__(self, points: Tensor, index: Tensor) -> tuple[Tensor, Tensor]:
        with torch.enable_grad():
            points = points.detach().requires_grad_()
            images = self.images(points)
            difference = self.normalize(self.histograms(images, self.spec), self.spec) - self.descriptor[index]
            value = self._terms(difference.flatten(1), self.of_neighbours(images)).square().sum(1)
        (gradient,) = torch.autograd.grad(value.sum(), points)
        self.distance[index] = difference.detach().flatten(1).norm(dim=1) / self.length[index]
        return value.detach(), gradient

    def residuals(self, points: Tensor, index: Tensor) -> Tensor:
        """Points (A, H·W) to residuals (A, M) whose squares sum to the values."""
        images = self.images(points)
        difference = normalize_reference(self.histograms(images, self.spec), self.spec) - self.descriptor[index]
        return self._terms(difference.flatten(1), self.of_neighbours(images))

    def linearize(self, points: Tensor, index: Tensor) -> PublishedJacobian:
        """J at the points (A, H·W)."""
        return PublishedJacobian(self, points, index)

    def _terms(self, difference: Tensor, of_neighbours: Tensor) -> Tensor:
        """Differences of descriptors (A, M₁) and of neighbours (A, M₂) to residuals (A, M₁ + M₂)."""
        if not self.printed:
            return torch.cat([difference, self.smoothness * of_neighbours], dim=1)
        power = (of_neighbours.square() + EPSILON**2).pow(-1 / 4)
        return torch.cat([difference / root_length(difference), math.sqrt(self.smoothness) * of_neighbours * power], 1)


def root_length(vectors: Tensor) -> Tensor:
    """√‖v‖ of vectors (A, M): (A, 1); 1 where v = 0."""
    squared = vectors.square().sum(dim=1, keepdim=True)
    return torch.where(squared > 0, squared, 1).pow(1 / 4)


class PublishedJacobian:
    """The Jacobians of :class:`PublishedObjective` at some points, by those of its steps.

    The normaliser's is its double vjp, on the cells alone, whose graph is kept.

    Args:
        objective: whose they are.
        points: (A, H·W).
        index: (A,), the problems at these points.

    Attributes:
        size: M, the number of residuals.
    """

    def __init__(self, objective: PublishedObjective, points: Tensor, index: Tensor) -> None:
        self._objective, spec = objective, objective.spec
        with torch.enable_grad():
            self._images = objective.images(points.detach()).requires_grad_()
            self._cells = objective.histograms(self._images, spec)
            self._leaf = self._cells.detach().requires_grad_()
            self._descriptor = objective.normalize(self._leaf, spec)
            described = normalize_reference(self._leaf, spec)
            self._cotangents = torch.zeros_like(described, requires_grad=True)
            (self._norm_vjp,) = torch.autograd.grad(described, self._leaf, self._cotangents, create_graph=True)
            self._of_neighbours = objective.of_neighbours(self._images)
        difference = (described.detach() - objective.descriptor[index]).flatten(1)
        self._lengths = [difference.shape[1], self._of_neighbours.shape[1]]
        self.size = sum(self._lengths)
        if objective.printed:
            self._root = root_length(difference)
            self._unit = difference / self._root.square()
            squared = self._of_neighbours.detach().square()
            # of d (d² + ε²)^-¼
            slopes = (squared + EPSILON**2).pow(-1 / 4) - squared / 2 * (squared + EPSILON**2).pow(-5 / 4)
            self._slopes = math.sqrt(objective.smoothness) * slopes
        else:
            self._slopes = torch.full_like(difference[:, :1], objective.smoothness)
        self._spectrum = self._preconditioner()

    @torch.no_grad()
    def jvp(self, vectors: Tensor) -> Tensor:
        """J·v: (A, H·W) to (A, M)."""
        images = self._objective.images(vectors)
        of_hog = self._scaled(self._hog_jvp(images).flatten(1))
        return torch.cat([of_hog, self._slopes * self._objective.of_neighbours(images)], dim=1)

    @torch.no_grad()
    def vjp(self, vectors: Tensor) -> Tensor:
        """Jᵀ·v: (A, M) to (A, H·W)."""
        of_hog, of_neighbours = torch.split(vectors, self._lengths, dim=1)
        grad_descriptor = self._scaled(of_hog).reshape(self._descriptor.shape)
        (grad_cells,) = torch.autograd.grad(self._descriptor, self._leaf, grad_descriptor, retain_graph=True)
        outputs = self._cells, self._of_neighbours
        grads = grad_cells, self._slopes * of_neighbours
        (grad_images,) = torch.autograd.grad(outputs, self._images, grads, retain_graph=True)
        return grad_images.flatten(1)

    @torch.no_grad()
    def precondition(self, vectors: Tensor) -> Tensor:
        """(ξ²L + d)⁻¹·v, (A, H·W), where d is a share of the mean diagonal of HOG's JᵀJ."""
        return from_cosines(to_cosines(self._objective.images(vectors)) / self._spectrum).flatten(1)

    def _hog_jvp(self, tangents: Tensor) -> Tensor:
        """Tangents of images (A, 1, H, W) to those of descriptors (A, channels, rows, cols)."""
        of_cells = histograms_jvp(self._images, tangents, self._objective.spec)
        (product,) = torch.autograd.grad(self._norm_vjp, self._cotangents, of_cells, retain_graph=True)
        return product

    def _scaled(self, of_hog: Tensor) -> Tensor:
        """The Jacobian of r / √‖r‖, which is symmetric, times vectors (A, M₁): (I - r̂r̂ᵀ/2) v / √‖r‖."""
        if not self._objective.printed:
            return of_hog
        return (of_hog - self._unit * (self._unit * of_hog).sum(dim=1, keepdim=True) / 2) / self._root

    def _preconditioner(self) -> Tensor:
        """Eigenvalues of ξ²L + d for the cosines of the images, (A, 1, H, W)."""
        height, width = self._objective.size
        cos_y, cos_x = (torch.cos(math.pi * torch.arange(n) / n) for n in (height, width))
        laplacian = (2 - 2 * cos_y).unsqueeze(1) + (2 - 2 * cos_x)
        if self._objective.neighbours == 8:
            laplacian = laplacian + 4 - 4 * cos_y.unsqueeze(1) * cos_x  # exact but for the border
        laplacian = laplacian.to(self._slopes)
        generator = torch.Generator().manual_seed(0)
        signs = torch.randint(0, 2, (1, 1, height, width), generator=generator).to(self._slopes) * 2 - 1
        # Hutchinson's estimate of the trace: the mean of ‖J s‖² over random signs s, of which one will do
        seen = self._scaled(self._hog_jvp(signs.expand_as(self._images).contiguous()).flatten(1)).square().sum(1)
        diagonal = DIAGONAL * seen / (height * width)
        tiny = torch.finfo(diagonal.dtype).tiny
        weights = self._slopes.square().mean(dim=1)
        return weights.reshape(-1, 1, 1, 1) * laplacian + diagonal.clamp(min=tiny).reshape(-1, 1, 1, 1)
