"""How far apart two descriptors are on a common ground, and the share of each convention in it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ..hog import HOGSpec
from ..hog.box import Box
from .conventions import essential, exchangeable
from .describer import Describer
from .grounds import Entries, Ground, common_region, region, unit
from .shares import Share, shapley

SAME = 1e-5  # two descriptors no further apart are the same: float32 rounds by less
UNRELATED = math.sqrt(2)

Progress = Callable[[int, int, str], None]


@dataclass(frozen=True)
class Distance:
    """How far apart two descriptors are on a common ground.

    Attributes:
        distance: ‖a − b‖, each scaled to length 1: 0 if they are equal, √2 if they have nothing in common.
        shares: of the conventions in its square, the largest first; empty if the descriptors are the same.
        largest, rms: largest and root mean square difference of their entries as they are, not scaled.
        region: the cells compared, which both have, and all mixtures of both.
    """

    distance: float
    shares: Sequence[Share]
    largest: float
    rms: float
    region: Box

    @property
    def same(self) -> bool:
        """Whether there is no more between them than rounding."""
        return self.distance <= SAME


class Question:
    """Two specs to compare on a ground that both have.

    Conventions of ``a`` are exchanged for those of ``b`` one after the other.  A convention's share is how much closer
    its exchange brings the descriptor to that of ``b``, and how much further from that of ``a``: the mean of the falls
    of the squared distance to ``b``, and of those to ``a`` on the way back, over all orders.  So it makes no difference
    which of the two comes first.

    Raises:
        ValueError: the image is too small for one of them, or for a cell that both, and all mixtures, have.
    """

    def __init__(self, describer: Describer, a: HOGSpec, b: HOGSpec, ground: Ground) -> None:
        names = f"{a.name} and {b.name}"
        for spec in (a, b):
            spec.grid(*describer.size)  # or the error why there is none
        a, b = (essential(ground.reduced(spec), describer.channels) for spec in (a, b))
        self.ground, self.specs = ground, (a, b)
        self.conventions, mixtures = exchangeable(a, b, lambda spec: _fits(spec, describer.size))
        cells = common_region([region(spec, describer.size) for spec in mixtures])
        if cells is None:
            raise ValueError(f"the image is too small for {names} to have a cell in common")
        self.region = cells
        self.mixtures = [describer.computed(essential(spec, describer.channels)) for spec in mixtures]
        self.ends = self.mixtures[0], self.mixtures[-1]
        self.done = [0.0] * len(mixtures)

    def begin(self, first: Entries, last: Entries) -> bool:
        """Takes the descriptors of both ends; whether they differ, and those of the mixtures are wanted."""
        one, other = first.within(self.region).double(), last.within(self.region).double()
        apart = (one - other).abs()
        self.largest, self.rms = float(apart.max()), float(apart.square().mean().sqrt())
        self.way = unit(one) - unit(other)
        self.distance = float(self.way.norm())
        return self.distance > SAME

    def step(self, number: int, found: Entries) -> None:
        """Takes the descriptor of a mixture."""
        # of vectors x of one length, half of ‖x - b‖² - ‖x - a‖² is x · (a - b), up to a constant
        self.done[number] = -float(unit(found.within(self.region).double()) @ self.way)

    def answer(self) -> Distance:
        """What was found."""
        shares: list[Share] = []
        if self.distance > SAME:
            found = shapley(self.done, len(self.conventions))
            a, b = self.specs
            says = [(each.said(a), each.said(b)) for each in self.conventions]
            shares = [Share(*each) for each in zip(self.conventions, says, found, strict=True)]
            shares.sort(key=lambda share: -share.share)
        return Distance(self.distance, shares, self.largest, self.rms, self.region)


def answers(describer: Describer, questions: Sequence[Question], progress: Progress | None = None) -> list[Distance]:
    """The distances asked for; of all of them together each descriptor is computed once."""
    grounds: dict[HOGSpec, set[Ground]] = {}
    for question in questions:
        for spec in question.ends:
            grounds.setdefault(spec, set()).add(question.ground)
    ends = {
        (spec, ground): ground.entries(descriptor, spec, describer.size)
        for spec, descriptor in describer.descriptors(grounds)
        for ground in grounds[spec]
    }
    wanted: dict[HOGSpec, dict[Ground, list[tuple[Question, int]]]] = {}
    for question in questions:
        if question.begin(*(ends[spec, question.ground] for spec in question.ends)):
            for number, spec in enumerate(question.mixtures):
                wanted.setdefault(spec, {}).setdefault(question.ground, []).append((question, number))
    for done, (spec, descriptor) in enumerate(describer.descriptors(wanted)):
        if progress:
            progress(done, len(wanted), "descriptors")
        for ground, asked in wanted[spec].items():
            found = ground.entries(descriptor, spec, describer.size)
            for question, number in asked:
                question.step(number, found)
    return [question.answer() for question in questions]


def _fits(spec: HOGSpec, size: tuple[int, int]) -> bool:
    try:
        region(spec, size)
    except ValueError:
        return False
    return True
