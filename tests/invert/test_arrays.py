"""Descriptors as NumPy arrays: the same pre-images, as arrays."""

from __future__ import annotations

import numpy as np
import torch

from nablahog import hog, presets, reconstruct, reconstruct_multiscale
from nablahog.invert import Search

SPEC = presets.uoctti(cell_size=8)
DESCRIPTORS = hog(np.random.default_rng(0).random((2, 32, 24, 1), np.float32), SPEC)


def test_a_batch() -> None:
    arrays = reconstruct(DESCRIPTORS, SPEC, [32, 24], search=Search(max_evaluations=10))
    tensors = reconstruct(torch.from_numpy(DESCRIPTORS), SPEC, (32, 24), search=Search(max_evaluations=10))
    np.testing.assert_array_equal(arrays.image, tensors.image[:, 0].numpy())
    for name in ("distance", "history", "evaluations"):
        np.testing.assert_array_equal(getattr(arrays, name), getattr(tensors, name).numpy())
    assert arrays.stop_reason == tensors.stop_reason


def test_a_single_descriptor_has_a_single_image() -> None:
    image = np.random.default_rng(1).random((32, 24), np.float32)
    one = reconstruct(DESCRIPTORS[0], SPEC, start=image, search=Search(max_evaluations=10))
    batch = reconstruct(
        DESCRIPTORS[:1], SPEC, start=torch.from_numpy(image)[None, None], search=Search(max_evaluations=10)
    )
    assert one.image.shape == (32, 24)
    np.testing.assert_array_equal(one.image, batch.image[0])
    assert float(one.distance) == batch.distance[0]
    np.testing.assert_array_equal(one.history, batch.history[:, 0])
    assert len(one.stop_reason) == 1


def test_levels() -> None:
    arrays = reconstruct_multiscale(DESCRIPTORS[0], SPEC, scales=(4, 1), search=Search(max_evaluations=8))
    more = reconstruct_multiscale(
        [DESCRIPTORS[0], DESCRIPTORS[0]], SPEC, scales=(4, 1), search=Search(max_evaluations=8)
    )
    tensors = reconstruct_multiscale(
        torch.from_numpy(DESCRIPTORS[:1]), SPEC, scales=(4, 1), search=Search(max_evaluations=8)
    )
    assert [level.reconstruction.image.shape for level in arrays] == [(16, 12), (32, 24)]
    assert [level.reconstruction.image.shape for level in more] == [(16, 12), (32, 24)]
    for ours, theirs in zip(arrays, tensors, strict=True):
        np.testing.assert_array_equal(ours.reconstruction.image, theirs.reconstruction.image[0, 0].numpy())
