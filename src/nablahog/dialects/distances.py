"""Distances of descriptors in a common form, and the contribution of each convention to them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ..hog import HOGSpec
from ..hog.box import Box
from .common_form import CommonForm, Entries, common_region, region, unit
from .conventions import essential, exchangeable
from .describer import Describer
from .shapley import ShapleyContribution, shapley

SAME = 1e-5  # two descriptors at most so far apart are the same: float32 rounds by less
UNRELATED = math.sqrt(2)

Progress = Callable[[int, int, str], None]


@dataclass(frozen=True)
class Distance:
    """The distance of two descriptors in a common form.

    Attributes:
        distance: ‖a − b‖, each scaled to length 1: 0 if they are equal, √2 if they are orthogonal.
        contributions: of the conventions to its square, the largest first; empty if the descriptors are the same.
        largest, rms: largest and root mean square difference of their entries, not scaled.
        region: the cells compared: those that both have, and all mixtures of both.
    """

    distance: float
    contributions: Sequence[ShapleyContribution]
    largest: float
    rms: float
    region: Box

    @property
    def same(self) -> bool:
        """Whether the distance is no more than rounding."""
        return self.distance <= SAME


class Query:
    """Two specs to compare in a common form.

    Conventions of ``a`` are exchanged for those of ``b`` one after the other.  The contribution of a convention is the
    mean, over all orders, of the decrease of the squared distance to ``b`` and of the increase of that to ``a``.  So it
    is symmetric in ``a`` and ``b``.

    Raises:
        ValueError: the image is too small for one of them, or for a cell that both, and all mixtures, have.
    """

    def __init__(self, describer: Describer, a: HOGSpec, b: HOGSpec, form: CommonForm) -> None:
        names = f"{a.name} and {b.name}"
        for spec in (a, b):
            spec.grid(*describer.size)  # raises its own error if there is none
        a, b = (essential(form.reduced(spec), describer.channels) for spec in (a, b))
        self.form, self.specs = form, (a, b)
        self.conventions, mixtures = exchangeable(a, b, lambda spec: _fits(spec, describer.size))
        cells = common_region([region(spec, describer.size) for spec in mixtures])
        if cells is None:
            raise ValueError(f"the image is too small for {names} to have a cell in common")
        self.region = cells
        self.mixtures = [describer.computed(essential(spec, describer.channels)) for spec in mixtures]
        self.ends = self.mixtures[0], self.mixtures[-1]
        self.values = [0.0] * len(mixtures)

    def set_ends(self, a: Entries, b: Entries) -> bool:
        """Sets the two descriptors; returns whether they differ, so that those of the mixtures are needed."""
        first, second = a.within(self.region).double(), b.within(self.region).double()
        difference = (first - second).abs()
        self.largest, self.rms = float(difference.max()), float(difference.square().mean().sqrt())
        self.direction = unit(first) - unit(second)
        self.distance = float(self.direction.norm())
        return self.distance > SAME

    def set_mixture(self, number: int, entries: Entries) -> None:
        """Sets the descriptor of a mixture."""
        # for vectors x of one length, half of ‖x - b‖² - ‖x - a‖² is x · (a - b), up to a constant
        self.values[number] = -float(unit(entries.within(self.region).double()) @ self.direction)

    def result(self) -> Distance:
        """The distance, once all descriptors are set."""
        contributions: list[ShapleyContribution] = []
        if self.distance > SAME:
            a, b = self.specs
            for convention, value in zip(self.conventions, shapley(self.values, len(self.conventions)), strict=True):
                settings = convention.settings(a), convention.settings(b)
                contributions.append(ShapleyContribution(convention, settings, value))
            contributions.sort(key=lambda each: -each.value)
        return Distance(self.distance, contributions, self.largest, self.rms, self.region)


def distances(describer: Describer, queries: Sequence[Query], progress: Progress | None = None) -> list[Distance]:
    """The distances of all queries; each descriptor is computed once."""
    forms: dict[HOGSpec, set[CommonForm]] = {}
    for query in queries:
        for spec in query.ends:
            forms.setdefault(spec, set()).add(query.form)
    ends = {
        (spec, form): form.entries(descriptor, spec, describer.size)
        for spec, descriptor in describer.descriptors(forms)
        for form in forms[spec]
    }
    mixtures: dict[HOGSpec, dict[CommonForm, list[tuple[Query, int]]]] = {}
    for query in queries:
        if query.set_ends(*(ends[spec, query.form] for spec in query.ends)):
            for number, spec in enumerate(query.mixtures):
                mixtures.setdefault(spec, {}).setdefault(query.form, []).append((query, number))
    for done, (spec, descriptor) in enumerate(describer.descriptors(mixtures)):
        if progress:
            progress(done, len(mixtures), "descriptors")
        for form, targets in mixtures[spec].items():
            entries = form.entries(descriptor, spec, describer.size)
            for query, number in targets:
                query.set_mixture(number, entries)
    return [query.result() for query in queries]


def _fits(spec: HOGSpec, size: tuple[int, int]) -> bool:
    try:
        region(spec, size)
    except ValueError:
        return False
    return True
