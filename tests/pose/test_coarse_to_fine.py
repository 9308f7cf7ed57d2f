"""Which views are refined: votes of several models, and rivals from another side."""

from __future__ import annotations

import torch

from nablahog.pose.coarse_to_fine import _elected, _Hypothesis, _with_rival


def tilted(*views: tuple[str, float, float]) -> list[_Hypothesis]:
    poses = torch.tensor([[azimuth, 0, 5, 0, 0, 0] for _, azimuth, _ in views]).double()
    return [_Hypothesis(value, model, pose) for (model, _, value), pose in zip(views, poses, strict=True)]


def test_models_that_agree_beat_one_that_fits_alone() -> None:
    views = tilted(("alone", 200, 5.2), ("one", 356, 5.0), ("two", 2, 4.9), ("three", 3, 4.8), ("four", 90, 3.0))
    assert [one.model for one in _elected(views)] == ["one", "two"]


def test_one_that_fits_far_better_needs_no_others() -> None:
    views = tilted(("alone", 200, 9.0), ("one", 356, 5.0), ("two", 2, 4.9), ("three", 3, 4.8))
    assert [one.model for one in _elected(views)] == ["alone"]


def test_the_model_that_fits_best_where_they_agree_is_asked_about_elsewhere() -> None:
    views = tilted(("one", 0, 5.0), ("two", 2, 4.9), ("one", 180, 4.4), ("three", 185, 4.6))
    assert [(one.model, float(one.pose[0])) for one in _elected(views)] == [("one", 0), ("two", 2), ("one", 180)]


def test_the_rival_looks_from_elsewhere_and_is_nearly_as_good() -> None:
    views = tilted(("front", 0, 5.0), ("front", 10, 4.9), ("side", 90, 4.3), ("back", 180, 4.5))
    assert [float(one.pose[0]) for one in _with_rival(views)] == [0, 180]
    views = tilted(("front", 0, 5.0), ("front", 350, 4.9), ("back", 180, 3.9))
    assert [float(one.pose[0]) for one in _with_rival(views)] == [0]
