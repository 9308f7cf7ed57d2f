"""HOGLoss: its bound, its continuity, and for ordinary targets the distance that reconstructions report."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from torch import Tensor
from torch.testing import assert_close

from nablahog import HOGLoss, HOGSpec, hog, presets
from nablahog.hog import FourBlockNorm, GlobalNorm
from nablahog.hog.dialects import DEFAULT_SPECS
from nablahog.hog.steps import pooling_axes
from nablahog.invert.reconstruction import relative_distance

from .zoo import DOUBLE, PRESETS, noise

SPECS = ["paper", "uoctti", "opencv"]
IMAGES, TARGETS = noise(2, 1, 32, 32, seed=0), noise(2, 1, 32, 32, seed=1)
FLAT = torch.full((1, 1, 64, 64), 128 / 255, dtype=DOUBLE)  # cnn_hog sees this gray beyond the border
CONTRASTS = st.floats(0, 6).map(lambda decades: 10**-decades)
BOUNDS = {  # on 8x8 entries, from the docstring
    **dict.fromkeys(("aubry", "skimage", "opencv", "dalal_triggs", "maskfeat"), 5),
    **dict.fromkeys(("uoctti", "vlfeat", "piotr"), 6),
    **{"cnn_hog": 6.3, "seeing3d": 6.1, "dpm": 7.3, "dlib": 7.3, "paper": 69},
}


def largest_energy(spec: HOGSpec, height: int, width: int) -> float:
    """A bound of ‖φ‖² of images in 0…1: no block, cell or histogram that is normalised is longer than 1.

    The entries of a cell that are made from one four-block are at most as long as its share of the block, and an entry
    is half the sum over four blocks, whose square is at most the sum of their squares.  So is each of the parts, but
    for the texture, by Cauchy's inequality times n·c² of n orientations and its constant c.
    """
    norm, (rows, cols) = spec.normalizer, spec.grid(height, width)
    if isinstance(norm, FourBlockNorm):
        n = spec.bins // 2 if spec.signed else spec.bins
        shares = {"directed": 1, "undirected": 1, "blocks": 1, "texture": n / 18, "zero": 0}
        beyond = {"drop": 1, "repeat": 0, "missing": -1}[norm.outside]  # a repeated cell makes its share smaller
        blocks = (rows + beyond) * (cols + beyond)
        return blocks * (1 + 1e-4) * sum(shares[part] for part in norm.parts)  # DPM's constant has four decimals
    if not isinstance(norm, GlobalNorm):
        return rows * cols * spec.colours
    if norm.form == "robust":
        return 1
    down, across = (axis.totals() for axis in pooling_axes(spec, height, width, FLAT))
    return math.sqrt(2) * spec.value_range * float(torch.outer(down, across).norm())  # ‖φ‖² < ‖v‖, and ‖∇‖ ≤ √2


def squared_scale(spec: HOGSpec, size: tuple[int, int]) -> float:
    """s², from the loss of an image and a flat target."""
    image, flat = noise(1, 1, *size, seed=7), FLAT[..., :1, :1].expand(1, 1, *size)
    return float(hog(image, spec).square().sum() / HOGLoss(spec)(image, flat))


def at_contrast(contrast: float, seed: int) -> Tensor:
    """Noise around the gray of ``FLAT``."""
    return FLAT + contrast * 0.99 * (noise(1, 1, 64, 64, seed=seed) - 0.5)


def strong_edges(height: int, width: int) -> Tensor:
    """Stripes, isolated dots, noise and black and white noise: (14, 1, height, width)."""
    rows, cols = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    stripes = [along % period < period / 2 for period in (2, 4, 8, 16) for along in (rows, cols)]
    dots = (rows % 16 == 4) & (cols % 16 == 4)
    random = noise(5, height, width, seed=3)
    return torch.cat([torch.stack([*stripes, dots]), random, random.round()]).unsqueeze(1)


@pytest.mark.parametrize("name", DEFAULT_SPECS)
def test_its_scale_is_a_quarter_of_an_even_texture(name: str) -> None:
    """Of long, mathematically: each entry of a block of n alike is 1/√n; a cell with its four blocks has 1 + ½ + ½."""
    spec = DEFAULT_SPECS[name]
    rows, cols = spec.grid(128, 128)
    if name == "paper":
        expected = math.sqrt(rows * cols * 9) * (64 / 9 * 0.25)  # votes of 64 pixels with gradients of ¼, in 9 bins
    else:
        four_block_parts = {"directed": 0.5, "undirected": 1.0, "texture": 0.5, "zero": 0.0}
        parts = spec.normalizer.parts if isinstance(spec.normalizer, FourBlockNorm) else ("undirected",)
        expected = rows * cols * spec.colours * sum(four_block_parts[part] for part in parts)
    assert squared_scale(spec, (128, 128)) == pytest.approx(expected / 4, rel=0.01)  # ε of aubry is 0.6 % of a block


@pytest.mark.parametrize("name", DEFAULT_SPECS)
def test_is_bounded_by_what_entries_can_be(name: str) -> None:
    spec = DEFAULT_SPECS[name]
    size = spec.image_size(8, 8)
    images, flat = strong_edges(*size), FLAT[..., :1, :1].expand(1, 1, *size)
    bound = 1 + largest_energy(spec, *size) / squared_scale(spec, size)
    assert 0.8 * BOUNDS[name] < bound < 1.01 * BOUNDS[name]  # those of paper and cnn_hog grow with the image
    one_pixel = flat.clone()
    one_pixel[..., 20, 20] += 1 / 255
    loss = HOGLoss(spec, reduction="none")
    for target in (flat, one_pixel, flat + 1e-6 * images[-1:], flat + 1e-3 * images[-1:], images[:1], images[8:9]):
        assert bool((loss(images, target.expand_as(images)) <= bound).all())
    assert loss(images, flat.expand_as(images)).max() > bound / 2  # nor is it much less


@given(st.sampled_from(sorted(PRESETS)), CONTRASTS, st.just(0.0) | CONTRASTS, st.integers(0, 99))
def test_changes_no_faster_than_the_targets_descriptor(name: str, first: float, second: float, seed: int) -> None:
    """Also from any contrast to none."""
    spec, image = PRESETS[name](), noise(1, 1, 64, 64, seed=100)
    targets = [at_contrast(contrast, seed) for contrast in (first, second)]
    roots = [float(HOGLoss(spec)(image, target).sqrt()) for target in targets]
    change = float((hog(targets[0], spec) - hog(targets[1], spec)).norm())
    limit = (1 + min(roots)) * change / math.sqrt(squared_scale(spec, (64, 64)))
    assert abs(roots[0] - roots[1]) <= limit + 1e-6


@pytest.mark.parametrize("name", [*SPECS, "vlfeat"])
def test_it_is_the_squared_distance_of_reconstructions(name: str) -> None:
    spec = DEFAULT_SPECS[name] if name != "opencv" else presets.opencv(win_size=(32, 32))
    expected = relative_distance(IMAGES, hog(TARGETS, spec), spec).square()
    assert_close(HOGLoss(spec, reduction="none")(IMAGES, TARGETS), expected)
    assert_close(HOGLoss(spec, reduction="sum")(IMAGES, TARGETS), expected.sum())
    assert_close(HOGLoss(spec)(IMAGES, TARGETS), expected.mean())


@pytest.mark.parametrize("contrast", [1.0, 1e-2, 0.0], ids=["ordinary", "weak", "flat"])
@pytest.mark.parametrize("name", ["paper", "uoctti", "aubry", "cnn_hog"])
def test_its_derivative_is_that_of_differences(name: str, contrast: float) -> None:
    image = noise(1, 1, 16, 16, seed=0).requires_grad_()
    target = 0.5 + contrast * (noise(1, 1, 16, 16, seed=1) - 0.5)
    target.requires_grad_(contrast > 0)  # signed bins have one-sided derivatives at flat images only
    spec = DEFAULT_SPECS[name].with_linear_votes()
    assert torch.autograd.gradcheck(HOGLoss(spec), (image, target), eps=1e-7 * max(contrast, 1e-2))


@pytest.mark.parametrize("name", DEFAULT_SPECS)
def test_a_batch_is_a_loop_and_float32_is_float64(name: str) -> None:
    images = noise(4, 3, 64, 64, seed=0, dtype=torch.float32)
    targets = 0.5 + torch.tensor([1, 0.1, 0.01, 0]).reshape(-1, 1, 1, 1) * (images.flip(0) - 0.5)
    loss = HOGLoss(name, reduction="none")
    losses = loss(input=images, target=targets)  # the names of PyTorch's losses
    assert_close(losses, torch.cat([loss(*pair) for pair in zip(images.split(1), targets.split(1), strict=True)]))
    assert_close(losses, loss(images.double(), targets.double()).float(), rtol=1e-3, atol=0)


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
    for images in (x, y):
        assert images.grad is not None
        assert bool(images.grad.isfinite().all())


def test_refuses() -> None:
    wrong: Any = "median"
    with pytest.raises(ValueError, match="reduction must be one of 'mean', 'sum', 'none', got 'median'"):
        HOGLoss("uoctti", reduction=wrong)
    other: Any
    for other in (TARGETS[:1], hog(TARGETS, "uoctti"), TARGETS.numpy()):
        for pair in ((TARGETS, other), (other, TARGETS)):
            with pytest.raises(ValueError, match=r"must be tensors \(B, C, H, W\) of one shape, got .* and "):
                HOGLoss("uoctti")(*pair)
    input: Any = Image.new("L", (32, 24))
    with pytest.raises(ValueError, match="got Image and Image: write ") as raised:
        HOGLoss("uoctti")(input, input)
    tensor = eval(str(raised.value).partition(": write ")[2], {"np": np, "torch": torch, "input": input})
    assert HOGLoss("uoctti")(tensor / 255, tensor) == 0
    with pytest.raises(ValueError, match="on one device, got meta and cpu: write target"):
        HOGLoss("uoctti")(TARGETS, TARGETS.to("meta"))


def test_it_is_shown_with_its_dialect() -> None:
    assert "vlfeat, reduction='sum'" in repr(HOGLoss("vlfeat", reduction="sum"))


def test_empty_batches() -> None:
    """As PyTorch's losses: a mean of nothing is NaN, a sum 0."""
    losses: dict[Any, Tensor] = {"mean": torch.tensor(math.nan), "sum": torch.tensor(0.0), "none": torch.zeros(0)}
    for reduction, expected in losses.items():
        loss = HOGLoss("uoctti", reduction=reduction)(TARGETS[:0], TARGETS[:0])
        assert_close(loss, expected.to(loss), equal_nan=True)
