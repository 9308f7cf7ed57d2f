"""A mask of the object: its box, and that nothing around it counts."""

from __future__ import annotations

import pytest
import torch

from nablahog.hog.box import Box
from nablahog.pose import estimate_pose
from nablahog.pose.mask import masked

from .common import degrees_between, model, photographed


def test_what_is_around_does_not_count() -> None:
    clean, box = photographed(model(), 325, 12)
    mask = clean[0] < 0.999
    poses = []
    for behind in ("coffee", "cat"):
        image, _ = photographed(model(), 325, 12, behind=behind)
        inside, own = masked(torch.where(mask, clean, image), mask)
        assert max(abs(one - other) for one, other in zip(own, box, strict=True)) <= 1
        assert torch.equal(inside[:, mask], clean[:, mask])
        assert len(inside[:, ~mask].unique()) == 1
        estimate = estimate_pose(image, model(), mask=mask.numpy())
        assert degrees_between(estimate.azimuth, 325) < 2
        poses.append(estimate.pose)
    assert float((poses[0] - poses[1]).abs().max()) < 1.5


def test_a_box_may_be_given_too() -> None:
    _, box = masked(torch.rand(1, 20, 30), torch.ones(20, 30, dtype=torch.bool), (1, 2, 25, 18))
    assert box == Box(1, 2, 25, 18)


@pytest.mark.parametrize(
    ("mask", "message"),
    [
        (torch.zeros(150, 180, dtype=torch.bool), "must be true where the object is, but it is nowhere"),
        (torch.ones(150, 180), r"must be bool of the photograph's shape \(150, 180\), got float32"),
        (torch.ones(180, 150, dtype=torch.bool), r"got bool of shape \(180, 150\)"),
    ],
)
def test_refuses(mask: torch.Tensor, message: str) -> None:
    image, _ = photographed(model(), 40, 15)
    with pytest.raises(ValueError, match=message):
        estimate_pose(image, model(), mask=mask)
