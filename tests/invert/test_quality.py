"""How much a reconstruction spends: by name, and of memory."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch import Tensor

from nablahog import hog, presets, reconstruct
from nablahog.invert import Search
from nablahog.invert.colour import reconstruct_colour
from nablahog.invert.quality import quality_of
from nablahog.invert.single_scale import VECTORS
from nablahog.metrics import cross_correlation

from .options import grouped
from .photographs import photograph

UOCTTI, PAPER = presets.uoctti(8), presets.paper(8)
NAMES = ("camera", "astronaut", "coffee")


def photographs(size: int, precision: torch.dtype = torch.float32) -> Tensor:
    return torch.cat([photograph(size, name) for name in NAMES]).to(precision)


def test_fast_spends_less_and_best_comes_closer() -> None:
    images = photographs(64)
    descriptors = hog(images, UOCTTI)
    best, fast = (reconstruct(descriptors, UOCTTI, quality=quality) for quality in ("best", "fast"))
    assert (fast.evaluations <= quality_of("fast").evaluations).all()
    assert (fast.evaluations * 5 < best.evaluations).all()
    assert (best.distance < fast.distance).all()
    of_best, of_fast = (
        [cross_correlation(a[0], b[0]) for a, b in zip(result.image, images, strict=True)] for result in (best, fast)
    )
    assert sum(of_best) > sum(of_fast)
    assert sum(of_fast) / 3 > 0.76  # the paper's mean over its own photographs


def test_best_is_the_default() -> None:
    descriptor = hog(photograph(32), UOCTTI)
    assert torch.equal(reconstruct(descriptor, UOCTTI).image, reconstruct(descriptor, UOCTTI, quality="best").image)


def test_an_unsigned_descriptor_in_less() -> None:
    descriptor = hog(photograph(32), PAPER)
    result = reconstruct(descriptor, PAPER, quality="fast")
    assert result.evaluations <= quality_of("fast").without_samples
    assert result.distance < 0.25


def test_what_is_given_goes_before_the_quality() -> None:
    descriptor = hog(photograph(32), UOCTTI)
    assert reconstruct(descriptor, UOCTTI, quality="fast", search=Search(max_evaluations=7)).evaluations <= 7
    one, two, default = (
        reconstruct(descriptor, UOCTTI, quality="fast", search=Search(samples=samples)).image
        for samples in (1, 2, None)
    )
    assert torch.equal(two, default)
    assert not torch.equal(one, two)


def test_colours_in_less() -> None:
    descriptor = hog(torch.rand(1, 3, 24, 24, generator=torch.Generator().manual_seed(0)), UOCTTI)
    fast = reconstruct_colour(descriptor, UOCTTI, quality="fast")
    assert fast.evaluations <= quality_of("fast").evaluations + quality_of("fast").on_colours


def test_no_such_quality() -> None:
    for find in (reconstruct, reconstruct_colour):
        with pytest.raises(ValueError, match="quality must be one of 'best', 'fast', got 'good'"):
            find(torch.rand(1, 4, 4, 31), UOCTTI, quality="good")


@pytest.mark.parametrize(
    ("spec", "options"),
    [
        (UOCTTI, {}),
        (UOCTTI, {"start": photographs(40, torch.float64)}),
        (PAPER, {}),
        (PAPER, {"expected": photographs(40, torch.float64)}),
        (PAPER, {"region_signs": False}),
    ],
    ids=["signed", "start", "unsigned", "expected", "noise"],
)
def test_a_batch_in_parts_is_the_same(spec: Any, options: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    descriptors = hog(photographs(40, torch.float64), spec)
    options = {"max_evaluations": 80, **options}  # two samples, and too short for rounding to grow
    whole = reconstruct(descriptors, spec, **grouped(**options))
    monkeypatch.setattr("nablahog.invert.single_scale.MEMORY", 1)
    calls: list[tuple[int, int]] = []
    parts = reconstruct(descriptors, spec, progress=lambda *call: calls.append(call), **grouped(**options))
    for name in ("image", "distance", "history"):
        torch.testing.assert_close(getattr(parts, name), getattr(whole, name), atol=1e-5, rtol=0)
    assert torch.equal(parts.evaluations, whole.evaluations)
    assert parts.stop_reason == whole.stop_reason
    assert calls == sorted(set(calls))
    assert {most for _, most in calls} == {3 * 80}
    assert calls[-1][0] > 2 * 80


def test_parts_are_as_large_as_the_memory_allows(monkeypatch: pytest.MonkeyPatch) -> None:
    sizes: list[int] = []

    def recorded(votes: Tensor, *given: Any) -> Tensor:
        sizes.append(len(votes))
        return torch.full((len(votes), 1, 1, 32, 32), 0.5).expand(-1, given[3], -1, -1, -1) + torch.rand(
            1, 1, 1, 32, 32
        )

    monkeypatch.setattr("nablahog.invert.single_scale.starting_images", recorded)
    descriptors = hog(photographs(32), UOCTTI).repeat(3, 1, 1, 1)
    of_one = VECTORS * 4 * 32 * 32
    for samples, memory, expected in [(1, 4, [4, 4, 1]), (2, 4, [2, 2, 2, 2, 1]), (2, 100, [9]), (2, 1, [1] * 9)]:
        sizes.clear()
        monkeypatch.setattr("nablahog.invert.single_scale.MEMORY", memory * of_one)
        assert len(reconstruct(descriptors, UOCTTI, search=Search(samples=samples, max_evaluations=3)).image) == 9
        assert sizes == expected
