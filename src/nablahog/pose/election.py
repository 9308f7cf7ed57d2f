"""The side of the object on which poses of several models agree.

One wrong model may fit anywhere; where many fit is the object.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from .hypothesis import Hypothesis

SAME_SIDE = 15.0  # degrees: poses whose azimuths are closer look at the object from the same side
_COARSE = 0.7  # of the similarity that poses are elected by: large cells tell sides apart, small ones models
_AGREED = 0.8  # of similarity: a pose that has so much less counts a factor e less
_BLUR = 12.0  # degrees


@dataclass(frozen=True, eq=False)
class Side:
    """Poses that look at the object from the same side.

    Attributes:
        poses: the one with the highest fine similarity first.
        share: of the votes of all poses, in 0…1.
    """

    poses: tuple[Hypothesis, ...]
    share: float

    @property
    def viewpoint(self) -> Tensor:
        """Azimuth, elevation and in-plane rotation, (3,), degrees: the mean of all poses, which no one model has.

        Models that are not the object's own are each off by some degrees, in all directions.
        """
        weights = _weights(torch.tensor([one.score for one in self.poses]))
        angles = torch.stack([one.pose[[0, 1, 3]] for one in self.poses])
        first = angles[0]
        return first + weights @ _turn(angles - first) / weights.sum()


def sides(poses: Sequence[Hypothesis], count: int, evidence: Tensor) -> list[Side]:
    """The sides with most votes, these first.

    Args:
        poses: of several models, near maxima of the fine similarity, which is theirs.
        count: the most to return.
        evidence: how likely their azimuths are whatever the model, logarithms, (N,).
    """
    azimuths = torch.tensor([one.azimuth for one in poses], dtype=torch.float64)
    similarities = [_COARSE * one.coarse + (1 - _COARSE) * one.similarity - one.unlikely for one in poses]
    weights = _weights(torch.tensor(similarities).double() + _AGREED * evidence)
    votes, total = consensus(azimuths, weights), float(weights.sum())
    found: list[Side] = []
    while len(found) < count and votes.isfinite().any():
        near = _turn(azimuths - azimuths[votes.argmax()]).abs() <= SAME_SIDE
        here = [poses[k] for k in (near & votes.isfinite()).nonzero()[:, 0].tolist()]
        share = float(weights[near & votes.isfinite()].sum()) / total
        found.append(Side(tuple(sorted(here, key=lambda one: -one.score)), share))
        votes[near] = -torch.inf
    return found


def consensus(azimuths: Tensor, weights: Tensor) -> Tensor:
    """Votes for the azimuths (N,), degrees, of poses of the given weights (N,): for each pose those near it, (N,)."""
    apart = _turn(azimuths[:, None] - azimuths)
    return torch.exp(-0.5 * (apart / _BLUR) ** 2) @ weights


def _weights(similarities: Tensor) -> Tensor:
    """Of poses in a vote, (N,), float64."""
    return torch.exp((similarities.double() - similarities.max()) / _AGREED)


def _turn(angles: Tensor) -> Tensor:
    """The same angles in -180…180 degrees."""
    return (angles + 180) % 360 - 180
