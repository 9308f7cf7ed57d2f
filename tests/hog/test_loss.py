"""HOGLoss: the distance that reconstructions report, and its derivative in every mode."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch.testing import assert_close

from nablahog import HOGLoss, hog, presets
from nablahog.hog.dialects import DEFAULT_SPECS
from nablahog.invert.reconstruction import relative_distance

from .zoo import noise

SPECS = ["paper", "uoctti", "opencv"]
IMAGES, TARGETS = noise(2, 1, 32, 32, seed=0), noise(2, 1, 32, 32, seed=1)


@pytest.mark.parametrize("name", [*SPECS, "vlfeat"])
def test_it_is_the_squared_distance_of_reconstructions(name: str) -> None:
    spec = DEFAULT_SPECS[name] if name != "opencv" else presets.opencv(win_size=(32, 32))
    expected = relative_distance(IMAGES, hog(TARGETS, spec), spec).square()
    assert_close(HOGLoss(spec, reduction="none")(IMAGES, TARGETS), expected)
    assert_close(HOGLoss(spec, reduction="sum")(IMAGES, TARGETS), expected.sum())
    assert_close(HOGLoss(spec)(IMAGES, TARGETS), expected.mean())


@pytest.mark.parametrize("name", ["paper", "uoctti"])
def test_its_derivative_is_that_of_differences(name: str) -> None:
    inputs = (IMAGES[:, :, :16, :16].clone().requires_grad_(), TARGETS[:, :, :16, :16].clone().requires_grad_())
    assert torch.autograd.gradcheck(HOGLoss(name), inputs, eps=1e-7)  # the nearest kink is 1e-6 off


@pytest.mark.parametrize("name", ["paper", "uoctti", "maskfeat"])
@pytest.mark.parametrize("flat", ["image", "target", "both", "neither, but they agree"])
def test_flat_and_equal_images_have_finite_losses_and_gradients(name: str, flat: str) -> None:
    gray, other = torch.full((1, 3, 16, 16), 0.5), torch.rand(1, 3, 16, 16)
    x = (gray if flat in ("image", "both") else other).clone().requires_grad_()
    y = (gray if flat in ("target", "both") else other).clone().requires_grad_()
    loss = HOGLoss(name)(x, y)
    loss.backward()  # type: ignore[no-untyped-call]
    if flat != "target":
        assert loss.item() == pytest.approx(1 if flat == "image" else 0, abs=1e-6)
    for each in (x, y):
        assert each.grad is not None
        assert bool(each.grad.isfinite().all())


def test_it_compiles_to_one_graph_and_keeps_precision_under_autocast() -> None:
    loss, images, targets = HOGLoss("uoctti"), IMAGES.float(), TARGETS.float()
    expected = loss(images, targets)
    compiled: Any = torch.compile(loss, fullgraph=True, backend="aot_eager")
    assert_close(compiled(images, targets), expected)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        assert_close(loss(images, targets), expected)
    halves = loss(images.half(), targets.half())
    assert halves.dtype == torch.float32
    assert_close(halves, expected, rtol=1e-2, atol=0)
    assert_close(loss(images, (255 * targets).round().byte()), loss(images, (255 * targets).round() / 255))


def test_refuses() -> None:
    wrong: Any = "median"
    with pytest.raises(ValueError, match="reduction must be one of 'mean', 'sum', 'none', got 'median'"):
        HOGLoss("uoctti", reduction=wrong)
    other: Any
    for other in (TARGETS[:1], hog(TARGETS, "uoctti"), TARGETS.numpy()):
        for pair in ((TARGETS, other), (other, TARGETS)):
            with pytest.raises(ValueError, match=r"must be tensors \(B, C, H, W\) of one shape, got .* and "):
                HOGLoss("uoctti")(*pair)


def test_empty_batches() -> None:
    assert HOGLoss("uoctti", reduction="none")(TARGETS[:0], TARGETS[:0]).shape == (0,)
