"""What a search for a pose is asked for, by name, and what it went through."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeAlias

SimilarityKind: TypeAlias = Literal["patches", "calibrated"]
SearchMethod: TypeAlias = Literal["best", "paper", "paper-edges", "exhaustive"]
FocalSource: TypeAlias = Literal["given", "exif", "assumed"]
ORDER = 9  # the largest offset in cells of a background: for templates of up to 10x10


class Lens(NamedTuple):
    """What is known of a photograph's camera.

    Attributes:
        focal: focal length, pixels; None if unknown.
        principal_point: x, y where the optical axis meets the photograph, pixels; None if unknown, or its middle.
        source: where the focal length is from.
    """

    focal: float | None
    principal_point: tuple[float, float] | None
    source: FocalSource


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
