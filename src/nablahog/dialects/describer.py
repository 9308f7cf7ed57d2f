"""Many descriptors of one photograph; steps that several dialects share are computed once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from ..hog import HOGSpec
from ..hog.gradient import gradient
from ..hog.orientation import votes
from ..hog.pooling import pool, pooling_matrices
from ..hog.steps import normalize_reference

_GRADIENT = ("gamma", "value_range", "colour", "colour_ties", "mask", "border")
_VOTES = ("bins", "signed", "bin_offset", "counterclockwise", "vote", "angle", "directions", "boundary")
_CELLS = ("cell_size", "partial_cells", "pooling")


class Describer:
    """The descriptors of a photograph.

    Args:
        image: (C, H, W), uint8, C 1 or 3.
    """

    def __init__(self, image: Tensor) -> None:
        self.image = image.unsqueeze(0)
        self.channels = int(image.shape[0])
        self.size = int(image.shape[1]), int(image.shape[2])
        self._cells: dict[object, dict[str, Any]] = {}
        self._weights: dict[object, dict[str, Any]] = {}

    def computed(self, spec: HOGSpec) -> HOGSpec:
        """One spec for all those with the same descriptor, so that it is computed once.

        Its descriptor may have more cells around those of ``spec``.
        """
        changes: dict[str, Any] = {"normalizer": spec.normalizer.of_all_cells()}
        if not spec.pooling.has_blocks:
            changes |= self._same_cells(spec)
        return replace(spec, **changes)

    def _same_cells(self, spec: HOGSpec) -> dict[str, Any]:
        """The first conventions of cells with these weights; in images of whole cells all have the same."""
        rules = (spec.border == "ignore", *(getattr(spec, name) for name in _CELLS))
        if rules not in self._cells:
            matrices = pooling_matrices(spec, *self.size, torch.empty(0))
            weights = tuple((tuple(each.shape), each.numpy().tobytes()) for each in matrices)
            conventions = {name: getattr(spec, name) for name in _CELLS}
            self._cells[rules] = self._weights.setdefault((*rules[:2], *weights), conventions)
        return self._cells[rules]

    def descriptors(self, specs: Iterable[HOGSpec]) -> Iterator[tuple[HOGSpec, Tensor]]:
        """Specs with their descriptors (1, rows, cols, channels), float32, as :func:`nablahog.hog` returns them.

        Their order is that of the steps that they share.
        """
        for same_gradient in _grouped(specs, _gradient_key):
            gx, gy = self.gradient(same_gradient[0])
            for same_votes in _grouped(same_gradient, _key(_VOTES)):
                pixel_votes = votes(gx, gy, same_votes[0])
                for same_cells in _grouped(same_votes, _key(_CELLS)):
                    cells = pool(pixel_votes, same_cells[0])
                    for spec in same_cells:
                        histograms = cells.reshape(1, spec.colours * spec.bins, *cells.shape[2:])
                        yield spec, normalize_reference(histograms, spec).permute(0, 2, 3, 1)

    def gradient(self, spec: HOGSpec, dtype: torch.dtype = torch.float32) -> tuple[Tensor, Tensor]:
        """Gx, Gy, each (colours, H, W), in units of the spec's ``value_range``."""
        return gradient(self.image.to(dtype) * (spec.value_range / 255), spec)


def _key(fields: tuple[str, ...]) -> Callable[[HOGSpec], object]:
    return lambda spec: tuple(getattr(spec, name) for name in fields)


def _gradient_key(spec: HOGSpec) -> object:
    # dlib's colour ties depend on how many columns of cells there are
    return _key(_GRADIENT + (_CELLS if spec.colour_ties == "dlib" else ()))(spec)


def _grouped(specs: Iterable[HOGSpec], key: Callable[[HOGSpec], object]) -> Iterable[list[HOGSpec]]:
    """The specs in groups of equal keys."""
    groups: dict[object, list[HOGSpec]] = {}
    for spec in specs:
        groups.setdefault(key(spec), []).append(spec)
    return groups.values()
