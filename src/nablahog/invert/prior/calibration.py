"""Fitting the numbers that make probabilities of a prior's log-odds, on photographs that it was not trained on."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from itertools import cycle
from pathlib import PurePosixPath
from typing import NamedTuple

import torch
from torch import Tensor

from ...hog.descriptor import hog
from ...hog.spec import HOGSpec
from ..arguments import Search
from ..preimage import reconstruct
from .confidence import Calibration, smooth_regions
from .learned import LearnedPrior
from .training_windows import OPENCV, PAPER, SKIMAGE, resize_whole

LEAST_PHOTOGRAPHS = 8  # fewer calibrate nothing
EVALUATIONS = 24  # of a search: more change details, not signs
FACTORS = torch.linspace(0, 1.5, 151, dtype=torch.float64)  # of the log-odds
SHARES = torch.linspace(0, 0.98, 50, dtype=torch.float64)  # of photographs that the prior knows something of
NEWTON_STEPS = 12
RIDGE = 0.01  # of the squared numbers, so that a few photographs without errors do not make them infinite
DIALECTS = (SKIMAGE, PAPER, OPENCV)


class Observations(NamedTuple):
    """Pre-images of n photographs beside these, with m regions in all, in float64.

    Attributes:
        log_odds: (n,), that they are not negatives.
        right: (n,), 1 if they are none, so that their correlation with the photograph is positive, else 0.
        weights: (n,), of the photographs.
        agreement: (m,), of the prediction with the regions, see :func:`.confidence.compare_regions`.
        regions_right: (m,), 1 where a region, in the pre-image or its negative, whichever is right, has the
            photograph's sign, else 0.
        region_weights: (m,), those of the photographs, shared by their regions.
    """

    log_odds: Tensor
    right: Tensor
    weights: Tensor
    agreement: Tensor
    regions_right: Tensor
    region_weights: Tensor


def calibrate(prior: LearnedPrior, photographs: Mapping[str, Tensor]) -> LearnedPrior:
    """``prior``, with the confidence in its signs fitted to pre-images of photographs (H, W) that it has never seen.

    Each folder of n photographs weighs as √n of them, so that large ones do not decide alone.  Too few photographs
    change nothing.
    """
    if len(photographs) < LEAST_PHOTOGRAPHS:
        return prior
    numbers = fit(observe(prior, photographs))
    learning = replace(prior.learning, calibration=tuple(numbers), calibrated_on=tuple(photographs))
    return replace(prior, learning=learning)


@torch.no_grad()
def observe(prior: LearnedPrior, photographs: Mapping[str, Tensor]) -> Observations:
    """The pre-images of photographs (H, W), of one dialect after the other in turn, by ``prior``."""
    folders = [PurePosixPath(name).parent for name in photographs]
    in_folder = Counter(folders)
    columns = [
        _observe_photograph(prior, resize_whole(photograph), spec, in_folder[folder] ** -0.5)
        for photograph, folder, spec in zip(photographs.values(), folders, cycle(DIALECTS), strict=False)
    ]
    return Observations(*(torch.cat(parts) for parts in zip(*columns, strict=True)))


def _observe_photograph(prior: LearnedPrior, photograph: Tensor, spec: HOGSpec, weight: float) -> Observations:
    """That of one photograph (1, 1, H, W)."""
    size = (photograph.shape[2], photograph.shape[3])
    descriptor = hog(photograph, spec)
    image = reconstruct(descriptor, spec, size, prior=prior, search=Search(max_evaluations=EVALUATIONS)).image
    evidence = prior.gather_evidence(image, descriptor, spec)
    assert evidence is not None
    brightness, true_brightness = smooth_regions(image), smooth_regions(photograph)
    is_right = (image * (photograph - photograph.mean())).sum() > 0
    regions_right = (((brightness > 0) == (true_brightness > 0)) == is_right).flatten()
    return Observations(
        evidence.log_odds.double(),
        is_right.reshape(1).double(),
        torch.full((1,), weight, dtype=torch.float64),
        evidence.agreement.flatten().double(),
        regions_right.double(),
        torch.full(regions_right.shape, weight / len(regions_right), dtype=torch.float64),
    )


def fit(observed: Observations) -> Calibration:
    """The numbers that make the observations likeliest, weighted."""
    factor, share = fit_polarity(observed)
    return Calibration(factor, share, *fit_regions(observed))


def fit_polarity(observed: Observations) -> tuple[float, float]:
    """Factor and share, on a grid."""
    chances = torch.sigmoid(observed.log_odds[:, None] * FACTORS) - 0.5
    likely = 0.5 + chances[:, :, None] * SHARES  # (n, factors, shares)
    right = observed.right[:, None, None]
    likelihood = torch.log(torch.where(right > 0, likely, 1 - likely))
    best = int(torch.einsum("n,nfs->fs", observed.weights, likelihood).argmax())
    return float(FACTORS[best // len(SHARES)]), float(SHARES[best % len(SHARES)])


def fit_regions(observed: Observations) -> list[float]:
    """The constant and the weight of the agreement, by Newton's method."""
    features = torch.stack([torch.ones_like(observed.agreement), observed.agreement], dim=1)
    weights, ridge = observed.region_weights, RIDGE * torch.eye(2, dtype=torch.float64)
    solution = features.new_zeros(2)
    for _ in range(NEWTON_STEPS):
        chances = torch.sigmoid(features @ solution)
        gradient = features.T @ (weights * (observed.regions_right - chances)) - ridge @ solution
        curvature = (features * (weights * chances * (1 - chances))[:, None]).T @ features + ridge
        solution = solution + torch.linalg.solve(curvature, gradient)
    return solution.tolist()
