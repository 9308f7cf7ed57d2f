"""Tests without OpenCV: stored outputs of its detection, native loops beside plain steps, the derivative of the score.

How the outputs were made: ``tests/golden/README.md``.
"""

from __future__ import annotations

import copy
import json
import pickle
from typing import Any

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose, assert_array_equal
from skimage import data

from nablahog import native
from nablahog.compat.opencv import HOGDescriptor, score
from nablahog.compat.opencv.multi_scale import resize
from tests.golden import archive

STORED = archive("opencv_detection")
CASES = json.loads(str(STORED["cases"]))
# cells of a block across and down, rows of blocks that overlap, bins and gamma differ
SMALL = ((16, 24), (8, 8), (4, 8), (4, 4), 6)
DESCRIPTORS = {
    "default": (),
    "small": SMALL,
    "3x1 cells, gaps": ((40, 20), (12, 6), (14, 7), (4, 6), 18, 1, 2.0, 0, 0.1, True, 64, True),
    "2x5 cells, dense": ((12, 17), (6, 15), (2, 1), (3, 3), 7, 1, -1, 0, 0.3, False, 64, True),
}


@pytest.mark.parametrize("number", range(len(CASES)))
def test_detections_are_the_stored_ones(number: int) -> None:
    options = dict(CASES[number])
    descriptor = HOGDescriptor(*json.loads(str(STORED["sizes"])))
    descriptor.setSVMDetector(STORED["detector"])
    rectangles, weights = descriptor.detectMultiScale(archive("images")[options.pop("image")], **options)
    expected = STORED[f"rectangles_{number}"]
    assert len(rectangles) == len(expected) > 0
    assert_array_equal(rectangles, expected)
    assert np.abs(weights - STORED[f"weights_{number}"]).max() <= 1e-5


with_loops = pytest.mark.skipif(not native.available(), reason="no native library")


def image(channels: int, height: int = 150, width: int = 90) -> np.ndarray:
    """Of few levels, so that channels tie."""
    return np.ascontiguousarray(data.astronaut()[30 : 30 + height, 200 : 200 + width, :channels]) // 16 * 16


def with_and_without(monkeypatch: pytest.MonkeyPatch, call: Any) -> tuple[Any, Any]:
    loops = call()
    monkeypatch.setattr(native, "available", lambda: False)
    return loops, call()


@with_loops
@pytest.mark.parametrize("arguments", DESCRIPTORS.values(), ids=DESCRIPTORS)
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("options", [{}, {"winStride": (5, 3), "padding": (40, 8)}, {"locations": [(0, 3), (17, 11)]}])
def test_descriptors(
    arguments: tuple[Any, ...], channels: int, options: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    loops, plain = with_and_without(monkeypatch, lambda: HOGDescriptor(*arguments).compute(image(channels), **options))
    assert loops.any()
    assert_allclose(loops, plain, rtol=0, atol=2e-6)


@with_loops
@pytest.mark.parametrize("arguments", DESCRIPTORS.values(), ids=DESCRIPTORS)
def test_scores(arguments: tuple[Any, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    descriptor = HOGDescriptor(*arguments)
    descriptor.setSVMDetector(np.random.default_rng(0).standard_normal(descriptor.getDescriptorSize() + 1))
    options = {"hitThreshold": -1e6, "winStride": (3, 5), "padding": (6, 6)}
    (places, loops), (_, plain) = with_and_without(monkeypatch, lambda: descriptor.detect(image(3), **options))
    assert len(places) > 4
    assert_allclose(loops, plain, rtol=0, atol=2e-5)


@with_loops
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("size", [(37, 43), (1, 6), (2, 1)])
def test_gradients(channels: int, size: tuple[int, int], monkeypatch: pytest.MonkeyPatch) -> None:
    (loops, bins), (plain, plain_bins) = with_and_without(
        monkeypatch, lambda: HOGDescriptor().computeGradient(image(channels, *size), None, None, (3, 9), (5, 0))
    )
    assert_allclose(loops, plain, rtol=0, atol=1e-5)
    assert_array_equal(bins, plain_bins)


@with_loops
@pytest.mark.parametrize(
    ("size", "larger", "padding"), [((30, 65), (30, 66), (2**30 - 33, 0)), ((65, 30), (66, 30), (0, 2**30 - 33))]
)
def test_sides_that_are_padded_to_less_than_2_to_the_31(
    size: tuple[int, int], larger: tuple[int, int], padding: tuple[int, int]
) -> None:
    small = HOGDescriptor(*SMALL)
    options: dict[str, Any] = {"winStride": (1, 1), "locations": [(3, 2)]}
    padded = small.compute(image(1, *size), padding=padding, **options)
    assert_array_equal(padded, small.compute(image(1, *size), **options))
    with pytest.raises(ValueError, match=r"fewer than 2\*\*31 rows and columns"):
        small.compute(image(1, *larger), padding=padding, **options)


@with_loops
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("size", [(71, 133), (90, 149), (1, 1), (200, 3)])
def test_smaller_images(channels: int, size: tuple[int, int], monkeypatch: pytest.MonkeyPatch) -> None:
    assert_array_equal(*with_and_without(monkeypatch, lambda: resize(image(channels), size)))


def test_copies_describe_alike() -> None:
    used = HOGDescriptor(*SMALL)
    expected = used.compute(image(3))
    for copied in (copy.deepcopy(used), pickle.loads(pickle.dumps(used))):
        assert_array_equal(copied.compute(image(3)), expected)


def descriptor(*sizes: Any, bias: bool = True) -> HOGDescriptor:
    small = HOGDescriptor(*(sizes or SMALL))
    weights = np.random.default_rng(0).standard_normal(small.getDescriptorSize() + bias)
    small.setSVMDetector(weights.astype(np.float32) / 4)
    return small


@pytest.mark.parametrize("colour", [False, True])
@pytest.mark.parametrize("bias", [False, True])
def test_it_is_the_weight_of_detect(colour: bool, bias: bool) -> None:
    image = data.astronaut()[100:124, 200:216, : 3 if colour else 1]
    (weight,) = descriptor(bias=bias).detect(image, hitThreshold=-99)[1]
    pixels = torch.from_numpy(image.copy()).permute(2, 0, 1).unsqueeze(0)
    for images in (pixels, pixels / 255, pixels.double() / 255):
        assert float(score(images, descriptor(bias=bias))) == pytest.approx(weight, abs=2e-5)
        assert float(score(images, descriptor(bias=bias), "exact")) == pytest.approx(weight, abs=5e-3)


@pytest.mark.parametrize("channels", [1, 3])
def test_its_derivative(channels: int) -> None:
    images = torch.rand(2, channels, 12, 8, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    images.requires_grad_()
    small = descriptor((8, 12), (8, 8), (4, 4), (4, 4), 6)
    assert torch.autograd.gradcheck(lambda x: score(x, small, "exact"), images, eps=1e-7, atol=1e-5)
    (ours,) = torch.autograd.grad(score(images, small).sum(), images)
    (exact,) = torch.autograd.grad(score(images, small, "exact").sum(), images)
    assert float((ours - exact).abs().max()) < 0.02 * float(exact.abs().max())  # of the polynomial's value only


def test_refusals() -> None:
    with pytest.raises(ValueError, match="the descriptor has no detector"):
        score(torch.zeros(1, 1, 24, 16), HOGDescriptor(*SMALL))
    with pytest.raises(ValueError, match="images must be"):
        score(torch.zeros(1, 1, 16, 24), descriptor())
