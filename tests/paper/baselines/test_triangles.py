from __future__ import annotations

import math
from typing import Any

import pytest
import torch
from torch import Tensor

from nablahog.hog import hog, presets
from nablahog.paper.baselines.triangles import _triangles, reconstruct_by_triangles

SPEC = presets.uoctti(8)


@pytest.fixture(scope="module")
def descriptor() -> Tensor:
    from skimage import data

    camera = torch.from_numpy(data.camera())[None, None] / 255
    return hog(torch.cat([camera[..., 100:132, 200:240], camera[..., 300:332, 250:290]]), SPEC)


def drawn(count: int, seed: int = 0) -> Tensor:
    return torch.stack(list(_triangles(count, 64, 80, (8, 8), torch.Generator().manual_seed(seed))))


def test_triangles_are_of_one_brightness_and_half_their_boxes_at_most() -> None:
    triangles = drawn(300)
    assert (triangles.abs() <= 0.25).all()
    for triangle in triangles:
        inside = triangle != 0
        assert len(triangle[inside].unique()) <= 1
        rows, cols = inside.any(1).nonzero(), inside.any(0).nonzero()
        cut = rows.numel() and (rows.min() == 0 or rows.max() == 63 or cols.min() == 0 or cols.max() == 79)
        if len(rows) and not cut:
            high, wide = (int(of.max() - of.min()) + 1 for of in (rows, cols))
            assert max(high, wide) <= 4 * 8 + 2
            assert int(inside.sum()) <= high * wide / 2 + high + wide  # and the pixels that the sides pass through
    assert (triangles > 0).any(2).any(1).float().mean() > 0.4
    assert (triangles < 0).any(2).any(1).float().mean() > 0.4


def test_they_are_everywhere() -> None:
    assert ((drawn(1000) != 0).sum(0) > 0).all()


def test_the_descriptor_comes_closer_and_never_goes_away(descriptor: Tensor) -> None:
    calls: list[tuple[int, int]] = []
    result = reconstruct_by_triangles(
        descriptor, SPEC, (32, 40), triangles=400, progress=lambda done, total: calls.append((done, total))
    )
    assert result.history.shape == (400, 2)
    assert (result.history.diff(dim=0) <= 0).all()
    assert (result.distance < 0.7).all()
    torch.testing.assert_close(result.distance, result.history[-1])
    assert calls[-1] == (400, 400)
    assert result.image.min() >= 0
    assert result.image.max() <= 1


def test_a_batch_is_its_images_and_the_seed_decides(descriptor: Tensor) -> None:
    both = reconstruct_by_triangles(descriptor, SPEC, triangles=100)
    one = reconstruct_by_triangles(descriptor[1:], SPEC, triangles=100)
    assert torch.equal(both.image[1:], one.image)
    assert not torch.equal(one.image, reconstruct_by_triangles(descriptor[1:], SPEC, triangles=100, seed=1).image)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"triangles": 0}, "there must be at least one triangle to try, got 0"),
        ({"image_size": (32, 48)}, "descriptor of an image of 32x48 pixels must have shape"),
        ({"descriptor": torch.full((1, 4, 5, 31), math.nan)}, "the descriptor must be finite, got NaN or Inf"),
    ],
)
def test_refuses(descriptor: Tensor, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        reconstruct_by_triangles(**{"descriptor": descriptor, "spec": SPEC, **changes})
