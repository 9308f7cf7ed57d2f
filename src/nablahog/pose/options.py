"""The options of a search for a pose, by name, and the trace of a search."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeAlias

SimilarityKind: TypeAlias = Literal["patches", "calibrated"]
SearchMethod: TypeAlias = Literal["best", "paper", "paper-edges", "exhaustive"]
FocalSource: TypeAlias = Literal["given", "exif", "assumed"]
ORDER = 9  # the largest offset in cells of a background: for templates of up to 10x10


class Lens(NamedTuple):
    """What is known about a photograph's camera."""

    focal: float | None  # focal length, pixels; None if unknown
    principal_point: tuple[float, float] | None  # x, y of the optical axis, pixels; None if unknown
    source: FocalSource  # where the focal length is from


@dataclass(frozen=True, eq=False)
class SearchTrace:
    """The poses that a search from one start went through.

    Attributes:
        model: the model's name.
        azimuths: degrees, in order, of any turn.
        similarities: at these poses.
    """

    model: str
    azimuths: tuple[float, ...]
    similarities: tuple[float, ...]
