"""One reconstruction's minimisations, and its account of evaluations and distances over all of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal, TypeAlias, get_args

import torch
from torch import Tensor

from ..hog.spec import HOGSpec
from ..optimize import History, Minimiser, StopReason, minimise
from .flat import FlatRegions
from .objective import PreimageObjective
from .parameterize import CosineBasis, Parameterization, Pixels
from .priors import Prior

Basis: TypeAlias = Literal["cosine", "pixels"]
EXPONENT = 0.75  # of the cosine basis: 1 converges first in the large, 0.5 in the small


class PreimageSearch:
    """Finds images of given histograms or descriptors from given starts, several for each descriptor.

    Args:
        descriptor: (B, rows, cols, channels).
        spec: its dialect.
        size: (height, width) of the images.
        priors: of all of them.
        basis: the unknowns.
        minimiser: its name.
        max_evaluations: of each descriptor, over all its images.
        progress: called with the evaluations done and the most there can be.

    Raises:
        ValueError: there is no such basis.
    """

    def __init__(
        self,
        descriptor: Tensor,
        spec: HOGSpec,
        size: tuple[int, int],
        priors: Sequence[Prior],
        basis: Basis,
        minimiser: Minimiser,
        max_evaluations: int,
        progress: Callable[[int, int], None] | None,
    ) -> None:
        if basis not in get_args(Basis):
            raise ValueError(f"basis must be one of {', '.join(map(repr, get_args(Basis)))}, got {basis!r}")
        self.descriptor, self.spec, self.size, self.priors = descriptor, spec, size, priors
        self.unknowns: Parameterization = (
            CosineBasis(*size, descriptor, EXPONENT) if basis == "cosine" else Pixels(*size)
        )
        self.minimiser: Minimiser = minimiser
        self.max_evaluations, self.progress = max_evaluations, progress
        batch = len(descriptor)
        self.evaluations = torch.zeros(batch, dtype=torch.long, device=descriptor.device)
        self.stop_reason: list[StopReason] = []
        self._history = History(descriptor, batch)
        self._done = self._given = 0

    def left(self) -> int:
        """Evaluations that no :meth:`match` so far was given, for each descriptor; at least 1.

        What one of them did not need is not passed on, since it differs from image to image of a batch.
        """
        return max(1, self.max_evaluations - self._given)

    def history(self, length: int | None = None) -> Tensor:
        """(length, B): relative distances, as :class:`.preimage.Reconstruction` has them; by default of the longest."""
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
        self._given += budget * count
        distances = self.descriptor.new_zeros(batch * count)
        spent = torch.zeros(batch * count, dtype=torch.long, device=starts.device)
        before = self.evaluations.clone()

        def report(distance: Tensor, index: Tensor) -> None:
            distances[index] = distance

        def watch(index: Tensor, evaluations: Tensor) -> None:
            # the images of one descriptor are evaluated together, but counted one after the other
            new = torch.zeros_like(spent).index_copy(0, index, evaluations - spent[index]).view(batch, count)
            spent[index] = evaluations
            counted = (self.evaluations.unsqueeze(1) + new.cumsum(dim=1)).flatten()[index]
            descriptors = torch.div(index, count, rounding_mode="floor")
            self._history.add(counted.clamp(min=1), descriptors, distances[index])
            self.evaluations = self.evaluations + new.sum(dim=1)
            if self.progress is not None and int(self.evaluations.max()) > self._done:
                self._done = int(self.evaluations.max())
                self.progress(self._done, self.max_evaluations)

        def each(x: Tensor) -> Tensor:
            return x.repeat_interleave(count, dim=0)

        objective = PreimageObjective(
            each(self.descriptor),
            None if votes is None else each(votes),
            self.spec,
            self.unknowns,
            FlatRegions(each(self.descriptor), self.spec, *self.size),
            self.priors,
            report,
            None if expected is None else each(expected),
            closeness,
        )
        found = minimise(
            self.minimiser,
            objective,
            self.unknowns.unknowns(starts.flatten(0, 1)),
            max_evaluations=budget,
            progress_tolerance=1e-3,
            watch=watch,
        )
        self.stop_reason = found.stop_reason[::count]
        self.evaluations = before + found.evaluations.view(batch, count).sum(dim=1)
        index = torch.arange(batch * count, device=starts.device)
        return objective.image(found.x, index).view(starts.shape)
