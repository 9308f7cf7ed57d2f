"""What those who look on while a search runs are shown, and how they end it."""

from __future__ import annotations

import itertools

import pytest
import torch
from torch import Tensor

from nablahog import hog, presets, reconstruct
from nablahog.hog.spec import HOGSpec
from nablahog.invert import AsPublished, Iterate, default_prior
from nablahog.invert.single_scale import MEMORY

SPECS = [presets.uoctti(8), presets.paper(8), presets.opencv(win_size=(32, 32))]
PAPER = AsPublished(iterations=3)


def descriptors(spec: HOGSpec, count: int = 2) -> Tensor:
    return hog(torch.rand(count, 1, 32, 32, generator=torch.Generator().manual_seed(0)), spec)


@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: spec.name)
@pytest.mark.parametrize("method", ["default", PAPER], ids=["default", "paper"])
def test_looking_on_changes_nothing(spec: HOGSpec, method: AsPublished) -> None:
    seen: list[tuple[Tensor, Tensor, Tensor]] = []

    def watch(iterate: Iterate) -> None:
        seen.append((iterate.image, iterate.distance.clone(), iterate.evaluations.clone()))

    options = {"method": method} if method is PAPER else {"quality": "fast"}
    watched = reconstruct(descriptors(spec), spec, (32, 32), watch=watch, **options)  # type: ignore[arg-type]
    alone = reconstruct(descriptors(spec), spec, (32, 32), **options)  # type: ignore[arg-type]
    assert torch.equal(watched.image, alone.image)
    assert all(image.shape == (2, 1, 32, 32) for image, _, _ in seen)
    assert all(image.min() >= 0 and image.max() <= 1 for image, _, _ in seen)
    assert all((after >= before).all() for (_, _, before), (_, _, after) in itertools.pairwise(seen))
    assert (seen[-1][2] <= watched.evaluations).all()


def test_the_last_image_is_nearly_the_result() -> None:
    spec, images = presets.uoctti(8), []
    result = reconstruct(descriptors(spec), spec, watch=lambda iterate: images.append(iterate.image), quality="fast")
    assert (images[-1] - result.image).abs().mean() < 0.05
    assert (images[0] - result.image).abs().mean() > 0.1


def test_the_images_are_of_their_part_of_the_batch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("nablahog.invert.single_scale.MEMORY", MEMORY // 2**12)
    parts: list[slice] = []
    reconstruct(
        descriptors(SPECS[0], 3), SPECS[0], watch=lambda iterate: parts.append(iterate.descriptors), quality="fast"
    )
    assert sorted({(part.start, part.stop) for part in parts}) == [(0, 1), (1, 2), (2, 3)]


class Enough(Exception):
    pass


@pytest.mark.parametrize("method", ["default", PAPER], ids=["default", "paper"])
def test_an_exception_ends_the_search(method: AsPublished) -> None:
    calls = 0

    def watch(_: Iterate) -> None:
        nonlocal calls
        calls += 1
        if calls == 2:
            raise Enough

    with pytest.raises(Enough):
        reconstruct(descriptors(SPECS[0]), SPECS[0], method=method, watch=watch)
    assert calls == 2


def test_what_a_prior_expects_comes_first() -> None:
    spec, seen = presets.uoctti(8), []
    of = descriptors(spec)
    reconstruct(of, spec, prior="default", watch=seen.append, quality="fast")
    assert (seen[0].evaluations == 0).all()
    expected = default_prior(spec).expected(of, spec, (32, 32))
    torch.testing.assert_close(seen[0].candidates[:, 0], expected)
    assert (seen[0].distance < 1).all()
