"""The minimisations of one reconstruction, and their account of evaluations and distances."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from ..hog.spec import HOGSpec
from ..optimize import MINIMISERS, History, Minimiser, StopReason
from .cosine import CosineBasis
from .flat import FlatRegions
from .objective import PreimageObjective
from .priors import Prior
from .reconstruction import Iterate, Watch

CALLS_BETWEEN_REPORTS = 10  # of progress on a GPU, which waits for each report
EXPONENT = 0.75  # of the cosine basis: 1 converges first at large scales, 0.5 at small ones


class PreimageSearch:
    """Searches images of given histograms or descriptors from given starts, several for each descriptor.

    Args:
        descriptor: (B, rows, cols, channels).
        spec: its dialect.
        size: (height, width) of the images.
        priors: of all of them.
        minimiser: of the search.
        max_evaluations: of each descriptor, over all its images.
        progress: called with the evaluations done and the most there can be.
        watch: called after each round of evaluations.
        part: the indices of these descriptors in the batch of :func:`.preimage.reconstruct`.

    Attributes:
        evaluations: (B,) int64, spent so far.
        stop_reason: why each descriptor's last minimisation ended.
    """

    def __init__(
        self,
        descriptor: Tensor,
        spec: HOGSpec,
        size: tuple[int, int],
        priors: Sequence[Prior],
        minimiser: Minimiser,
        max_evaluations: int,
        progress: Callable[[int, int], None] | None = None,
        watch: Watch | None = None,
        part: slice = slice(None),
    ) -> None:
        self.descriptor, self.spec, self.size, self.priors = descriptor, spec, size, priors
        self.watch, self.part = watch, part
        self.basis = CosineBasis(*size, descriptor, EXPONENT)
        self.minimiser: Minimiser = minimiser
        self.max_evaluations, self.progress = max_evaluations, progress
        batch = len(descriptor)
        self.evaluations = torch.zeros(batch, dtype=torch.long, device=descriptor.device)
        self.stop_reason: list[StopReason] = []
        self._history = History(batch)
        self._reported = self._assigned = self._calls = 0

    def left(self) -> int:
        """Evaluations that no :meth:`match` was assigned, for each descriptor; at least 1.

        Unused evaluations of a minimisation are not passed on: they differ from image to image of a batch.
        """
        return max(1, self.max_evaluations - self._assigned)

    def history(self, length: int | None = None) -> Tensor:
        """(length, B): distances, as :class:`.reconstruction.Reconstruction` has them; by default of the longest."""
        return self._history.filled(int(self.evaluations.max()) if length is None else length)

    def match(
        self,
        starts: Tensor,
        votes: Tensor | None,
        budget: int,
        expected: Tensor | None = None,
        closeness: float = 0.0,
    ) -> Tensor:
        """Images (B, K, 1, H, W) from ``starts`` of that shape, each within ``budget`` evaluations.

        They have the histograms ``votes`` (B, bins, rows, cols), or the descriptor if that is None; ``expected`` and
        ``closeness`` as in :class:`.objective.PreimageObjective`.
        """
        batch, count = starts.shape[:2]
        self._assigned += budget * count
        before = self.evaluations

        def each(x: Tensor) -> Tensor:
            return x.repeat_interleave(count, dim=0)

        objective = PreimageObjective(
            each(self.descriptor),
            None if votes is None else each(votes),
            self.spec,
            self.basis,
            FlatRegions(each(self.descriptor), self.spec, *self.size),
            [prior.of(each(torch.arange(batch, device=starts.device))) for prior in self.priors],
            None if expected is None else each(expected),
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

    def _report(self) -> None:
        """Reports progress; on a GPU only after every tenth call."""
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
            self._history.add(counted.flatten()[index], descriptors, objective.distance[index])
            self.evaluations = self.evaluations + new.sum(dim=1)
            self._report()
            if self.watch is not None:
                assert objective.images is not None
                candidates = objective.images.view(-1, count, *objective.images.shape[1:])
                distance = objective.distance.view(-1, count).mean(dim=1)
                self.watch(Iterate(self.part, self.evaluations, distance, candidates, self.spec))

        return watch
