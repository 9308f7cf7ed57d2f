"""How likely a pose is to be right, and each of its runners-up, by a multinomial logistic regression.

Either the best pose is right, or a runner-up, or none of them, as where the object is missing.  How well the rendering
fits says whether there is an object, and so do the view, since few photographs are taken from far above, and the
photograph around it: a regular pattern fits elsewhere, too.
Whether another side fits as well, and whether several models agree on a rotation, says which of the poses is right.
Many models may agree in a photograph without the object, too; but then they fit the turned photograph as well.

``benchmarks/confidence.py`` has fitted the weights to scenes with boxes of all kinds, and to photographs and textures
without the object; it measures the confidence on others.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple


@dataclass(frozen=True)
class Evidence:
    """The figures that the confidence of a pose rests on.

    Attributes:
        known_model: whether there was a single model.
        similarity: calibrated, of the best pose.
        penalty: of its view, in units of the similarity, see :meth:`.problem.PoseProblem.penalty`.
        sidelobe: the coarse similarity of its rendering elsewhere, divided by that in its place, in 0…1, see
            :meth:`.similarity.CalibratedTemplate.sidelobe`.
        agreement: of several models' poses with its rotation: 1 less the mean angle between them, weighted as in the
            vote, in units of 90°, which is the most that counts; 1 for a single model.
        shares: of the runners-up, as :attr:`.PoseEstimate.share` has them, 0…1.
        in_range: probability that the azimuth is near those that were searched, see
            :func:`.evidence.probability_in_range`; 1 for a search of all.
        upright: how much more similar the median model is to the crop than to a turned one, see
            :func:`.evidence.compare_turned`; 0 for a single model.
    """

    known_model: bool
    similarity: float
    penalty: float
    sidelobe: float
    agreement: float
    shares: tuple[float, ...]
    in_range: float = 1.0
    upright: float = 0.0


class Weights(NamedTuple):
    """Of the logarithm of the odds that the best pose is right, not none of them; and of a runner-up's to the best."""

    constant: float
    similarity: float  # of log(1 + similarity)
    penalty: float
    sidelobe: float
    agreement: float
    upright: float
    share: float  # exponent of a runner-up's share


KNOWN_MODEL = Weights(-5.48, 5.73, -3.88, -11.44, 0.0, 0.0, 25.98)  # of a single model: of chairs and other shapes
# of several models, none of which need be the object's own: of chairs; their similarities say no more than the sidelobe
UNKNOWN_MODEL = Weights(-0.01, 0.0, -2.84, -6.09, 5.57, 0.72, 1.05)
_LEAST = 1e-9  # of what a logarithm is taken of


def probabilities(evidence: Evidence, weights: Weights | None = None) -> tuple[float, ...]:
    """Probabilities that the rotation of the best pose, and of each runner-up, is within 15° of the true one.

    What is missing to 1 is the probability that none of them is, as when the azimuth is outside the range searched.
    ``weights`` are those of this module by default.
    """
    if weights is None:
        weights = KNOWN_MODEL if evidence.known_model else UNKNOWN_MODEL
    best = (
        weights.constant
        + weights.similarity * math.log1p(max(evidence.similarity, 0.0))
        + weights.penalty * evidence.penalty
        + weights.sidelobe * evidence.sidelobe
        + weights.agreement * evidence.agreement * evidence.in_range
        + weights.upright * evidence.upright
    )
    logits = [best, *(best + weights.share * math.log(max(share, _LEAST)) for share in evidence.shares)]
    highest = max(0.0, *logits)
    odds = [math.exp(logit - highest) for logit in logits]
    total = math.exp(-highest) + sum(odds)
    return tuple(evidence.in_range * each / total for each in odds)
