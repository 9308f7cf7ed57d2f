"""How likely the azimuth is right: a logistic regression on what the search has seen.

The similarity alone says how well a model fits; that another side of the object fits as well, or that other models
agree, says more.
"""

from __future__ import annotations

import math
from typing import NamedTuple

RIGHT = 15.0  # degrees of azimuth within which a pose counts as right


class Weights(NamedTuple):
    """The constant of the logistic regression, and its weights of log(1 + similarity), rival and agreement."""

    constant: float
    similarity: float
    rival: float
    agreement: float


KNOWN = Weights(-8.76, 5.88, -3.31, 0.0)  # of a single model
UNKNOWN = Weights(-5.86, 1.28, 0.84, 6.08)  # of several, none of which need be the object's own


def confidence(similarity: float, rival: float, agreement: float, *, known_model: bool) -> float:
    """The probability that the azimuth is within :data:`RIGHT` degrees, or one from which the model looks the same.

    Fitted to scenes of chairs with boxes of all kinds and to photographs without any, by ``benchmarks/confidence.py``
    of revision 6cd399d; ``benchmarks/calibration.py`` says how well it holds.

    Args:
        similarity: calibrated, of the best pose.
        rival: share of the best runner-up, see :class:`.pose_estimate.PoseEstimate`; 0 if there is none.
        agreement: share of the votes of several models' poses that are for the same side; 1 for a single model.
        known_model: whether there is a single model.
    """
    weights = KNOWN if known_model else UNKNOWN
    logit = (
        weights.constant
        + weights.similarity * math.log1p(max(similarity, 0.0))
        + weights.rival * rival
        + weights.agreement * agreement
    )
    return 1 / (1 + math.exp(-logit))
