"""Section 3.1 as published: from noise to the minimum of Eq. 9 over gray values, by Powell's dogleg."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import TypeAlias

import torch
from torch import Tensor

from ..hog.spec import HOGSpec
from ..optimize import Accepted, History, StopReason, dogleg
from ..runtime.memory import memory_for
from .histograms import searchable
from .iterate import Iterate, Watch
from .method import AsPublished
from .published_objective import PublishedObjective
from .reconstruction import Reconstruction, as_returned, relative_distance
from .start import noise

Progress: TypeAlias = Callable[[int, int], None]

TRIALS = 50  # evaluations of an iteration beside the products of its step: far more than it takes
AT_ONCE = 2**20  # pixels of the images that are searched together on a CPU
NUMBERS = 128  # that a search holds for each pixel: vectors, images of them, and the graph; an estimate
SHARE = 0.5  # of a GPU's free memory that searches may take


def reconstruct_as_published(
    descriptor: Tensor,
    spec: HOGSpec,
    size: tuple[int, int],
    options: AsPublished,
    *,
    seed: int = 0,
    start: Tensor | None = None,
    progress: Progress | None = None,
    watch: Watch | None = None,
) -> Reconstruction:
    """Images whose HOG is the given descriptor, by the paper's search.

    Args:
        descriptor: (B, rows, cols, channels), float32 or float64.
        spec: the dialect that made it.
        size: (height, width) of the images.
        options: of the search.
        seed: of the noise, the same for every image.
        start: (B, 1, H, W) in 0…1, images to begin with; by default noise.  A descriptor that leaves the contrast open
            makes it that of the noise: against a strong contrast the smoothness would count for more.
        progress: called with the iterations done and the most there can be.
        watch: called after each iteration.

    Raises:
        ValueError: as :func:`.histograms.searchable`.
    """
    began = time.perf_counter()
    options = options.for_spec(spec)
    assert options.noise is not None
    batch, height, width = len(descriptor), *size
    grain = noise(descriptor, height, width, 1, seed, options.noise)[0]
    first = grain.expand(batch, -1, -1, -1) if start is None else _centred(start, grain, spec)
    pixel = NUMBERS * descriptor.element_size()
    at_once = max(1, memory_for(descriptor.device, AT_ONCE * pixel, SHARE) // (pixel * height * width))
    parts = [slice(begin, begin + at_once) for begin in range(0, batch, at_once)]
    searches = [_Search(descriptor[part], searchable(spec), size, options, watch, part) for part in parts]
    for number, (part, search) in enumerate(zip(parts, searches, strict=True)):
        search.run(first[part], _share(progress, number, len(parts)))
    length = max(int(search.evaluations.max()) for search in searches)
    image = as_returned(torch.cat([search.image for search in searches]), spec)
    iterates = [search.iterates.flatten(0, 1) for search in searches if search.iterates is not None]
    return Reconstruction(
        image,
        relative_distance(image, descriptor, spec),
        [reason for search in searches for reason in search.stop_reason],
        torch.cat([search.history.filled(length) for search in searches], dim=1),
        torch.cat([search.evaluations for search in searches]),
        time.perf_counter() - began,
        as_returned(torch.cat(iterates), spec).reshape(batch, -1, 1, height, width).transpose(0, 1)
        if iterates
        else None,
    )


def _centred(start: Tensor, grain: Tensor, spec: HOGSpec) -> Tensor:
    """Images (B, 1, H, W) around 0, of the contrast of the noise ``grain`` where the descriptor leaves it open.

    A constant image is replaced by the noise: all derivatives vanish there, and no search would leave it.
    """
    centred = start - start.mean(dim=(1, 2, 3), keepdim=True)
    spread = centred.square().mean(dim=(1, 2, 3), keepdim=True).sqrt()
    if not spec.normalizer.fixes_contrast:
        centred = centred * (grain.square().mean().sqrt() / torch.where(spread > 0, spread, 1))
    return torch.where((start == start[..., :1, :1]).flatten(1).all(dim=1).reshape(-1, 1, 1, 1), grain, centred)


def _share(progress: Progress | None, number: int, count: int) -> Progress | None:
    """``progress`` for one of ``count`` parts."""
    return None if progress is None else lambda done, most: progress(number * most + done, count * most)


class _Search:
    """The minimisations of a batch, one for each ξ.

    Attributes:
        image: (B, 1, H, W), those found so far.  Gray values are around 0: a small contrast would be rounded at 0.5.
        iterates: (B, iterations + 1, 1, H, W), the images after each iteration, from the start on, if they are kept; a
            search that has ended repeats its last.
        evaluations: (B,) int64, spent so far.
        history: of distances.
        stop_reason: why each image's last minimisation ended.
    """

    def __init__(
        self,
        descriptor: Tensor,
        spec: HOGSpec,
        size: tuple[int, int],
        options: AsPublished,
        watch: Watch | None,
        part: slice,
    ) -> None:
        self.descriptor, self.spec, self.size, self.options = descriptor, spec, size, options
        self.watch, self.part = watch, part
        self.evaluations = torch.zeros(len(descriptor), dtype=torch.long, device=descriptor.device)
        self.history = History(len(descriptor))
        self.stop_reason: list[StopReason] = []
        self.iterates: Tensor | None = None
        self._before = self.evaluations  # spent on the ξ before

    def run(self, start: Tensor, progress: Progress | None) -> None:
        """From images (B, 1, H, W) around 0 on."""
        options, self.image = self.options, start
        most = options.iterations * len(options.course)
        if options.keep_iterates:
            self.iterates = start.unsqueeze(1).repeat(1, most + 1, 1, 1, 1)
        for stage, smoothness in enumerate(options.course):
            self._before = self.evaluations
            objective = PublishedObjective(
                self.descriptor, self.spec, self.size, smoothness, options.norms, options.neighbours
            )
            self._minimise(objective, partial(self._accepted, objective, stage * options.iterations, most, progress))

    def _minimise(self, objective: PublishedObjective, accepted: Accepted) -> None:
        options = self.options
        all_iterations = options.iterations * (options.cg_iterations + TRIALS)
        share = all_iterations if options.max_evaluations is None else options.max_evaluations // len(options.course)
        minimum = dogleg(
            objective,
            self.image.flatten(1),
            max_evaluations=max(1, share),
            max_iterations=options.iterations,
            cg_iterations=options.cg_iterations,
            cg_tolerance=options.cg_tolerance,
            watch=partial(self._watch, objective),
            accepted=accepted,
        )
        self.image = objective.images(minimum.x)
        self.stop_reason = minimum.stop_reason

    def _watch(self, objective: PublishedObjective, index: Tensor, evaluations: Tensor) -> None:
        spent = self._before[index] + evaluations
        self.evaluations = self.evaluations.index_copy(0, index, spent)
        self.history.add(spent, index, objective.distance[index])

    def _accepted(
        self,
        objective: PublishedObjective,
        before: int,
        most: int,
        progress: Progress | None,
        index: Tensor,
        iterations: Tensor,
        points: Tensor,
    ) -> None:
        """Keeps the points (A, H·W) of the problems ``index`` after so many iterations, and ``before`` of other ξ."""
        if self.iterates is not None:
            later = torch.arange(most + 1, device=index.device) >= before + iterations.unsqueeze(1)  # (A, most + 1)
            images = points.reshape(-1, 1, 1, *self.size)
            self.iterates[index] = torch.where(later[..., None, None, None], images, self.iterates[index])
        if progress is not None:
            progress(before + int(iterations.max()), most)
        if self.watch is not None:
            self.image = self.image.index_copy(0, index, objective.images(points))
            self.watch(Iterate(self.part, self.evaluations, objective.distance, self.image.unsqueeze(1), self.spec))
