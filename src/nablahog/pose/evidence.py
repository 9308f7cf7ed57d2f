"""What speaks for the best pose that a search has found, and for its runners-up."""

from __future__ import annotations

import math
from collections.abc import Sequence

from .confidence import Evidence
from .model import DETAIL, VIEW_COUNT
from .problem import PoseProblem
from .similarity import downsample_poses
from .viewpoint_prior import ViewpointPrior
from .vote import Hypothesis, interpolate_evidence


def gather_evidence(
    problem: PoseProblem, best: Hypothesis, agreement: float, shares: Sequence[float], prior: ViewpointPrior | None
) -> Evidence:
    """The evidence for the best pose, and for runners-up of these shares.

    ``agreement`` is as :class:`.confidence.Evidence` has it; ``prior`` must know the class of the models.
    """
    return Evidence(
        known_model=len(problem.models) == 1,
        similarity=best.similarity,
        penalty=float(problem.penalty(best.pose[None], best.photograph)),
        sidelobe=_find_sidelobe(problem, best),
        agreement=agreement,
        viewpoint=None if prior is None else _weigh_viewpoint(best, prior),
        shares=tuple(shares),
    )


def _find_sidelobe(problem: PoseProblem, best: Hypothesis) -> float:
    """The sidelobe of the best pose's rendering in the coarse template."""
    template, camera = best.photograph.calibrated, best.photograph.crop.camera
    renderer = problem.models[best.model].renderer(detail=DETAIL, shrink=template.shrink, camera=camera)
    pose = downsample_poses(best.pose[None], template.shrink)
    return template.sidelobe(renderer.render(pose, derivative=False).image[:, None])


def _weigh_viewpoint(best: Hypothesis, prior: ViewpointPrior) -> float:
    """How much likelier the best pose's azimuth is than any other by the prior, a logarithm."""
    log_probabilities = prior.log_probabilities(best.place.crop.image).double()
    return float(interpolate_evidence(log_probabilities, best.pose[:1])) + math.log(VIEW_COUNT)
