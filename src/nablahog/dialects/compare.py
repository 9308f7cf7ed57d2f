"""Comparison of every two dialects on a photograph."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.cluster.hierarchy import leaves_list, linkage
from scipy.spatial.distance import squareform
from torch import Tensor

from ..hog import HOGSpec
from ..hog.normalizers import Part
from .common_form import Orientations, same_channels
from .describer import Describer
from .distances import Distance, Progress, Query, distances
from .ties import Ties, ties


@dataclass(frozen=True)
class Pair:
    """Two dialects on a photograph.

    Attributes:
        a, b: their names.
        orientations: the distance in the form that all HOGs have, :class:`.common_form.Orientations`.
        parts: channels with the same meaning in both; may be empty.
        channels: the distance in these channels, unchanged; None if there are none.
    """

    a: str
    b: str
    orientations: Distance
    parts: tuple[Part, ...]
    channels: Distance | None


@dataclass(frozen=True)
class Comparison:
    """Distances and ties of dialects on a photograph.

    Attributes:
        specs: the dialects by name.
        pairs: every two of them, in the order of the names.
        ties: of each dialect, by name.
    """

    specs: Mapping[str, HOGSpec]
    pairs: Sequence[Pair]
    ties: Mapping[str, Ties]

    def by_likeness(self) -> list[str]:
        """The names in the order of a hierarchical clustering: similar dialects are neighbours."""
        names = list(self.specs)
        tree = linkage(squareform(self.matrix(), checks=False), "average", optimal_ordering=True)
        return [names[k] for k in leaves_list(tree)]

    def matrix(self, names: Sequence[str] | None = None) -> NDArray[np.float64]:
        """All distances in the common form, (dialects, dialects), symmetric, in the order of ``names``."""
        names = list(self.specs if names is None else names)
        matrix = np.zeros((len(names), len(names)))
        for pair in self.pairs:
            i, j = names.index(pair.a), names.index(pair.b)
            matrix[i, j] = matrix[j, i] = pair.orientations.distance
        return matrix


def compare(image: Tensor, specs: Mapping[str, HOGSpec], progress: Progress | None = None) -> Comparison:
    """Compares the descriptors of a photograph in several dialects.

    Args:
        image: (C, H, W), uint8, C 1 or 3.
        specs: at least two, by name, with cells of one size.
        progress: called with the number of descriptors computed, their total, and the word "descriptors".

    Raises:
        ValueError: the image is no such tensor, or too small for a dialect, or for two to have a cell in common; or
            there are fewer than two dialects, or their cells differ.
    """
    if not isinstance(image, Tensor) or image.dtype != torch.uint8 or image.dim() != 3 or image.shape[0] not in (1, 3):
        raise ValueError("expected an image (1 or 3, H, W) of uint8")
    if len(specs) < 2 or len({spec.cell_size for spec in specs.values()}) > 1:
        raise ValueError("expected at least two dialects with cells of one size")
    describer = Describer(image)
    names = list(itertools.combinations(specs, 2))
    channels = [same_channels(specs[a], specs[b]) for a, b in names]
    common = [Query(describer, specs[a], specs[b], Orientations()) for a, b in names]
    further = [Query(describer, specs[a], specs[b], form) for (a, b), form in zip(names, channels, strict=True) if form]
    measured = iter(distances(describer, [*common, *further], progress))
    orientations = [next(measured) for _ in names]
    pairs = [
        Pair(a, b, distance, form.parts if form else (), next(measured) if form else None)
        for (a, b), distance, form in zip(names, orientations, channels, strict=True)
    ]
    return Comparison(specs, pairs, {name: ties(describer, spec) for name, spec in specs.items()})


def cliques(names: Sequence[str], pairs: Sequence[tuple[str, str]]) -> list[list[str]]:
    """Groups of at least two names of which every two are among the pairs; greedy, in the order of the names."""
    groups: list[list[str]] = []
    linked = {frozenset(pair) for pair in pairs}
    for name in names:
        group = next((g for g in groups if all(frozenset((name, other)) in linked for other in g)), None)
        if group is None:
            groups.append([name])
        else:
            group.append(name)
    return [group for group in groups if len(group) > 1]
