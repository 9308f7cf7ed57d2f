"""The poses that a search has found: their rivals, and the votes of several models for a side.

One wrong model may fit any side; many models fit the right one.  Views of all models, before any pose is tried
closely, are evidence for a side, too, and so is a network that has learned what objects of the class look like from
each side.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import torch
from torch import Tensor

from ..metrics import rotation_error
from .ascent import SearchTrace
from .covariance import pose_covariance
from .crop import CROP_FILL
from .model import (
    DETAIL,
    VIEW_COUNT,
    PreparedModel,
    azimuth_distance,
    equidistant_azimuths,
    fit_to_box,
    forget_views,
    level_poses,
    select_different,
    signed_angles,
    view_descriptors,
)
from .photograph import PreparedPhotograph
from .symmetry import SAME_SIDE, forget_sides, looks_same_all_around
from .viewpoint_prior import ViewpointPrior

_COARSE_WEIGHT = (
    0.7  # weight in a vote of the coarse similarity, which tells sides apart; the fine one tells models apart
)
_VOTE_SCALE = 0.8  # difference in similarity that reduces a pose's weight to 1/e
_VOTE_BLUR = 12.0  # degrees
_FARTHEST = 90.0  # degrees between two rotations: no farther ones disagree more
_SAME_POSE = 12.0  # degrees: of poses whose rotations are closer only the best is tried
_RUNNERS_UP = 3  # poses from other sides that are kept
_SOFT_MAXIMUM = 0.5  # of the soft maximum, in units of similarity
_NETWORK_EXPONENT = 0.6  # exponent of the network's probabilities, beside those of the views
_KNOWN_MODELS = 8  # so many models, or up to twice as many, are shown to the network, to see whether it knows the class
_KNOWN_VIEWS = 12  # of each of them
_KNOWN_ELEVATION = 15.0  # degrees, of these views
_KNOWN_SHARE = 0.6  # share of these views whose azimuth it must have within :data:`SAME_SIDE` degrees


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
    hessian: Tensor | None = None  # (6, 6): of the similarity at the end of the last ascent; None before

    def move(
        self, pose: Tensor, similarity: float, coarse: float, penalty: float = 0.0, hessian: Tensor | None = None
    ) -> Hypothesis:
        """The hypothesis at another pose, with its similarity and that of the coarse template."""
        trace = (*self.trace, (float(pose[0]), coarse))
        return replace(self, pose=pose, similarity=similarity, trace=trace, penalty=penalty, hessian=hessian)

    def covariance(self, size: Sequence[int], same_view: Sequence[float]) -> Tensor | None:
        """The covariance (6, 6) of the pose in a photograph of a height and width; None before the ascent.

        ``same_view`` has further azimuths from which the model looks the same, degrees.
        """
        if self.hessian is None:
            return None
        crop, any_azimuth = self.photograph.crop, looks_same_all_around(same_view)
        return pose_covariance(self.similarity, self.hessian, self.pose, crop, size, any_azimuth=any_azimuth)

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
    azimuths = torch.tensor([hypothesis.azimuth for hypothesis in poses], dtype=torch.float64)
    weights = _vote_weights(poses, evidence)
    apart = signed_angles(azimuths[:, None] - azimuths)
    votes, total = torch.exp(-0.5 * (apart / _VOTE_BLUR) ** 2) @ weights, float(weights.sum())
    sides: list[tuple[list[Hypothesis], float]] = []
    while len(sides) < count and votes.isfinite().any():
        near = signed_angles(azimuths - azimuths[votes.argmax()]).abs() <= SAME_SIDE
        voters = near & votes.isfinite()
        on_side = [poses[k] for k in voters.nonzero()[:, 0].tolist()]
        sides.append((sort_by_score(on_side), float(weights[voters].sum()) / total))
        votes[near] = -torch.inf
    return sides


def measure_agreement(best: Hypothesis, poses: Sequence[Hypothesis], evidence: Tensor) -> float:
    """How much the rotations of the poses that :func:`vote` had agree with the best one's, in 0…1.

    1 less their mean angle to it in units of 90°, which is the most that counts.
    """
    viewpoints = torch.stack([hypothesis.pose[[0, 1, 3]] for hypothesis in poses])
    angles = torch.from_numpy(rotation_error(viewpoints.numpy(), best.pose[[0, 1, 3]].numpy()))
    weights = _vote_weights(poses, evidence)
    return 1 - float(weights @ angles.clamp(max=_FARTHEST) / weights.sum()) / _FARTHEST


def mean_viewpoint(poses: Sequence[Hypothesis]) -> Tensor:
    """Mean azimuth, elevation and in-plane rotation, (3,), degrees, of poses on one side.

    Models that are not the object's own are each off by some degrees, in all directions.
    """
    weights = _weights(torch.tensor([hypothesis.score for hypothesis in poses], dtype=torch.float32))
    angles = torch.stack([hypothesis.pose[[0, 1, 3]] for hypothesis in poses])
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


def sort_by_score(poses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """``poses``, the best first."""
    return sorted(poses, key=lambda hypothesis: -hypothesis.score)


def select_promising(poses: Sequence[Hypothesis], count: int, share: float = 0.0) -> list[Hypothesis]:
    """At most ``count`` poses of different rotations, the best first, that have this share of the best one's score."""
    ranked = sort_by_score(poses)
    least = ranked[0].score - (1 - share) * abs(ranked[0].score)
    good = [hypothesis for hypothesis in ranked if hypothesis.score >= least]
    different = select_different(torch.stack([hypothesis.pose for hypothesis in good]), _SAME_POSE, count)
    return [good[k] for k in different]


def select_other_sides(
    poses: Iterable[Hypothesis],
    views: Sequence[Tensor],
    count: int,
    score: Callable[[Hypothesis], float] = lambda hypothesis: hypothesis.score,
) -> list[Hypothesis]:
    """At most ``count`` poses of the highest scores from sides other than those of ``views`` and of each other.

    ``views`` are azimuths, elevations and in-plane rotations, (3,) each.  Near a pole azimuths may differ where
    rotations do not, so both must.
    """
    taken, chosen = list(views), []
    for hypothesis in sorted(poses, key=score, reverse=True):
        view = hypothesis.pose[[0, 1, 3]]
        turns = min(azimuth_distance(float(view[0]), float(other[0])) for other in taken)
        rotations = rotation_error(torch.stack(taken).numpy(), view.numpy())
        if min(turns, rotations.min()) > SAME_SIDE:
            chosen.append(hypothesis)
            taken.append(view)
    return chosen[:count]


def compare_shares(
    best: Hypothesis, refined: Sequence[Hypothesis], climbed: Sequence[Hypothesis]
) -> dict[Hypothesis, float]:
    """Scores divided by the best refined pose's; without an ascent, by the best climbed one's."""
    highest = max(hypothesis.score for hypothesis in climbed)
    started = [azimuth for hypothesis in refined for azimuth, _ in hypothesis.trace[:-1]]
    rivals = [hypothesis for hypothesis in refined if hypothesis is not best]
    shares = {hypothesis: hypothesis.score / max(best.score, 1e-9) for hypothesis in rivals}
    for hypothesis in climbed:
        if min(azimuth_distance(hypothesis.azimuth, azimuth) for azimuth in started) > 0:
            shares[hypothesis] = hypothesis.score / max(highest, 1e-9)
    return shares


def select_runners_up(
    shares: Mapping[Hypothesis, float], best: Hypothesis, same_view: Sequence[float]
) -> dict[Hypothesis, float]:
    """The poses of the highest shares from sides other than the best one's and each other's; their shares.

    ``same_view`` has further azimuths from which the model looks the same, degrees.
    """
    views = best.pose[[0, 1, 3]].repeat(1 + len(same_view), 1)
    views[1:, 0] = torch.tensor(same_view)
    chosen = select_other_sides(shares, [*views], _RUNNERS_UP, shares.__getitem__)
    return {hypothesis: min(max(shares[hypothesis], 0.0), 1.0) for hypothesis in chosen}


def _vote_weights(poses: Sequence[Hypothesis], evidence: Tensor) -> Tensor:
    """Weights of poses, (N,), float64, by their similarities and the evidence for their azimuths, see :func:`vote`."""
    similarities = [
        _COARSE_WEIGHT * hypothesis.coarse + (1 - _COARSE_WEIGHT) * hypothesis.similarity - hypothesis.penalty
        for hypothesis in poses
    ]
    return _weights(torch.tensor(similarities, dtype=torch.float32).double() + _VOTE_SCALE * evidence)


def _weights(similarities: Tensor) -> Tensor:
    """Weights of poses in a vote, (N,), float64."""
    return torch.exp((similarities.double() - similarities.max()) / _VOTE_SCALE)


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
            sums += (((views @ weights).double().T - penalty) / _SOFT_MAXIMUM).exp()
    evidence = _SOFT_MAXIMUM * sums.log()  # a soft maximum over models
    if prior is not None:
        crops = torch.cat([photograph.crop.image for photograph in photographs])
        evidence += _NETWORK_EXPONENT * prior.log_probabilities(crops).double()
    return evidence.log_softmax(1)


def interpolate_evidence(evidence: Tensor, azimuths: Tensor) -> Tensor:
    """Evidence (N, 48), interpolated at one azimuth each (N,), degrees: (N,)."""
    place = azimuths % 360 * (VIEW_COUNT / 360)
    low = place.long() % VIEW_COUNT
    share = place - place.floor()
    ends = torch.stack([low, (low + 1) % VIEW_COUNT], 1)
    before, after = evidence.gather(1, ends).unbind(1)
    return (1 - share) * before + share * after


def recognizes_models(prior: ViewpointPrior, models: Sequence[PreparedModel]) -> bool:
    """Whether the prior recognises the azimuths of views of the models: their class, and which side is the front."""
    sample = models[:: max(len(models) // _KNOWN_MODELS, 1)]
    return sum(_right_share(prior, model) for model in sample) >= _KNOWN_SHARE * len(sample)


@lru_cache(maxsize=2048)
def _right_share(prior: ViewpointPrior, model: PreparedModel) -> float:
    """Share of the views of a model whose azimuth the prior tells."""
    azimuths = equidistant_azimuths(_KNOWN_VIEWS)
    poses = fit_to_box(level_poses(azimuths, _KNOWN_ELEVATION), model.hull, model.camera, CROP_FILL)
    views = model.renderer(detail=DETAIL).render(poses, derivative=False).image[:, None]
    likely = prior.log_probabilities(views).argmax(1) * (360 / VIEW_COUNT)
    return float((signed_angles(likely - azimuths).abs() <= SAME_SIDE).double().mean())


def forget_models() -> None:
    """Empties the caches of what is prepared of models; each is made again when it is needed."""
    forget_views()
    forget_sides()
    _right_share.cache_clear()
