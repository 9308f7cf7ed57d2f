"""What speaks for the best pose that a search has found, and for its runners-up."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from .confidence import Evidence
from .model import DETAIL, VIEW_COUNT, equidistant_azimuths
from .problem import PoseProblem, allowed_azimuths
from .similarity import downsample_poses
from .viewpoint_prior import ViewpointPrior
from .vote import SAME_SIDE, Hypothesis, azimuth_evidence

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
    return Evidence(
        known_model=len(problem.models) == 1,
        similarity=best.similarity,
        penalty=float(problem.penalty(best.pose[None], best.photograph)),
        sidelobe=_find_sidelobe(problem, best),
        agreement=agreement,
        shares=tuple(shares),
        in_range=_estimate_in_range(problem, prior),
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
