"""Whatever a caller has set and passes, a pre-image is the same or refused."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch

from nablahog import hog, reconstruct, reconstruct_multiscale, train_prior
from nablahog.invert import AsPublished, Search

IMAGE = torch.nn.functional.avg_pool2d(torch.rand(1, 1, 64, 64, generator=torch.Generator().manual_seed(0)), 5, 1, 2)
FEW = Search(max_evaluations=20)


@pytest.fixture(params=[torch.float64, torch.float16], ids=str)
def other_default(request: pytest.FixtureRequest) -> Iterator[torch.dtype]:
    yield request.param
    torch.set_default_dtype(torch.float32)


@pytest.mark.parametrize("name", ["uoctti", "paper"])
def test_another_default_dtype_gives_the_same_pre_image(name: str, other_default: torch.dtype) -> None:
    descriptor = hog(IMAGE, name)
    ways = [
        lambda: reconstruct(descriptor, name, search=FEW).image,
        lambda: reconstruct(descriptor, name, method=AsPublished(iterations=2)).image,
        lambda: reconstruct_multiscale(descriptor, name, scales=(4, 1), search=FEW)[-1].reconstruction.image,
    ]
    expected = [way() for way in ways]
    torch.set_default_dtype(other_default)
    for way, image in zip(ways, expected, strict=True):
        assert torch.equal(way(), image)


def test_another_default_dtype_trains_the_same_prior(other_default: torch.dtype) -> None:
    images = {"noise": IMAGE[0, 0].repeat(2, 2)}
    expected = train_prior(images, "uoctti", epochs=1).weights
    torch.set_default_dtype(other_default)
    assert torch.equal(train_prior(images, "uoctti", epochs=1).weights, expected)
    assert torch.get_default_dtype() == other_default
