"""One model of each kind, as small as can be, that has learned nothing."""

from __future__ import annotations

from typing import Any

import torch

from nablahog import LearnedPrior, presets
from nablahog.hog import HOGSpec
from nablahog.invert.prior.learned import network_class
from nablahog.invert.prior.provenance import NetworkLearning
from nablahog.invert.prior.signed_network import Architecture
from nablahog.io.learned_model import LearnedModel, count_weights
from nablahog.paper.baselines.bovw import BoVW, BoVWLearning
from nablahog.paper.baselines.exemplar_views import ExemplarViews
from nablahog.paper.baselines.hoggles import HogglesLearning, PairedDictionary
from nablahog.pose.whitening import Background

SOURCE: dict[str, Any] = {"images": ("a", "b"), "sha256": "00", "seed": 3}


def prior(spec: HOGSpec | None = None) -> LearnedPrior:
    """Random weights."""
    spec = spec or presets.uoctti(8)
    architecture = Architecture((8, 8, 8), (1, 0, 0))
    scale = 0.2 if spec.signed else 0.05  # so that nothing saturates
    weights = scale * torch.randn(
        count_weights(lambda: network_class(spec)(architecture)), generator=torch.Generator().manual_seed(1)
    )
    return LearnedPrior(
        spec, architecture, weights.half(), NetworkLearning(**SOURCE, epochs=2, losses=(1.5, 0.1 + 0.2))
    )


def hoggles() -> PairedDictionary:
    """Two pairs of atoms."""
    learning = HogglesLearning(**SOURCE, windows=9, iterations=8, batch=400, objective=(1.5, 0.1 + 0.2))
    return PairedDictionary(presets.uoctti(4), torch.rand(2, 28, 28), torch.rand(2, 5, 5, 31), 0.02, learning)


def bovw() -> BoVW:
    """Three words on a grid of 1x2."""
    return BoVW(
        torch.eye(3, 128),
        torch.full((3, 16, 16), 0.5),
        torch.tensor([[[0, 1]], [[2, 1]]], dtype=torch.int16),
        (16, 20),
        4,
        BoVWLearning(**SOURCE, words=3, windows=50, rounds=20),
    )


def background() -> Background:
    """Of one offset."""
    spec = presets.aubry(5, orientations=3)
    covariance = torch.eye(3, dtype=torch.float64).expand(1, 1, 3, 3).contiguous()
    return Background(spec, torch.ones(3, dtype=torch.float64), covariance, ("a", "b"), 0.1 + 0.2)


def views() -> ExemplarViews:
    """Of two viewpoints, with one element and with two."""
    elements = torch.rand(3, 2, 2, 31).half().float(), torch.ones(3), torch.zeros(3), torch.tensor([0, 1, 2])
    places = torch.ones(3, 2, dtype=torch.int64), torch.tensor([0, 1, 3])
    return ExemplarViews(*elements, *places, torch.rand(2, 4), torch.rand(2, 2))


def models() -> dict[str, LearnedModel]:
    makers = (prior, background, hoggles, bovw, views)
    return {maker.__name__: maker() for maker in makers}
