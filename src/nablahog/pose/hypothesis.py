"""A pose that a search has come to, with its similarity."""

from __future__ import annotations

from dataclasses import dataclass, replace

from torch import Tensor

from .prepared import PreparedPhotograph
from .problem import SearchTrace


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A pose of a model with its similarity.

    Attributes:
        similarity: the last one that was computed: with large cells until the ascent, with small ones after it.
        model: its name.
        pose: (6,) for the crop.
        photograph: the crop around the object's box, or around a better one.
        place: the crop around the box that was given, or that the object may be in.
        trace: azimuth and coarse similarity of the poses so far.
        unlikely: what it loses of its similarity in comparisons, see :meth:`.problem.PoseProblem.unlikely`.
    """

    similarity: float
    model: str
    pose: Tensor
    photograph: PreparedPhotograph
    place: PreparedPhotograph
    trace: tuple[tuple[float, float], ...] = ()
    unlikely: float = 0.0

    def refined(self, pose: Tensor, similarity: float, coarse: float, unlikely: float = 0.0) -> Hypothesis:
        """A better pose, with its similarity and that of the coarse template."""
        trace = (*self.trace, (float(pose[0]), coarse))
        return replace(self, pose=pose, similarity=similarity, trace=trace, unlikely=unlikely)

    @property
    def score(self) -> float:
        """What hypotheses are ranked by."""
        return self.similarity - self.unlikely

    @property
    def azimuth(self) -> float:
        """Degrees, of any turn."""
        return float(self.pose[0])

    @property
    def coarse(self) -> float:
        """Similarity of the coarse template."""
        return self.trace[-1][1]

    def search_trace(self) -> SearchTrace:
        """Of the poses so far."""
        azimuths, similarities = zip(*self.trace, strict=True)
        return SearchTrace(self.model, azimuths, similarities)
