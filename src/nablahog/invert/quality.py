"""How much is spent on an image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from ..hog.checks import check_choice

QualityName: TypeAlias = Literal["best", "fast"]


@dataclass(frozen=True)
class Quality:
    """What a search may spend.

    Attributes:
        evaluations: of the operator, where several samples are drawn.
        without_samples: where none are.
        samples: images with the same histograms, whose mean is what to expect.
        on_histograms: evaluations of the normaliser alone, to undo it; each costs the cells, not the pixels.
        on_colours: evaluations of the operator, for the colours of a gray image.
    """

    evaluations: int
    without_samples: int
    samples: int
    on_histograms: int
    on_colours: int


_QUALITIES: dict[QualityName, Quality] = {
    "best": Quality(evaluations=660, without_samples=480, samples=4, on_histograms=200, on_colours=300),
    "fast": Quality(evaluations=80, without_samples=80, samples=2, on_histograms=60, on_colours=60),
}


def quality_of(name: QualityName) -> Quality:
    """What ``name`` stands for.

    Raises:
        ValueError: there is no quality of that name.
    """
    check_choice("quality", name, QualityName)
    return _QUALITIES[name]
