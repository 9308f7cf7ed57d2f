"""What speaks for the best pose that a search has found, and for its runners-up."""

from __future__ import annotations

from collections.abc import Sequence

from .confidence import Evidence
from .model import DETAIL
from .problem import PoseProblem
from .similarity import downsample_poses
from .vote import Hypothesis


def gather_evidence(problem: PoseProblem, best: Hypothesis, agreement: float, shares: Sequence[float]) -> Evidence:
    """The evidence for the best pose, and for runners-up of these shares.

    ``agreement`` is as :class:`.confidence.Evidence` has it.
    """
    return Evidence(
        known_model=len(problem.models) == 1,
        similarity=best.similarity,
        penalty=float(problem.penalty(best.pose[None], best.photograph)),
        sidelobe=_find_sidelobe(problem, best),
        agreement=agreement,
        shares=tuple(shares),
    )


def _find_sidelobe(problem: PoseProblem, best: Hypothesis) -> float:
    """The sidelobe of the best pose's rendering in the coarse template."""
    template, camera = best.photograph.calibrated, best.photograph.crop.camera
    renderer = problem.models[best.model].renderer(detail=DETAIL, shrink=template.shrink, camera=camera)
    pose = downsample_poses(best.pose[None], template.shrink)
    return template.sidelobe(renderer.render(pose, derivative=False).image[:, None])
