"""How likely a pose is right, and which others there are."""

from __future__ import annotations

import torch

from nablahog.pose import estimate_pose
from nablahog.pose.confidence import Evidence, confidence

from .common import SWIVEL, WOODEN, degrees_between, model, photographed


def test_similarity_and_agreement_speak_for_a_pose_and_a_rival_against_it() -> None:
    for known_model in (True, False):
        base = confidence(Evidence(6.0, 0.5, 0.5), known_model=known_model)
        assert 0 < base < 1
        assert confidence(Evidence(9.0, 0.5, 0.5), known_model=known_model) > base
    of_one, of_several = (confidence(Evidence(6.0, 0.5, 0.5), known_model=known) for known in (True, False))
    assert confidence(Evidence(6.0, 0.9, 1.0), known_model=True) < of_one
    assert confidence(Evidence(6.0, 0.5, 0.9), known_model=False) > of_several
    assert confidence(Evidence(-3.0, 0.0, 1.0), known_model=True) < 0.5


def test_an_object_that_is_there_is_surer_than_one_that_is_not() -> None:
    image, box = photographed(model(), 40, 15, behind="coffee")
    there = estimate_pose(image, model(), box=box)
    nothing = estimate_pose(torch.rand(1, 150, 180, generator=torch.Generator().manual_seed(0)), model(), box=box)
    assert there.confidence is not None
    assert nothing.confidence is not None
    assert there.confidence > 0.9
    assert nothing.confidence < 0.3


def test_runners_up_are_other_sides_the_best_first() -> None:
    image, box = photographed(model(), 40, 15, behind="coffee")
    estimate = estimate_pose(image, {"wooden": model(WOODEN), "swivel": model(SWIVEL)}, box=box)
    assert estimate.runners_up
    shares = [one.share for one in estimate.runners_up]
    assert shares == sorted(shares, reverse=True)
    assert all(0 <= share <= 1 for share in shares)
    sides = [estimate.azimuth, *(float(one.pose[0]) for one in estimate.runners_up)]
    assert min(degrees_between(one, other) for k, one in enumerate(sides) for other in sides[:k]) > 15


def test_other_similarities_and_methods_have_no_confidence() -> None:
    image, box = photographed(model(), 40, 15)
    assert estimate_pose(image, model(), box=box, initial=(0, 15), similarity="whitened").confidence is None
    assert estimate_pose(image, model(), box=box, initial=(0, 15), method="exhaustive").confidence is None
