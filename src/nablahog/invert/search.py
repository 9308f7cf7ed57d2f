"""Eq. 8-9 of Section 3.1, how far an image is from explaining a descriptor, and their minimisation."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from ..hog.descriptor import histograms, normalize
from ..hog.spec import HOGSpec
from ..hog.steps import normalize_reference
from ..optimize import MINIMISERS, Minimiser
from ..runtime.pytorch import memory_for
from .histograms import linear_vote_spec
from .prior.terms import Prior
from .reconstruction import SearchRecord, Watch, squared_scale
from .starts import START_NOISE, match_contrast, pair_noise, starting_images
from .unknowns import CosineBasis, FlatRegions, low_pass

MAX_VOTES = 8_000_000  # of the images evaluated together on a CPU: a balance of memory and the overhead of calls
VOTE_COPIES = 8  # of all votes that the plain steps and their derivative hold at once, about
VOTE_MEMORY_SHARE = 0.25  # of a GPU's free memory for votes; the minimiser's vectors need most of it


class PreimageObjective:
    """‖φ(Î) - φ(I)‖² / ‖φ(I)‖² + λ‖Î - Ī‖² / ‖Ī‖² + priors, where φ is the descriptor or the histograms before Eq. 7.

    Histograms are compared at their own scale, so that strong edges count more; they have no clip and no division, and
    are by far the easier problem.  The descriptor is the problem that was posed.

    A :class:`~nablahog.optimize.LeastSquares` problem.

    Args:
        descriptor: (B, rows, cols, channels), φ(I).
        histograms: (B, bins, rows, cols) to compare instead; None to compare the descriptor.
        priors: for the whole batch, added to the distance.
        expected: Ī, the expected image (B, 1, H, W); None where nothing is expected.
        closeness: λ.  Both images are taken without their means, since HOG ignores the brightness.

    Attributes:
        distance: (B,), ‖φ(Î) - φ(I)‖ / ‖φ(I)‖ of the descriptors, whatever is compared, at the points evaluated last.
        images: (B, 1, H, W), those evaluated last, if they are kept.
    """

    def __init__(
        self,
        descriptor: Tensor,
        histograms: Tensor | None,
        spec: HOGSpec,
        basis: CosineBasis,
        flat: FlatRegions,
        priors: Sequence[Prior],
        expected: Tensor | None = None,
        closeness: float = 0.0,
        keep_images: bool = False,
    ) -> None:
        self.descriptor = descriptor.permute(0, 3, 1, 2)
        self.histograms = histograms
        self.spec = spec
        self.basis = basis
        self.flat = flat
        self.priors = tuple(priors)
        self.distance = descriptor.new_zeros(len(descriptor))
        self.images = descriptor.new_zeros(len(descriptor), 1, *flat.regions.shape[1:]) if keep_images else None
        self.descriptor_size = squared_scale(descriptor)
        self.compared_size = self.descriptor_size if histograms is None else squared_scale(histograms)
        bytes_per_vote = VOTE_COPIES * descriptor.element_size()
        memory = memory_for(descriptor.device, MAX_VOTES * bytes_per_vote, VOTE_MEMORY_SHARE)
        self.votes_at_once = max(1, memory // bytes_per_vote)
        self.expected = expected
        if expected is not None:
            size = (expected - expected.mean(dim=(2, 3), keepdim=True)).square().sum(dim=(1, 2, 3))
            self.closeness = torch.where(size > 0, closeness / torch.where(size > 0, size, 1), 0)

    def image(self, unknowns: Tensor, index: Tensor) -> Tensor:
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
        if self.histograms is None:
            difference = normalize_reference(cells, self.spec) - self.descriptor[index]
        else:
            difference = cells - self.histograms[index]
        distance = difference.flatten(1) / self.compared_size[index].sqrt().unsqueeze(1)
        if self.expected is not None:
            deviation = self._deviation(image, index) * self.closeness[index].sqrt().unsqueeze(1)
            distance = torch.cat([distance, deviation], dim=1)
        return torch.cat([distance, *(prior.select(index).residuals(image) for prior in self.priors)], dim=1)

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
        # making regions constant is a projection, and so its own adjoint
        return values, self.basis.adjoint(self.flat.level(gradient, index)), distances

    @torch.enable_grad()
    def _evaluate_image(self, image: Tensor, index: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """The same, with gradients with respect to the images."""
        image = image.detach().requires_grad_()
        cells = histograms(image, self.spec)
        with torch.set_grad_enabled(self.histograms is None):
            difference = normalize(cells, self.spec) - self.descriptor[index]
            distance = difference.square().sum(dim=(1, 2, 3)) / self.descriptor_size[index]
        value = distance
        if self.histograms is not None:
            value = (cells - self.histograms[index]).square().sum(dim=(1, 2, 3)) / self.compared_size[index]
        if self.expected is not None:
            value = value + self.closeness[index] * self._deviation(image, index).square().sum(1)
        for prior in self.priors:
            value = value + prior.select(index)(image)
        (gradient,) = torch.autograd.grad(value.sum(), image)
        return value.detach(), gradient, distance.detach().sqrt()


CALLS_BETWEEN_REPORTS = 10  # of progress on a GPU, which waits for each report
BASIS_EXPONENT = 0.75  # of the cosine basis: 1 converges first at large scales, 0.5 at small ones
SHARE_OF_SAMPLES = 0.7  # of the evaluations; the others match the descriptor itself
LEAST_EVALUATIONS = 28  # of a sample: with a smaller budget fewer samples are drawn
# standard deviation of the samples' initial noise: they differ in all that the descriptor leaves open
SAMPLE_SPREAD = 0.3
SPREAD_EVALUATIONS = 90  # evaluations in which a sample loses this noise; with fewer it begins with less noise
AGREEMENT_SIGMA = 0.9  # pixels: the samples agree on coarser structures only


class PreimageSearch(SearchRecord):
    """Searches for images with given histograms or descriptors from given starts, several for each descriptor.

    ``max_evaluations`` are those of each descriptor, over all its images; ``part`` has the indices of the descriptors
    in the batch of :func:`.preimage.reconstruct`.
    """

    def __init__(
        self,
        descriptor: Tensor,
        dialect: HOGSpec,
        size: tuple[int, int],
        priors: Sequence[Prior],
        minimiser: Minimiser,
        max_evaluations: int,
        progress: Callable[[int, int], None] | None = None,
        watch: Watch | None = None,
        part: slice = slice(None),
    ) -> None:
        super().__init__(descriptor, dialect, watch, part)
        self.spec, self.size, self.priors = linear_vote_spec(dialect), size, priors
        self.basis = CosineBasis(*size, descriptor, BASIS_EXPONENT)
        self.minimiser: Minimiser = minimiser
        self.max_evaluations, self.progress = max_evaluations, progress
        self._reported = self._assigned = self._calls = 0

    def remaining_evaluations(self) -> int:
        """Evaluations for each descriptor that no :meth:`match` has been assigned yet; at least 1.

        Unused evaluations of a minimisation are not passed on: they differ from image to image of a batch.
        """
        return max(1, self.max_evaluations - self._assigned)

    def match(
        self,
        starts: Tensor,
        histograms: Tensor | None,
        budget: int,
        expected: Tensor | None = None,
        closeness: float = 0.0,
    ) -> Tensor:
        """Images (B, K, 1, H, W) from ``starts`` of that shape, each within ``budget`` evaluations.

        They have the ``histograms`` (B, bins, rows, cols), or the descriptor if that is None.
        """
        batch, count = starts.shape[:2]
        self._assigned += budget * count
        before = self.evaluations

        def repeat(x: Tensor) -> Tensor:
            return x.repeat_interleave(count, dim=0)

        objective = PreimageObjective(
            repeat(self.descriptor),
            None if histograms is None else repeat(histograms),
            self.spec,
            self.basis,
            FlatRegions(repeat(self.descriptor), self.spec, *self.size),
            [prior.select(repeat(torch.arange(batch, device=starts.device))) for prior in self.priors],
            None if expected is None else repeat(expected),
            closeness,
            keep_images=self.watch is not None,
        )
        minimum = MINIMISERS[self.minimiser](
            objective,
            self.basis.unknowns(starts.flatten(0, 1)),
            max_evaluations=budget,
            progress_tolerance=1e-3,
            watch=self._account(objective, count),
        )
        self.stop_reason = minimum.stop_reason[::count]
        self.evaluations = before + minimum.evaluations.view(batch, count).sum(dim=1)
        index = torch.arange(batch * count, device=starts.device)
        return objective.image(minimum.x, index).view(starts.shape)

    def average_samples(
        self, histograms: Tensor, start: Tensor | None, samples: int, seed: int
    ) -> tuple[Tensor, Tensor | None]:
        """Start and expected image: the mean of samples with the ``histograms``; a single one is only a start."""
        evaluations = max(1, min(self.max_evaluations - 1, round(SHARE_OF_SAMPLES * self.max_evaluations)))
        count = max(1, min(samples, evaluations // LEAST_EVALUATIONS))
        spread = START_NOISE if count == 1 else SAMPLE_SPREAD * min(1, evaluations // count / SPREAD_EVALUATIONS)
        if start is None:
            starts = starting_images(histograms, self.spec, *self.size, count, seed, spread)
        else:
            grain = pair_noise(histograms, *self.size, count, seed, spread)
            starts = match_contrast(start, histograms, self.spec).unsqueeze(1) + grain
        mean = self.match(starts, histograms, evaluations // count).mean(dim=1)
        if count == 1:
            return mean, None
        mean = low_pass(mean, AGREEMENT_SIGMA)
        return mean, mean

    def match_descriptor(
        self, start: Tensor, expected: Tensor | None, closeness: float, budget: int | None = None
    ) -> Tensor:
        """Images (B, 1, H, W) with the descriptor, from ``start``, within ``budget`` evaluations or all that remain."""
        budget = budget or self.remaining_evaluations()
        return self.match(start.unsqueeze(1), None, budget, expected, closeness)[:, 0]

    def _report(self) -> None:
        if self.progress is None:
            return
        self._calls += 1
        if self.evaluations.device.type != "cpu" and self._calls % CALLS_BETWEEN_REPORTS:
            return
        done = int(self.evaluations.max())
        if done > self._reported:
            self._reported = done
            self.progress(done, self.max_evaluations)

    def _account(self, objective: PreimageObjective, count: int) -> Callable[[Tensor, Tensor], None]:
        """The minimiser's callback after each evaluation: records evaluations and distances, and reports progress.

        The ``count`` images of one descriptor are evaluated together, but counted one after the other.
        """
        spent = torch.zeros(len(self.evaluations) * count, dtype=torch.long, device=self.evaluations.device)

        def watch(index: Tensor, evaluations: Tensor) -> None:
            new = torch.zeros_like(spent).index_copy(0, index, evaluations - spent[index]).view(-1, count)
            spent[index] = evaluations
            counted = (self.evaluations.unsqueeze(1) + new.cumsum(dim=1)) * (new > 0)  # 0: it had ended before
            descriptors = torch.div(index, count, rounding_mode="floor")
            self.history.add(counted.flatten()[index], descriptors, objective.distance[index])
            self.evaluations = self.evaluations + new.sum(dim=1)
            self._report()
            if self.watch is not None:
                assert objective.images is not None
                candidates = objective.images.view(-1, count, *objective.images.shape[1:])
                distance = objective.distance.view(-1, count).mean(dim=1)
                self.show(distance, candidates)

        return watch
