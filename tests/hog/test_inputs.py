"""NumPy arrays in place of tensors, and lists of tuples.  Other kinds of input: ``tests/boundary``."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from nablahog import HOG, HOGSpec, hog, presets

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
