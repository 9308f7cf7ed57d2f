"""What speaks for the best pose that a search has found, and for its runners-up."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import torch
from torch import Tensor

from .confidence import Evidence
from .model import DETAIL, VIEW_COUNT, PreparedModel, equidistant_azimuths, view_descriptors
from .photograph import PreparedPhotograph
from .problem import PoseProblem, allowed_azimuths
from .similarity import downsample_poses
from .symmetry import SAME_SIDE
from .viewpoint_prior import ViewpointPrior
from .vote import Hypothesis, azimuth_evidence

_RANGE_RIGHT = 0.8  # probability that a range of azimuths that was given has the true one, before any evidence
_KNOWN_EXPONENT = 2.0  # of the probabilities by views of the object's own model, which tell more than those of others


def gather_evidence(
    problem: PoseProblem,
    best: Hypothesis,
    agreement: float,
    shares: Sequence[float],
    prior: ViewpointPrior | None,
) -> Evidence:
    """The evidence for the best pose, and for runners-up of these shares.

    ``agreement`` is as :class:`.confidence.Evidence` has it; ``prior`` must know the class.
    """
    models = list(problem.models.values())
    return Evidence(
        known_model=len(models) == 1,
        similarity=best.similarity,
        penalty=float(problem.penalty(best.pose[None], best.photograph)),
        sidelobe=_find_sidelobe(problem, best),
        agreement=agreement,
        shares=tuple(shares),
        in_range=_estimate_in_range(problem, prior),
        upright=compare_turned(models, best.place, problem.level_penalties) if len(models) > 1 else 0.0,
    )


def probability_in_range(log_probabilities: Tensor, near: Tensor) -> float:
    """The probability that the azimuth is among those near the range searched, by evidence from all around.

    Args:
        log_probabilities: of the azimuths 0°, 7.5°, …, (48,), up to a constant.
        near: which of them are near the range, (48,), bool.
    """
    if near.all():
        return 1.0
    inside, outside = (log_probabilities[part].logsumexp(0) - math.log(int(part.sum())) for part in (near, ~near))
    return float(torch.sigmoid(inside - outside + math.log(_RANGE_RIGHT / (1 - _RANGE_RIGHT))))


def compare_turned(
    models: Sequence[PreparedModel], photograph: PreparedPhotograph, penalties: Mapping[float, float]
) -> float:
    """How much more similar the median model's best view is to a crop than to the crop turned by 90, 180 or 270°.

    A pattern is as much like a model when it is turned, an object that stands is not.  ``penalties`` of the similarity
    are by elevation of the views, degrees.
    """
    own = photograph.own_background
    turned = [PreparedPhotograph(photograph.crop.turn_quarters(count), own) for count in (1, 2, 3)]
    weights = torch.stack([crop.calibrated.weights.flatten() for crop in (photograph, *turned)], 1)
    best = torch.full((len(models), weights.shape[1]), -torch.inf)
    for row, model in zip(best, models, strict=True):
        for elevation, penalty in penalties.items():
            similarities = view_descriptors(model, elevation, own).flatten(1) @ weights
            torch.maximum(row, similarities.amax(0) - penalty, out=row)
    upright, *others = best.quantile(0.5, dim=0).tolist()
    return float(upright - max(others))


def _estimate_in_range(problem: PoseProblem, prior: ViewpointPrior | None) -> float:
    """The probability that the azimuth is near those that are searched: in a narrow range poses always agree."""
    if problem.within == 180:
        return 1.0
    models = list(problem.models.values())
    (evidence,) = azimuth_evidence(models, [problem.photograph], problem.level_penalties, prior)
    exponent = _KNOWN_EXPONENT if len(models) == 1 else 1.0
    near = allowed_azimuths(equidistant_azimuths(VIEW_COUNT), problem.initial, min(problem.within + SAME_SIDE, 180))
    return probability_in_range(exponent * evidence, near)


def _find_sidelobe(problem: PoseProblem, best: Hypothesis) -> float:
    """The sidelobe of the best pose's rendering in the coarse template."""
    template, camera = best.photograph.calibrated, best.photograph.crop.camera
    renderer = problem.models[best.model].renderer(detail=DETAIL, shrink=template.shrink, camera=camera)
    pose = downsample_poses(best.pose[None], template.shrink)
    return template.sidelobe(renderer.render(pose, derivative=False).image[:, None])
