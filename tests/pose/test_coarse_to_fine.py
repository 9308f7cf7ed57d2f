"""Which views are refined: rivals from another side."""

from __future__ import annotations

import torch

from nablahog.pose.coarse_to_fine import _others, _runners_up, _with_rival
from nablahog.pose.crop import crop_object
from nablahog.pose.hypothesis import Hypothesis
from nablahog.pose.prepared import PreparedPhotograph


def tilted(*views: tuple[str, float, float]) -> list[Hypothesis]:
    poses = torch.tensor([[azimuth, 0, 5, 0, 0, 0] for _, azimuth, _ in views]).double()
    crop = PreparedPhotograph(crop_object(torch.zeros(1, 64, 64)))
    return [
        Hypothesis(value, model, pose, crop, crop, ((float(pose[0]), value),))
        for (model, _, value), pose in zip(views, poses, strict=True)
    ]


def test_the_rival_looks_from_elsewhere_and_is_nearly_as_good() -> None:
    views = tilted(("front", 0, 5.0), ("front", 10, 4.9), ("side", 90, 4.3), ("back", 180, 4.5))
    assert [float(one.pose[0]) for one in _with_rival(views)] == [0, 180]
    views = tilted(("front", 0, 5.0), ("front", 350, 4.9), ("back", 180, 3.9))
    assert [float(one.pose[0]) for one in _with_rival(views)] == [0]


def test_others_to_ascend_from_look_from_elsewhere() -> None:
    views = tilted(("one", 0, 3.0), ("one", 100, 2.0), ("one", 110, 1.9), ("one", 5, 2.5), ("one", 200, 1.0))
    assert [float(one.pose[0]) for one in _others(views, views[:1])] == [100, 200]


def test_runners_up_are_no_symmetric_views() -> None:
    views = tilted(("one", 0, 4.0), ("one", 90, 3.0), ("one", 180, 3.5), ("one", 270, 2.0))
    started = [one.refined(one.pose, 6.0, 5.0) for one in views[:1]]
    runners_up = _runners_up(started[0], started, views, (180.0,), views[0].photograph.crop)
    assert [(float(one.pose[0]), one.share) for one in runners_up] == [(90, 0.75), (270, 0.5)]
