"""NumPy arrays and PIL images in place of tensors: axes, results, and what is refused."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from PIL import Image

from nablahog import HOG, HOGSpec, from_layout, hog, presets, to_layout
from nablahog.hog.box import cell_centres

SPEC = presets.uoctti(cell_size=8)


def photograph(shape: tuple[int, ...], dtype: Any = np.float32) -> NDArray[Any]:
    values = np.random.default_rng(0).random(shape)
    return (values * 255).astype(np.uint8) if dtype == np.uint8 else values.astype(dtype)


def channels_first(array: NDArray[Any]) -> torch.Tensor:
    """Images (B, C, H, W), by the rule of docs/conventions.md."""
    shape = array.shape
    batch = array.reshape((1, *shape, 1) if array.ndim == 2 else (1, *shape) if array.ndim == 3 else shape)
    return torch.from_numpy(np.ascontiguousarray(batch.transpose(0, 3, 1, 2)))


@pytest.mark.parametrize("dtype", [np.uint8, np.float32, np.float64])
@pytest.mark.parametrize(
    "shape", [(16, 24), (16, 24, 1), (16, 24, 3), (2, 16, 24, 1), (2, 16, 24, 3), (1, 16, 24, 3), (3, 16, 3)]
)
def test_arrays_have_their_channels_last(shape: tuple[int, ...], dtype: Any) -> None:
    array = photograph(shape, dtype)
    if shape == (3, 16, 3):  # rows, not channels, whatever their number
        array = np.repeat(array, 4, axis=0)
    expected = hog(channels_first(array), SPEC).numpy()
    descriptor = hog(array, SPEC)
    assert isinstance(descriptor, np.ndarray)
    assert descriptor.dtype == expected.dtype
    np.testing.assert_array_equal(descriptor, expected if array.ndim == 4 else expected[0])
    np.testing.assert_array_equal(HOG(SPEC)(array), descriptor)


@pytest.mark.parametrize("shape", [(16, 24), (16, 24, 3)])
def test_pil_images_are_arrays_of_their_pixels(shape: tuple[int, ...]) -> None:
    array = photograph(shape, np.uint8)
    np.testing.assert_array_equal(hog(Image.fromarray(array), SPEC), hog(array, SPEC))


@pytest.mark.parametrize(
    ("shape", "advice"),
    [
        ((3, 16, 24), r"move the channels last, np\.moveaxis\(array, -3, -1\)"),
        ((5, 3, 16, 24), r"move the channels last, np\.moveaxis\(array, -3, -1\)"),
        ((5, 16, 24), r"write array\[\.\.\., None\] for a batch of gray images"),
        ((5, 16, 24, 4), r"of RGBA in uint8 pass each PIL\.Image\.fromarray\(array\[k\]\)"),
        ((5, 16, 24, 5), r"pass a tensor \(B, C, H, W\)"),
    ],
)
def test_other_axes_are_refused_with_advice(shape: tuple[int, ...], advice: str) -> None:
    with pytest.raises(ValueError, match=rf"^images as an array must be \(H, W\), .*: {advice}"):
        hog(photograph(shape), SPEC)


def test_pil_images_are_described_upright_and_over_white() -> None:
    levels = (photograph((16, 24)) * 255).astype(np.uint8)
    turned = Image.fromarray(np.rot90(levels).copy())
    turned.getexif()[0x0112] = 6
    np.testing.assert_array_equal(hog(turned, SPEC), hog(levels, SPEC))
    alpha = np.zeros_like(levels)
    alpha[:, 12:] = 255
    over_white = np.where(alpha == 0, 255, levels)
    clear = Image.merge("LA", [Image.fromarray(levels), Image.fromarray(alpha)])
    np.testing.assert_allclose(hog(clear, SPEC), hog(over_white, SPEC), atol=1e-6)


def test_sizes_are_checked_where_they_come_in() -> None:
    assert presets.opencv(block_size=16) == presets.opencv()  # type: ignore[arg-type]
    for size in ((16.5, 24), (16, 24, 3), 16):
        with pytest.raises(ValueError, match=r"^image_size must be a pair"):
            cell_centres(SPEC, size)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"^cell_size must be a pair \(width, height\)"):
        presets.opencv(cell_size=(0, 8))


@pytest.mark.parametrize("spec", [SPEC, presets.opencv(win_size=(16, 16))], ids=["paper", "opencv"])
def test_signs_that_are_a_bit(spec: HOGSpec) -> None:
    image = torch.rand(1, 1, 24, 24)
    negative: torch.Tensor = torch._neg_view(-image)  # type: ignore[attr-defined]
    assert negative.is_neg()
    assert torch.equal(hog(negative, spec), hog(image, spec))
    leaf = image.clone().requires_grad_()
    cotangent = torch.rand_like(hog(image, spec))
    (grad,) = torch.autograd.grad(hog(leaf, spec), leaf, cotangent)
    (same,) = torch.autograd.grad(hog(leaf, spec), leaf, torch._neg_view(-cotangent))  # type: ignore[attr-defined]
    assert torch.equal(same, grad)


@pytest.mark.parametrize("batch", [None, 2])
@pytest.mark.parametrize("spec", [presets.opencv(win_size=(64, 64)), presets.dlib(), presets.skimage()])
def test_layouts_of_arrays(spec: HOGSpec, batch: int | None) -> None:
    cells = photograph((*([batch] if batch else []), *spec.grid(64, 64), spec.channels))
    native = to_layout(cells, spec)
    expected = to_layout(torch.from_numpy(cells.reshape(-1, *cells.shape[-3:])), spec).numpy()
    np.testing.assert_array_equal(native, expected if batch else expected[0])
    np.testing.assert_array_equal(from_layout(native, spec, (64, 64)), cells)
    np.testing.assert_array_equal(from_layout(native.reshape(*cells.shape[:-3], -1), spec, (64, 64)), cells)


def test_lists_are_tuples() -> None:
    spec = presets.opencv(win_size=[64, 64], block_size=[16, 16])  # type: ignore[arg-type]
    listed = dataclasses.replace(
        spec,
        cell_size=[8, 8],  # type: ignore[arg-type]
        normalizer=dataclasses.replace(spec.normalizer, block=[2, 2], step=[2, 2]),
        pooling=dataclasses.replace(spec.pooling, block=[16, 16], step=[8, 8]),
    )
    assert listed == spec
    assert hash(listed) == hash(spec)
    parts = dataclasses.replace(SPEC.normalizer, parts=["directed", "undirected", "texture"])
    assert dataclasses.replace(SPEC, normalizer=parts) == SPEC
    assert presets.uoctti([8, 8]) == SPEC  # type: ignore[arg-type]
