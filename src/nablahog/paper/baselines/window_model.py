"""The inversion that the learned baselines share: what is around a place of the descriptor gives the image there."""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Callable

import torch
from torch import Tensor

from ...hog.spec import HOGSpec
from ...invert.checks import check_descriptor
from ...invert.reconstruction import Reconstruction, relative_distance
from ...io.learned_model import LearnedModel


class WindowModel(LearnedModel):
    """A model for one dialect, ``spec``, that inverts descriptors without a search.  Nothing of it is random."""

    spec: HOGSpec

    def check(self, spec: HOGSpec) -> None:
        """Raises ValueError if descriptors of ``spec`` are not what it was learned for."""
        self.spec.check_same(spec, f"the {self.NOUN}")

    @torch.no_grad()
    def reconstruct(
        self,
        descriptor: Tensor,
        spec: HOGSpec,
        image_size: tuple[int, int] | None = None,
        *,
        progress: Callable[[int, int], None] | None = None,
    ) -> Reconstruction:
        """Images from descriptors, the interface of :func:`nablahog.reconstruct`.

        A model that does not know brightness and contrast stretches each image so that its darkest pixel is 0 and its
        brightest 1; one without contrast is 0.5.

        Args:
            descriptor: (B, rows, cols, channels), float32 or float64, on any device; computed in float32 on the CPU.
            spec: its dialect, which must be the model's.
            image_size: (height, width); by default whole cells.
            progress: called with the descriptors done and their number.

        Returns:
            No evaluation of the operator is spent, so the history is empty, (0, B).

        Raises:
            TypeError, ValueError: as :func:`nablahog.reconstruct`; the spec is not the model's.
        """
        began = time.perf_counter()
        self.check(spec)
        size = check_descriptor(descriptor, spec, image_size)
        count, rows, cols = descriptor.shape[:3]
        batch = self._batch_size(rows, cols)
        images = []
        for first in range(0, count, batch):
            if progress:
                progress(first, count)
            images.append(self._invert(descriptor[first : first + batch].float().cpu(), size))
        if progress:
            progress(count, count)
        image = torch.cat(images).to(descriptor)
        return Reconstruction(
            image,
            relative_distance(image, descriptor, spec),
            ["all windows are done"] * count,
            descriptor.new_zeros(0, count),
            torch.zeros(count, dtype=torch.long, device=descriptor.device),
            time.perf_counter() - began,
        )

    @abstractmethod
    def _batch_size(self, rows: int, cols: int) -> int:
        """The number of descriptors of rows x cols cells to invert at a time, which their memory limits."""

    @abstractmethod
    def _invert(self, descriptor: Tensor, size: tuple[int, int]) -> Tensor:
        """Images (B, 1, height, width) of ``size`` from descriptors (B, rows, cols, channels), float32."""
