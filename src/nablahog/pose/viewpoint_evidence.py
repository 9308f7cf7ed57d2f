"""From which side photographs show an object, before any pose is tried closely: views of all models, and a network.

One model that is not the object's own may be similar from any side.  All of them together, and a network that has
learned what the class looks like from each side, are more often right.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Literal, TypeAlias

import torch
from torch import Tensor

from .placement import equidistant_azimuths, level_poses
from .prepared import PreparedModel, PreparedPhotograph, coarse_background, whitener_of
from .problem import PoseProblem
from .similarity import describe
from .viewpoint_network import CELLS, ViewpointPrior
from .views import VIEW_COUNT, view_descriptors

ViewpointChoice: TypeAlias = ViewpointPrior | Literal["default"] | None
FILE = Path(__file__).with_name("default_viewpoints") / "chairs.npz"
_SHARPNESS = 0.5  # of similarity: by how much views differ of which the best alone counts
_NETWORK = 0.3  # exponent of the network's probabilities, which are too sure of themselves
_ASKED = 4  # every such view of a model is shown to the network, to see whether it knows the class
_ELEVATION = 15.0  # degrees, of these views
_KNOWN = 0.6  # share of these views whose azimuth it must have within :data:`_NEAR` degrees
_NEAR = 15.0


@lru_cache(maxsize=1)
def default_viewpoints() -> ViewpointPrior:
    """The viewpoint prior that comes with the package, of chairs: see ``default_viewpoints/README.md``.

    Raises:
        FileNotFoundError: the package was installed without it.

    >>> nablahog.pose.default_viewpoints().learning.scenes
    30000
    """
    return ViewpointPrior.load(FILE)


def chosen_viewpoints(choice: ViewpointChoice) -> ViewpointPrior | None:
    """The prior of a choice; for ``"default"`` none where the package was installed without it.

    Raises:
        ValueError: it is no such choice.
    """
    if choice == "default":
        return default_viewpoints() if FILE.exists() else None
    if choice is not None and not isinstance(choice, ViewpointPrior):
        raise ValueError(f"viewpoints must be a ViewpointPrior, 'default' or None, got {choice!r}")
    return choice


def azimuth_evidence(
    problem: PoseProblem, prior: ViewpointPrior | None, photographs: Sequence[PreparedPhotograph]
) -> Tensor:
    """Logarithms of how likely the azimuths 0°, 7.5°, … are in each of several crops, (P, 48), float64."""
    evidence, (_, shrink) = _of_views(problem, photographs), coarse_background(None)
    if prior is not None and knows(prior, list(problem.models.values())):
        crops = torch.cat([photograph.crop.downsampled(shrink).image for photograph in photographs])
        evidence += _NETWORK * prior.log_probabilities(describe(crops, prior.spec)).double()
    return evidence.log_softmax(1)


def at_azimuths(evidence: Tensor, azimuths: Tensor) -> Tensor:
    """Evidence (N, 48) between its azimuths, at one azimuth each (N,), degrees: (N,)."""
    place = azimuths % 360 * (VIEW_COUNT / 360)
    low = place.long() % VIEW_COUNT
    share = place - place.floor()
    ends = torch.stack([low, (low + 1) % VIEW_COUNT], 1)
    before, after = evidence.gather(1, ends).unbind(1)
    return (1 - share) * before + share * after


def knows(prior: ViewpointPrior, models: Sequence[PreparedModel]) -> bool:
    """Whether it has learned the class that models are of, and with the same front: asked about views of them."""
    return sum(_right_share(prior, model) for model in models) >= _KNOWN * len(models)


@lru_cache(maxsize=2048)
def _right_share(prior: ViewpointPrior, model: PreparedModel) -> float:
    background, shrink = coarse_background(None)
    whitener = whitener_of(background, CELLS, CELLS)
    views = view_descriptors(model, background.spec, whitener, shrink, _ELEVATION)[::_ASKED]
    likely = prior.log_probabilities(views.reshape(len(views), -1, CELLS, CELLS)).argmax(1)
    apart = (likely * (360 / VIEW_COUNT) - equidistant_azimuths(VIEW_COUNT)[::_ASKED] + 180) % 360 - 180
    return float((apart.abs() <= _NEAR).double().mean())


def _of_views(problem: PoseProblem, photographs: Sequence[PreparedPhotograph]) -> Tensor:
    """A soft maximum of the similarities of all models' views at each azimuth, up to a constant, (P, 48)."""
    templates = [photograph.calibrated for photograph in photographs]
    first = templates[0]
    assert first.whitener is not None
    weights = torch.stack([template.weights.flatten() for template in templates], 1)
    level = level_poses(equidistant_azimuths(1), 0.0)
    sums = torch.zeros(len(templates), VIEW_COUNT, dtype=torch.float64)
    for elevation in problem.elevations:
        level[:, 1] = elevation
        unlikely = problem.unlikely(level, problem.photograph)
        for model in problem.models.values():
            views = view_descriptors(model, first.spec, first.whitener, first.shrink, elevation)
            sums += (((views @ weights).double().T - unlikely) / _SHARPNESS).exp()
    return _SHARPNESS * sums.log()
