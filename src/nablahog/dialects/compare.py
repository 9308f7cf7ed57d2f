"""Every two dialects on a photograph."""

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
from .describer import Describer
from .distances import Distance, Progress, Question, answers
from .grounds import Orientations, same_channels
from .ties import Ties, ties


@dataclass(frozen=True)
class Pair:
    """Two dialects on a photograph.

    Attributes:
        a, b: their names.
        orientations: on the ground that all HOGs share, :class:`.grounds.Orientations`.
        parts: which channels have the same meaning in both; empty if none.
        channels: on these, as they are; None if there are none.
    """

    a: str
    b: str
    orientations: Distance
    parts: tuple[Part, ...]
    channels: Distance | None


@dataclass(frozen=True)
class Comparison:
    """Dialects on a photograph.

    Attributes:
        specs: by name.
        pairs: every two, in the order of the names.
        ties: of each dialect, by name.
    """

    specs: Mapping[str, HOGSpec]
    pairs: Sequence[Pair]
    ties: Mapping[str, Ties]

    def by_likeness(self) -> list[str]:
        """The names in an order in which neighbours are alike."""
        names = list(self.specs)
        tree = linkage(squareform(self.matrix(), checks=False), "average", optimal_ordering=True)
        return [names[k] for k in leaves_list(tree)]

    def matrix(self) -> NDArray[np.float64]:
        """All distances on the common ground, (dialects, dialects), symmetric."""
        names = list(self.specs)
        found = np.zeros((len(names), len(names)))
        for pair in self.pairs:
            i, j = names.index(pair.a), names.index(pair.b)
            found[i, j] = found[j, i] = pair.orientations.distance
        return found


def compare(image: Tensor, specs: Mapping[str, HOGSpec], progress: Progress | None = None) -> Comparison:
    """Compares the descriptors of a photograph in several dialects.

    Args:
        image: (C, H, W), uint8, C 1 or 3.
        specs: at least two, by name, with cells of one size.
        progress: called with the descriptors done, their number, and what they are.

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
    grounds = [same_channels(specs[a], specs[b]) for a, b in names]
    common = [Question(describer, specs[a], specs[b], Orientations()) for a, b in names]
    further = [Question(describer, specs[a], specs[b], g) for (a, b), g in zip(names, grounds, strict=True) if g]
    found = answers(describer, [*common, *further], progress)
    of_channels = iter(found[len(common) :])
    pairs = [
        Pair(a, b, distance, ground.parts if ground else (), next(of_channels) if ground else None)
        for (a, b), distance, ground in zip(names, found[: len(common)], grounds, strict=True)
    ]
    return Comparison(specs, pairs, {name: ties(describer, spec) for name, spec in specs.items()})


def alike(names: Sequence[str], pairs: Sequence[tuple[str, str]]) -> list[list[str]]:
    """Groups of at least two names of which every two are among the pairs, as large as they come."""
    groups: list[list[str]] = []
    together = {frozenset(pair) for pair in pairs}
    for name in names:
        group = next((g for g in groups if all(frozenset((name, other)) in together for other in g)), None)
        if group is None:
            groups.append([name])
        else:
            group.append(name)
    return [group for group in groups if len(group) > 1]
