"""From which side photographs show an object, before any pose is tried closely: views of all models, and a network.

A single model that is not the object's own may fit any side.  All models together are more often right, and so is a
network that has learned what objects of the class look like from each side.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache

import torch
from torch import Tensor

from .background import coarse_background
from .fit_box import VIEW_COUNT, equidistant_azimuths, signed_angles
from .model import PreparedModel, view_descriptors
from .photograph import PreparedPhotograph
from .similarity import describe
from .viewpoint_prior import ViewpointPrior

_SHARPNESS = 0.5  # of the soft maximum, in units of similarity
_NETWORK = 0.3  # exponent of the network's probabilities, which are too sure of themselves
_ASKED = 4  # every fourth view of a model is shown to the network, to see whether it knows the class
_ELEVATION = 15.0  # degrees, of these views
_KNOWN = 0.6  # share of these views whose azimuth it must have within :data:`_NEAR` degrees
_NEAR = 15.0


def azimuth_evidence(
    models: Sequence[PreparedModel],
    photographs: Sequence[PreparedPhotograph],
    penalties: Mapping[float, float],
    prior: ViewpointPrior | None,
) -> Tensor:
    """Logarithms of the probabilities of the azimuths 0°, 7.5°, … in each of several crops, (P, 48), float64.

    Args:
        models: whose views are compared.
        photographs: the crops.
        penalties: of similarity, by the elevations of the views, degrees.
        prior: counts if it knows the class of the models.
    """
    evidence, (_, shrink) = _of_views(models, photographs, penalties), coarse_background()
    if prior is not None and knows(prior, models):
        crops = torch.cat([photograph.crop.downsampled(shrink).image for photograph in photographs])
        evidence += _NETWORK * prior.log_probabilities(describe(crops, prior.spec)).double()
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
    return sum(_right_share(prior, model) for model in models) >= _KNOWN * len(models)


@lru_cache(maxsize=2048)
def _right_share(prior: ViewpointPrior, model: PreparedModel) -> float:
    """Share of the views of a model whose azimuth the prior tells."""
    likely = prior.log_probabilities(view_descriptors(model, _ELEVATION)[::_ASKED]).argmax(1)
    apart = signed_angles(likely * (360 / VIEW_COUNT) - equidistant_azimuths(VIEW_COUNT)[::_ASKED])
    return float((apart.abs() <= _NEAR).double().mean())


def _of_views(
    models: Sequence[PreparedModel], photographs: Sequence[PreparedPhotograph], penalties: Mapping[float, float]
) -> Tensor:
    """A soft maximum of the similarities of all models' views at each azimuth, up to a constant, (P, 48)."""
    weights = torch.stack([photograph.calibrated.weights.flatten() for photograph in photographs], 1)
    sums = torch.zeros(len(photographs), VIEW_COUNT, dtype=torch.float64)
    for elevation, penalty in penalties.items():
        for model in models:
            views = view_descriptors(model, elevation, photographs[0].own_background).flatten(1)
            sums += (((views @ weights).double().T - penalty) / _SHARPNESS).exp()
    return _SHARPNESS * sums.log()
