"""Exactly flat regions: recovered from the descriptor, made constant by a projection, on any device."""

from __future__ import annotations

import pytest
import torch

from nablahog import native
from nablahog.hog import hog, presets
from nablahog.invert.unknowns import FlatRegions

from .photographs import photograph

SPEC = presets.uoctti(8)


def test_flat_regions_are_found_made_constant_and_silent() -> None:
    image = photograph(64).clone()
    image[..., :, :40] = 1.0
    descriptor = hog(image, SPEC)
    flat, index, noise = FlatRegions(descriptor, SPEC, 64, 64), torch.zeros(1, dtype=torch.long), torch.rand_like(image)
    made, known = flat(noise, index), flat.regions[0] > 0
    assert known[1:-1, 1:34].all()  # the corners of the ring, which does not vote, remain unknown
    assert not known[:, 44:].any()
    assert made[0, 0][known].unique().numel() == 1
    torch.testing.assert_close(made[0, 0][known][0], noise[0, 0][known].mean())
    assert torch.equal(made[0, 0][~known], noise[0, 0][~known])
    empty = (descriptor == 0).all(-1)
    assert empty.any()
    assert (hog(made, SPEC)[empty] == 0).all()


@pytest.mark.parametrize("compiled", [True, False], ids=["compiled", "plain"])
def test_flat_regions_are_levelled_by_a_projection(compiled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if not compiled:
        monkeypatch.setattr(native, "available", lambda: False)
    image = photograph(48).double()
    image[..., :20, :20], image[..., 30:, 30:] = 0.2, 0.9
    regions = FlatRegions(hog(image.repeat(2, 1, 1, 1), SPEC), SPEC, 48, 48)
    assert len(regions.sizes) > 3
    index, pixels = torch.tensor([1, 0]), torch.rand(2, 1, 48, 48, dtype=torch.float64, requires_grad=True)
    levelled = regions(pixels, index)
    expected = pixels.detach().clone()
    for label in range(1, len(regions.sizes)):
        of_it = (regions.regions[index] == label).unsqueeze(1)
        if of_it.any():
            expected[of_it] = expected[of_it].mean()
    torch.testing.assert_close(levelled, expected)
    with torch.no_grad():
        assert torch.equal(regions.level(pixels.clone(), index), levelled)
        torch.testing.assert_close(regions(levelled, index), levelled)
    direction = torch.rand_like(pixels)
    (result,) = torch.autograd.grad(levelled, pixels, direction)
    torch.testing.assert_close(result, regions(direction, index))  # its own adjoint
    tangent = torch.func.jvp(lambda x: regions(x, index), (pixels.detach(),), (direction,))[1]
    torch.testing.assert_close(tangent, regions(direction, index))


def test_a_textured_image_is_left_alone() -> None:
    noise = torch.rand(2, 1, 32, 32)
    assert torch.equal(FlatRegions(hog(noise, SPEC), SPEC, 32, 32)(noise, torch.arange(2)), noise)
