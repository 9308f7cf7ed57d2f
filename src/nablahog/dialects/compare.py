"""Comparison of every two dialects on a photograph, and its ties: gradients between two bins or two colour channels."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.cluster.hierarchy import leaves_list, linkage
from scipy.spatial.distance import squareform
from torch import Tensor

from ..hog import HOGSpec
from ..hog.normalizers import Part
from ..hog.orientation import bin_angles, direction
from .common_form import Orientations, same_channels
from .describer import Describer
from .distances import Distance, Progress, Query, distances

_SLACK = 1e-7  # bins; other gradients of 8-bit values are further from a boundary
_EQUAL = 1e-9  # relative rounding error of equal products


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
class Ties:
    """Ties as shares of the gradients that are not 0, of pixels that vote.

    Attributes:
        gradients: their number: one a pixel, or three for separate colours.
        between_bins: share of those exactly between two bins, of hard votes; None for linear votes, which have no ties.
        between_colours: share of those with different gradients of the largest magnitude in two channels; None if the
            dialect does not take the largest channel.
        directions: multiples of 45°, in degrees, that lie between two bins; gradients of 8-bit values meet no other
            boundaries exactly.
    """

    gradients: int
    between_bins: float | None
    between_colours: float | None
    directions: tuple[float, ...]


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


def ties(describer: Describer, spec: HOGSpec) -> Ties:
    """Counts the ties of a photograph in a dialect, in exact arithmetic."""
    spec = replace(spec, value_range=255.0)  # differences of 8-bit values are exact
    gx, gy = describer.gradient(spec, torch.float64)
    voting = (gx != 0) | (gy != 0)
    if spec.border == "ignore":
        voting[:, [0, -1]] = False
        voting[:, :, [0, -1]] = False
    number = int(voting.sum())

    def share(tied: Tensor) -> float:
        return float((tied & voting).sum()) / number if number else 0.0

    hard = spec.vote == "hard"
    return Ties(
        number,
        share(_between_bins(gx, gy, spec)) if hard else None,
        share(_between_colours(describer, spec)) if spec.colour == "largest" and describer.channels > 1 else None,
        _directions(spec) if hard else (),
    )


def _between_bins(gx: Tensor, gy: Tensor, spec: HOGSpec) -> Tensor:
    bins = direction(gx, gy) / spec.period * spec.bins
    position = (-bins if spec.counterclockwise else bins) - spec.bin_offset
    return (position - position.floor() - 0.5).abs() < _SLACK


def _between_colours(describer: Describer, spec: HOGSpec) -> Tensor:
    """Whether several channels have the largest magnitude with different gradients (opposite ones, if unsigned, are
    equal)."""
    gx, gy = describer.gradient(replace(spec, colour="separate"), torch.float64)
    squared = gx * gx + gy * gy
    largest = squared >= squared.amax(dim=0) * (1 - _EQUAL)
    first = largest.to(torch.uint8).argmax(dim=0, keepdim=True)
    x, y = gx.gather(0, first), gy.gather(0, first)
    along, across = gx * x + gy * y, gx * y - gy * x
    equal = (across.abs() <= _EQUAL * squared) & ((along > 0) | (not spec.signed))
    return (largest & ~equal).any(dim=0, keepdim=True)


def _directions(spec: HOGSpec) -> tuple[float, ...]:
    period = math.degrees(spec.period)
    between = np.degrees(bin_angles(spec) + spec.period / spec.bins / 2).tolist()
    return tuple(sorted({round(angle) % period for angle in between if abs(angle - 45 * round(angle / 45)) < 1e-6}))
