"""Eq. 8-9 of Section 3.1: how far an image is from explaining a descriptor."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from ..hog.descriptor import histograms, steps
from ..hog.spec import HOGSpec
from ..hog.steps import normalize_reference
from ..runtime.pytorch import memory_for
from .cosine import CosineBasis
from .flat import FlatRegions
from .priors import Prior

VOTES = 8_000_000  # of the images evaluated together on a CPU: a balance of memory and the overhead of calls
COPIES = 8  # of all votes that the plain steps and their derivative hold at once, about
SHARE = 0.25  # of a GPU's free memory for votes; the minimiser's vectors need the most of it


def votes_at_once(like: Tensor) -> int:
    """How many votes of images may be held together, by dtype and device of ``like``."""
    each = COPIES * like.element_size()
    return max(1, memory_for(like.device, VOTES * each, SHARE) // each)


def squared_norm(x: Tensor) -> Tensor:
    """‖x‖² of each row of a batch (B, …), at least the smallest positive number, to divide by."""
    return x.square().flatten(1).sum(1).clamp(min=torch.finfo(x.dtype).tiny)


class PreimageObjective:
    """‖φ(Î) - φ(I)‖² / ‖φ(I)‖² + λ‖Î - Ī‖² / ‖Ī‖² + priors, where φ is the descriptor or the histograms before Eq. 7.

    Histograms are compared at their own scale, so that strong edges count more; they have no clip and no division, and
    are by far the easier problem.  The descriptor is the problem that was posed.

    A :class:`~nablahog.optimize.LeastSquares` problem.

    Args:
        descriptor: (B, rows, cols, channels), φ(I).
        votes: histograms (B, bins, rows, cols) to compare instead; None to compare the descriptor.
        spec: the dialect.
        basis: from unknowns to images.
        flat: the regions that must be constant.
        priors: added to the distance, of the batch.
        expected: Ī, the expected image (B, 1, H, W); None where nothing is expected.
        closeness: λ.  Both images are taken without their means, since HOG ignores the brightness.
        keep_images: whether the images are kept.

    Attributes:
        distance: (B,), ‖φ(Î) - φ(I)‖ / ‖φ(I)‖ of the descriptors, whatever is compared, at the points evaluated last.
        images: (B, 1, H, W), those evaluated last, if they are kept.
        votes_at_once: of the images that are evaluated together.
    """

    def __init__(
        self,
        descriptor: Tensor,
        votes: Tensor | None,
        spec: HOGSpec,
        basis: CosineBasis,
        flat: FlatRegions,
        priors: Sequence[Prior],
        expected: Tensor | None = None,
        closeness: float = 0.0,
        keep_images: bool = False,
    ) -> None:
        self.descriptor = descriptor.permute(0, 3, 1, 2)
        self.votes = votes
        self.spec = spec
        self.basis = basis
        self.flat = flat
        self.priors = tuple(priors)
        self.distance = descriptor.new_zeros(len(descriptor))
        self.images = descriptor.new_zeros(len(descriptor), 1, *flat.regions.shape[1:]) if keep_images else None
        self.descriptor_size = squared_norm(descriptor)
        self.compared_size = self.descriptor_size if votes is None else squared_norm(votes)
        self.votes_at_once = votes_at_once(descriptor)
        self.histograms, self.normalize = steps(descriptor.device, spec)
        self.expected = expected
        if expected is not None:
            size = (expected - expected.mean(dim=(2, 3), keepdim=True)).square().sum(dim=(1, 2, 3))
            self.closeness = torch.where(size > 0, closeness / torch.where(size > 0, size, 1), 0)

    def image(self, unknowns: Tensor, index: Tensor) -> Tensor:
        """Unknowns (A, N) of the problems ``index`` to images (A, 1, H, W)."""
        return self.flat(self.basis.image(unknowns), index)

    def __call__(self, unknowns: Tensor, index: Tensor) -> tuple[Tensor, Tensor]:
        pieces = [self._evaluate(*piece) for piece in self._pieces(unknowns, index)]
        values, gradients, distances = (torch.cat(parts) for parts in zip(*pieces, strict=True))
        self.distance[index] = distances
        return values, gradients

    def residuals(self, unknowns: Tensor, index: Tensor) -> Tensor:
        """Unknowns (A, N) to residuals (A, M) whose squares sum to the values.

        A product with their Jacobian runs through the operator step by step.  The Jacobian of Eq. 7 is (I - c·vvᵀ)·a,
        which couples all cells; that of the histograms is local.  The two are applied in turn, the first by one dot
        product with v, and their product is never formed.  The same holds for means over the image.
        """
        return torch.cat([self._residuals(*piece) for piece in self._pieces(unknowns, index)])

    def _pieces(self, unknowns: Tensor, index: Tensor) -> list[tuple[Tensor, Tensor]]:
        """The batch in pieces that fit into memory."""
        at_once = max(1, self.votes_at_once // (unknowns.shape[1] * self.spec.bins))
        return [(unknowns[i : i + at_once], index[i : i + at_once]) for i in range(0, len(unknowns), at_once)]

    def _residuals(self, unknowns: Tensor, index: Tensor) -> Tensor:
        image = self.image(unknowns, index)
        cells = histograms(image, self.spec)
        if self.votes is None:
            difference = normalize_reference(cells, self.spec) - self.descriptor[index]
        else:
            difference = cells - self.votes[index]
        distance = difference.flatten(1) / self.compared_size[index].sqrt().unsqueeze(1)
        if self.expected is not None:
            deviation = self._deviation(image, index) * self.closeness[index].sqrt().unsqueeze(1)
            distance = torch.cat([distance, deviation], dim=1)
        return torch.cat([distance, *(prior.of(index).residuals(image) for prior in self.priors)], dim=1)

    def _deviation(self, image: Tensor, index: Tensor) -> Tensor:
        """Î - Ī without its mean, (A, H·W)."""
        assert self.expected is not None
        difference = (image - self.expected[index]).flatten(1)
        return difference - difference.mean(dim=1, keepdim=True)

    @torch.no_grad()
    def _evaluate(self, unknowns: Tensor, index: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Values, gradients and distances."""
        image = self.flat.level(self.basis.image(unknowns), index)
        if self.images is not None:
            self.images[index] = image
        values, gradient, distances = self._evaluate_image(image, index)
        # making regions constant is a projection, so its own adjoint
        return values, self.basis.adjoint(self.flat.level(gradient, index)), distances

    @torch.enable_grad()
    def _evaluate_image(self, image: Tensor, index: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """The same, with gradients with respect to the images."""
        image = image.detach().requires_grad_()
        cells = self.histograms(image, self.spec)
        with torch.set_grad_enabled(self.votes is None):
            difference = self.normalize(cells, self.spec) - self.descriptor[index]
            distance = difference.square().sum(dim=(1, 2, 3)) / self.descriptor_size[index]
        value = distance
        if self.votes is not None:
            value = (cells - self.votes[index]).square().sum(dim=(1, 2, 3)) / self.compared_size[index]
        if self.expected is not None:
            value = value + self.closeness[index] * self._deviation(image, index).square().sum(1)
        for prior in self.priors:
            value = value + prior.of(index)(image)
        (gradient,) = torch.autograd.grad(value.sum(), image)
        return value.detach(), gradient, distance.detach().sqrt()
