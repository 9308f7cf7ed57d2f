"""Poses that a search has come to: which of them are rivals, and for which side of the object several models vote.

One wrong model may fit any side; where many models fit is the object.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from .fit_box import azimuth_distance, signed_angles
from .options import SearchTrace
from .photograph import PreparedPhotograph

SAME_SIDE = 15.0  # degrees: poses whose azimuths are closer look at the object from the same side
_COARSE = 0.7  # weight in a vote of the coarse similarity, which tells sides apart; the fine one tells models apart
_AGREED = 0.8  # difference in similarity that reduces a pose's weight to 1/e
_BLUR = 12.0  # degrees
_RIVAL = 0.8  # of the best view's similarity, after tilting
_MORE_ASCENTS = 2  # if those from the best pose and its rival end at a low similarity
_RUNNERS_UP = 3  # poses from other sides that are kept


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A pose of a model with its similarity.

    Attributes:
        similarity: the last one that was computed: of large cells until the ascent, of small ones after it.
        model: its name.
        pose: (6,) for the crop.
        photograph: the crop around the object's box, or around a better one.
        place: the crop around the box that was given, or that the object may be in.
        trace: azimuth and coarse similarity of the poses so far.
        penalty: subtracted from the similarity in comparisons, see :meth:`.problem.PoseProblem.penalty`.
    """

    similarity: float
    model: str
    pose: Tensor
    photograph: PreparedPhotograph
    place: PreparedPhotograph
    trace: tuple[tuple[float, float], ...] = ()
    penalty: float = 0.0

    def moved(self, pose: Tensor, similarity: float, coarse: float, penalty: float = 0.0) -> Hypothesis:
        """The hypothesis at another pose, with its similarity and that of the coarse template."""
        trace = (*self.trace, (float(pose[0]), coarse))
        return replace(self, pose=pose, similarity=similarity, trace=trace, penalty=penalty)

    @property
    def score(self) -> float:
        """What hypotheses are ranked by."""
        return self.similarity - self.penalty

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


def vote(poses: Sequence[Hypothesis], count: int, evidence: Tensor) -> list[tuple[list[Hypothesis], float]]:
    """The sides of the object with most votes: the poses on each, the best first, and their share of all votes.

    Args:
        poses: of several models, at maxima of the fine similarity.
        count: the most sides to return.
        evidence: logarithms of the probabilities of their azimuths whatever the model, (N,).
    """
    azimuths = torch.tensor([one.azimuth for one in poses], dtype=torch.float64)
    similarities = [_COARSE * one.coarse + (1 - _COARSE) * one.similarity - one.penalty for one in poses]
    weights = _weights(torch.tensor(similarities).double() + _AGREED * evidence)
    apart = signed_angles(azimuths[:, None] - azimuths)
    votes, total = torch.exp(-0.5 * (apart / _BLUR) ** 2) @ weights, float(weights.sum())
    sides: list[tuple[list[Hypothesis], float]] = []
    while len(sides) < count and votes.isfinite().any():
        near = signed_angles(azimuths - azimuths[votes.argmax()]).abs() <= SAME_SIDE
        here = near & votes.isfinite()
        on_side = [poses[k] for k in here.nonzero()[:, 0].tolist()]
        sides.append((by_score(on_side), float(weights[here].sum()) / total))
        votes[near] = -torch.inf
    return sides


def mean_viewpoint(poses: Sequence[Hypothesis]) -> Tensor:
    """Mean azimuth, elevation and in-plane rotation, (3,), degrees, of poses on one side.

    Models that are not the object's own are each off by some degrees, in all directions.
    """
    weights = _weights(torch.tensor([one.score for one in poses]))
    angles = torch.stack([one.pose[[0, 1, 3]] for one in poses])
    first = angles[0]
    return first + weights @ signed_angles(angles - first) / weights.sum()


def by_score(poses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The best first."""
    return sorted(poses, key=lambda one: -one.score)


def with_rival(poses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The best pose, and the best from another side if it is nearly as good: front and back look much alike."""
    best = max(poses, key=lambda one: one.score)
    elsewhere = [one for one in poses if azimuth_distance(one.azimuth, best.azimuth) > SAME_SIDE]
    rival = max(elsewhere, key=lambda one: one.score, default=best)
    return [best, rival] if rival is not best and rival.similarity >= _RIVAL * best.similarity else [best]


def more_starts(poses: Sequence[Hypothesis], chosen: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The best poses from sides other than those of the chosen ones and of each other."""
    others: list[Hypothesis] = []
    for one in by_score(poses):
        apart = min(azimuth_distance(one.azimuth, each.azimuth) for each in (*chosen, *others))
        if apart > SAME_SIDE and len(others) < _MORE_ASCENTS:
            others.append(one)
    return others


def shares_of_best(
    best: Hypothesis, refined: Sequence[Hypothesis], tilted: Sequence[Hypothesis]
) -> list[tuple[float, Hypothesis]]:
    """Poses with their part of the best one's similarity.

    Args:
        best: of the refined ones.
        refined: poses after their ascents.
        tilted: poses before; those without an ascent are compared with the best of them.
    """
    highest = max(one.similarity for one in tilted)
    shares = [(one.similarity / max(best.similarity, 1e-9), one) for one in refined if one is not best]
    started = [azimuth for one in refined for azimuth, _ in one.trace[:-1]]
    shares += [
        (one.similarity / max(highest, 1e-9), one)
        for one in tilted
        if min(azimuth_distance(one.azimuth, azimuth) for azimuth in started) > 0
    ]
    return shares


def runners_up(
    shares: Sequence[tuple[float, Hypothesis]], best: Hypothesis, same_view: Sequence[float]
) -> list[tuple[Hypothesis, float]]:
    """The poses with the highest shares from sides other than the best one's and each other's, and their shares.

    Args:
        shares: of poses, and the poses.
        best: the pose that is estimated.
        same_view: other azimuths from which its model looks the same, degrees.
    """
    azimuths = [best.azimuth, *same_view]
    chosen: list[tuple[Hypothesis, float]] = []
    for share, one in sorted(shares, key=lambda each: -each[0]):
        if min(azimuth_distance(one.azimuth, azimuth) for azimuth in azimuths) > SAME_SIDE:
            chosen.append((one, min(max(share, 0.0), 1.0)))
            azimuths.append(one.azimuth)
    return chosen[:_RUNNERS_UP]


def _weights(similarities: Tensor) -> Tensor:
    """Of poses in a vote, (N,), float64."""
    return torch.exp((similarities.double() - similarities.max()) / _AGREED)
