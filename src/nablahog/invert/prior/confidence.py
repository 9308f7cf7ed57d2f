"""How sure a prior for unsigned descriptors is of the bright side: of a whole image, and of its regions.

The log-odds of a network are right for photographs like the ones that it was trained on.  Of other kinds it knows less.
So its log-odds are shrunk, and its probabilities end where it proved to be right on collections of photographs that it
had not seen (:mod:`.calibration`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import interpolate

from ...inputs.numbers import is_finite
from ..unknowns import low_pass
from .unsigned_network import align_sign, normalise

REGION_PIXELS = 8.0  # standard deviation of the Gaussian of a region
REGION_STEP = 4  # pixels between the places where regions are compared, along each axis


class Confidence(NamedTuple):
    """Probabilities (B,) that images are not negatives, and (B, 1, H, W) that their regions have the right sign."""

    polarity: Tensor
    regions: Tensor


class SignEvidence(NamedTuple):
    """What speaks for the signs of images and of their regions.

    Attributes:
        log_odds: (B,), of the network, that the image is not a negative.
        agreement: (B, 1, h, w), of regions, see :func:`compare_regions`.
    """

    log_odds: Tensor
    agreement: Tensor


class Calibration(NamedTuple):
    """The numbers that make probabilities of a network's log-odds and prediction.

    Attributes:
        factor: of the log-odds of the polarity.
        share: of photographs that the network knows something of; of the others it does not know the polarity.
        constant, agreement_weight: of the log-odds that a region has the right sign if its image has.
    """

    factor: float = 1.0
    share: float = 1.0
    constant: float = 0.0
    agreement_weight: float = 1.0

    def polarity(self, log_odds: Tensor) -> Tensor:
        """The probabilities (B,) that images with these log-odds (B,) are not negatives."""
        return 0.5 + self.share * (torch.sigmoid(self.factor * log_odds) - 0.5)

    def regions(self, evidence: SignEvidence, polarity: Tensor, size: tuple[int, int]) -> Tensor:
        """The probabilities (B, 1, H, W) that regions have the right sign, for images of this size.

        ``polarity`` (B,) is the probability that the image is not a negative.
        """
        likely = torch.sigmoid(self.constant + self.agreement_weight * evidence.agreement)
        chance = polarity.reshape(-1, 1, 1, 1)
        places = chance * likely + (1 - chance) * (1 - likely)
        return interpolate(places, size=size, mode="bilinear", align_corners=False)


def check_calibration(numbers: tuple[float, ...]) -> None:
    """Raises ValueError unless these are the numbers of a :class:`Calibration`, or none."""
    if not numbers:
        return
    names = Calibration._fields
    in_range = len(numbers) == len(names) and all(map(is_finite, numbers)) and numbers[0] >= 0
    if not in_range or not 0 <= numbers[1] <= 1:
        raise ValueError(
            f"the calibration must be {len(names)} finite numbers ({', '.join(names)}), the first not below 0, the "
            f"second in 0…1, got {numbers}"
        )


def smooth_regions(images: Tensor) -> Tensor:
    """The regions (B, 1, h, w) of images (B, 1, H, W), one for 4x4 pixels: their brightness minus the image's mean.

    A Gaussian of 8 pixels smooths them; they have unit variance.
    """
    return normalise(_smooth(images, [-(-n // REGION_STEP) for n in images.shape[2:]]))


def compare_regions(brightness: Tensor, predicted: Tensor) -> Tensor:
    """How far predictions (B, 1, h', w'), up to their sign, support the signs of regions (B, 1, h, w): of their shape.

    A network that was trained for the least square error predicts the mean of what is possible, which is the nearer to
    0 the less is known of a sign.  Positive where the prediction has the region's sign.
    """
    return align_sign(_smooth(predicted, brightness.shape[2:]), brightness) * brightness.sign()


def _smooth(images: Tensor, size: Sequence[int]) -> Tensor:
    places = interpolate(images, size=size, mode="bilinear", align_corners=False, antialias=True)
    return low_pass(places, REGION_PIXELS / REGION_STEP)
