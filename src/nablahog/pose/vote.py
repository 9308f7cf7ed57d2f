"""The poses that a search has found: their rivals, the votes of several models for a side, and the confidence.

One wrong model may fit any side; many models fit the right one.  Views of all models, before any pose is tried
closely, are evidence for a side, too, and so is a network that has learned what objects of the class look like from
each side.  The confidence is a logistic regression on all this: the similarity says how well a model fits; whether
another side of the object fits as well, and whether other models agree, says more.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import torch
from torch import Tensor

from .crop import FILL
from .model import (
    DETAIL,
    VIEW_COUNT,
    PreparedModel,
    azimuth_distance,
    equidistant_azimuths,
    fit_to_box,
    level_poses,
    signed_angles,
    view_descriptors,
)
from .options import SearchTrace
from .photograph import PreparedPhotograph
from .similarity import white_background
from .viewpoint_prior import ViewpointPrior

SAME_SIDE = 15.0  # degrees: poses whose azimuths are closer look at the object from the same side
_COARSE = 0.7  # weight in a vote of the coarse similarity, which tells sides apart; the fine one tells models apart
_AGREED = 0.8  # difference in similarity that reduces a pose's weight to 1/e
_BLUR = 12.0  # degrees
_RIVAL = 0.8  # of the best view's similarity, after tilting
_MORE_ASCENTS = 2  # if those from the best pose and its rival end at a low similarity
# the constant of the logistic regression, and its weights of log(1 + similarity), rival and agreement
KNOWN = -14.35, 7.34, -0.88, 0.0  # of a single model
UNKNOWN = -5.86, 1.28, 0.84, 6.08  # of several, none of which need be the object's own
_TOLD_APART = 0.4  # lead in similarity over another side that makes a single model's pose e times as likely
_RUNNERS_UP = 3  # poses from other sides that are kept
_SHARPNESS = 0.5  # of the soft maximum, in units of similarity
_NETWORK = 0.6  # exponent of the network's probabilities, beside those of the views
_ASKED = 8  # so many models, or up to twice as many, are shown to the network, to see whether it knows the class
_VIEWS = 12  # of each of them
_ELEVATION = 15.0  # degrees, of these views
_KNOWN = 0.6  # share of these views whose azimuth it must have within :data:`SAME_SIDE` degrees


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A pose of a model with its similarity."""

    similarity: float  # the last one that was computed: of large cells until the ascent, of small ones after it
    model: str  # its name
    pose: Tensor  # (6,) for the crop
    photograph: PreparedPhotograph  # the crop around the object's box, or around a better one
    place: PreparedPhotograph  # the crop around the box that was given, or that the object may be in
    trace: tuple[tuple[float, float], ...] = ()  # azimuth and coarse similarity of the poses so far
    penalty: float = 0.0  # subtracted from the similarity in comparisons, see :meth:`.problem.PoseProblem.penalty`

    def moved(self, pose: Tensor, similarity: float, coarse: float, penalty: float = 0.0) -> Hypothesis:
        """The hypothesis at another pose, with its similarity and that of the coarse template."""
        trace = (*self.trace, (float(pose[0]), coarse))
        return replace(self, pose=pose, similarity=similarity, trace=trace, penalty=penalty)

    @property
    def score(self) -> float:
        """The score that hypotheses are ranked by."""
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
        """The trace of the poses so far."""
        azimuths, similarities = zip(*self.trace, strict=True)
        return SearchTrace(self.model, azimuths, similarities)


def vote(poses: Sequence[Hypothesis], count: int, evidence: Tensor) -> list[tuple[list[Hypothesis], float]]:
    """The sides of the object with most votes: the poses on each, the best first, and their share of all votes.

    Args:
        poses: of several models, at maxima of the fine similarity.
        count: the most sides to return.
        evidence: logarithms of the probabilities of the poses' azimuths for any model, (N,).
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


def midway_azimuth(azimuth: Tensor, log_probabilities: Tensor) -> Tensor:
    """Midway between an azimuth and the mean of the likely ones on its side, degrees.

    The search and the network are each off by some degrees, for reasons of their own.

    Args:
        azimuth: of the search, a scalar.
        log_probabilities: those of the network for 0°, 7.5°, …, (48,).
    """
    apart = signed_angles(equidistant_azimuths(VIEW_COUNT) - azimuth)
    near = apart.abs() <= SAME_SIDE
    return azimuth + log_probabilities[near].double().softmax(0) @ apart[near] / 2


def by_score(poses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """``poses``, the best first."""
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
    """Poses with their similarity divided by the best refined pose's; by the best tilted pose's without an ascent."""
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

    ``same_view``: azimuths, degrees, from which the best one's model looks the same.
    """
    azimuths = [best.azimuth, *same_view]
    chosen: list[tuple[Hypothesis, float]] = []
    for share, one in sorted(shares, key=lambda each: -each[0]):
        if min(azimuth_distance(one.azimuth, azimuth) for azimuth in azimuths) > SAME_SIDE:
            chosen.append((one, min(max(share, 0.0), 1.0)))
            azimuths.append(one.azimuth)
    return chosen[:_RUNNERS_UP]


def _weights(similarities: Tensor) -> Tensor:
    """Weights of poses in a vote, (N,), float64."""
    return torch.exp((similarities.double() - similarities.max()) / _AGREED)


def azimuth_evidence(
    models: Sequence[PreparedModel],
    photographs: Sequence[PreparedPhotograph],
    penalties: Mapping[float, float],
    prior: ViewpointPrior | None,
) -> Tensor:
    """Logarithms of the probabilities of the azimuths 0°, 7.5°, … in each of several crops, (P, 48), float64.

    ``penalties`` of the similarity are by elevation of the views, degrees; ``prior`` must know the class.
    """
    weights = torch.stack([photograph.calibrated.weights.flatten() for photograph in photographs], 1)
    sums = torch.zeros(len(photographs), VIEW_COUNT, dtype=torch.float64)
    for elevation, penalty in penalties.items():
        for model in models:
            views = view_descriptors(model, elevation, photographs[0].own_background).flatten(1)
            sums += (((views @ weights).double().T - penalty) / _SHARPNESS).exp()
    evidence = _SHARPNESS * sums.log()  # a soft maximum over models
    if prior is not None:
        crops = torch.cat([photograph.crop.image for photograph in photographs])
        evidence += _NETWORK * prior.log_probabilities(crops).double()
    return evidence.log_softmax(1)


def at_azimuths(evidence: Tensor, azimuths: Tensor) -> Tensor:
    """Evidence (N, 48), interpolated at one azimuth each (N,), degrees: (N,)."""
    place = azimuths % 360 * (VIEW_COUNT / 360)
    low = place.long() % VIEW_COUNT
    share = place - place.floor()
    ends = torch.stack([low, (low + 1) % VIEW_COUNT], 1)
    before, after = evidence.gather(1, ends).unbind(1)
    return (1 - share) * before + share * after


def knows(prior: ViewpointPrior, models: Sequence[PreparedModel]) -> bool:
    """Whether the prior recognises the azimuths of views of the models: their class, and which side is the front."""
    asked = models[:: max(len(models) // _ASKED, 1)]
    return sum(_right_share(prior, model) for model in asked) >= _KNOWN * len(asked)


@lru_cache(maxsize=2048)
def _right_share(prior: ViewpointPrior, model: PreparedModel) -> float:
    """Share of the views of a model whose azimuth the prior tells."""
    azimuths = equidistant_azimuths(_VIEWS)
    poses = fit_to_box(level_poses(azimuths, _ELEVATION), model.hull, model.camera, FILL)
    background = white_background(model.camera)
    views = model.renderer(detail=DETAIL).render(poses, background, derivative=False).image[:, None]
    likely = prior.log_probabilities(views).argmax(1) * (360 / VIEW_COUNT)
    return float((signed_angles(likely - azimuths).abs() <= SAME_SIDE).double().mean())


def confidence(similarity: float, rival: float, lead: float, agreement: float, *, known_model: bool) -> float:
    """The probability that the rotation is within 15°, or one from which the model looks the same.

    Fitted to scenes with boxes of all kinds and to photographs without the object: of a single model, of chairs and of
    the objects of ``benchmarks/shapes.py``; of several, of chairs.  ``benchmarks/calibration.py`` measures it.
    A single model that fits another side as well is as likely to be seen from there, however well it fits.

    Args:
        similarity: calibrated, of the best pose.
        rival: share of the best runner-up; 0 if there is none.
        lead: similarity of the best pose less that of the most similar runner-up; infinite if there is none.
        agreement: share of the votes of several models' poses that are for the same side; 1 for a single model.
        known_model: whether there is a single model.
    """
    constant, of_similarity, of_rival, of_agreement = KNOWN if known_model else UNKNOWN
    logit = constant + of_similarity * math.log1p(max(similarity, 0.0)) + of_rival * rival + of_agreement * agreement
    fits = 1 / (1 + math.exp(-logit))
    return min(fits, 1 / (1 + math.exp(-lead / _TOLD_APART))) if known_model else fits
