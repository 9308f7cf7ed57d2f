"""Side by side with ``skimage.feature.hog``."""

from __future__ import annotations

import inspect
from contextlib import nullcontext
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from skimage import data, feature, transform

import nablahog
from nablahog import presets
from nablahog.compat.skimage import hog

# scikit-image adds the votes of a cell in float32; the more pixels it has, the further that is from the sum
TOLERANCE = 1e-6
NORMS = ["L1", "L1-sqrt", "L2", "L2-Hys"]
TYPES = [np.uint8, np.int16, np.uint32, np.float16, np.float32, np.float64, np.dtype(">f4"), np.bool_]

sides = st.tuples(st.integers(2, 9), st.integers(2, 9))
blocks = st.tuples(st.integers(1, 3), st.integers(1, 3))


def crop(seed: int, height: int, width: int) -> np.ndarray:
    """Somewhere in a colour photograph of 8 bits."""
    row, col = np.random.default_rng(seed).integers(0, 200, 2)
    return np.ascontiguousarray(data.astronaut()[row : row + height, col : col + width])


def assert_same(image: Any, **options: Any) -> None:
    """Values, shapes and dtypes of descriptor and picture."""
    for ours, theirs in zip(
        hog(image, visualize=True, **options), feature.hog(image, visualize=True, **options), strict=True
    ):
        assert isinstance(ours, np.ndarray)
        assert ours.dtype == theirs.dtype
        assert ours.flags.c_contiguous
        assert ours.shape == theirs.shape
        scale = max(1.0, np.nanmax(np.abs(theirs), initial=0.0))
        assert_allclose(ours / scale, theirs / scale, rtol=0, atol=TOLERANCE)
    without = hog(image, **options)
    assert_array_equal(without, hog(image, visualize=True, **options)[0])


def test_signature_is_the_same() -> None:
    ours, theirs = (inspect.signature(f).parameters.values() for f in (hog, feature.hog))
    assert [(p.name, p.kind, p.default) for p in ours] == [(p.name, p.kind, p.default) for p in theirs]


@pytest.mark.slow
@given(
    seed=st.integers(0, 99),
    orientations=st.integers(1, 16),
    pixels_per_cell=sides,
    cells_per_block=blocks,
    spare=st.tuples(st.integers(0, 9), st.integers(0, 9)),
    block_norm=st.sampled_from(NORMS),
    transform_sqrt=st.booleans(),
    feature_vector=st.booleans(),
    scale=st.sampled_from([1, 255]),
    dtype=st.sampled_from([np.float32, np.float64]),
    colour=st.booleans(),
)
@settings(max_examples=100)
def test_photographs(
    seed: int,
    pixels_per_cell: tuple[int, int],
    cells_per_block: tuple[int, int],
    spare: tuple[int, int],
    scale: int,
    dtype: type,
    colour: bool,
    **options: Any,
) -> None:
    """Divided by 255, gradients that are equal in 8 bits differ by rounding; their order has to be the same."""
    height, width = (c * b + more for c, b, more in zip(pixels_per_cell, cells_per_block, spare, strict=True))
    image = crop(seed, height, width).astype(dtype) / dtype(scale)
    assert_same(
        image if colour else image.mean(axis=2),
        pixels_per_cell=pixels_per_cell,
        cells_per_block=cells_per_block,
        channel_axis=-1 if colour else None,
        **options,
    )


@given(
    seed=st.integers(0, 99),
    orientations=st.integers(3, 16),
    pixels_per_cell=sides,
    cells_per_block=blocks,
    block_norm=st.sampled_from(NORMS),
    transform_sqrt=st.booleans(),
    channel_axis=st.sampled_from([None, -1]),
)
def test_the_preset(seed: int, **options: Any) -> None:
    """Of noise, where nothing hangs on rounding."""
    shape = (40, 37) if options["channel_axis"] is None else (40, 37, 3)
    image = np.random.default_rng(seed).random(shape)
    preset = presets.skimage(**options, value_range=1.0)
    expected = feature.hog(image, **options)
    assert_allclose(nablahog.hog(image, preset, layout="native"), expected, rtol=0, atol=TOLERANCE)


@pytest.mark.parametrize("dtype", TYPES, ids=str)
def test_dtypes(dtype: Any) -> None:
    image = crop(0, 40, 48)
    assert_same(image.astype(dtype), channel_axis=2)
    assert_same(image[..., 0].astype(dtype))


@pytest.mark.parametrize("axis", [0, 1, 2, -1, -2, -3])
def test_channel_axes(axis: int) -> None:
    assert_same(np.moveaxis(crop(1, 30, 40), -1, axis), channel_axis=axis, cells_per_block=(2, 2))


def test_views_and_lists() -> None:
    image = crop(3, 60, 70)
    for view in (image[::-1, ::-2, 0], image[..., 1].T, np.asfortranarray(image[..., 2])):
        assert_same(view)
    read_only = image[..., 0].copy()
    read_only.flags.writeable = False
    assert_same(read_only, pixels_per_cell=[np.int64(8), 8], cells_per_block=np.array([2, 2]), orientations=np.int64(9))
    assert_same(read_only, pixels_per_cell=(np.float32(8), 8.0), cells_per_block=range(1, 3))
    for axis in (np.int8(2), (2,), np.array([-1])):
        assert_same(image, channel_axis=axis)
    for size in ((8.5, 8), (8, 8, 8), (None, 8), "88"):
        for each in (hog, feature.hog):
            with nullcontext() if size == (8.5, 8) and each is feature.hog else pytest.raises((TypeError, ValueError)):
                each(image[..., 0], pixels_per_cell=size)


@pytest.mark.parametrize("cell", [(1, 1), (2, 1), (1, 2), (1, 3), (2, 2), (3, 2)])
@pytest.mark.parametrize(("orientations", "width"), [(8, 24), (9, 24), (9, 25)])
def test_pictures_of_the_smallest_cells(cell: tuple[int, int], orientations: int, width: int) -> None:
    """Each is drawn or refused as by scikit-image."""
    options: Any = {"orientations": orientations, "pixels_per_cell": cell, "cells_per_block": (1, 1)}
    image = crop(5, 20, width)[..., 0]
    try:
        feature.hog(image, visualize=True, **options)
    except IndexError:
        with pytest.raises(ValueError, match="leave the picture in cells of one pixel"):
            hog(image, visualize=True, **options)
        return
    assert_same(image, **options)


@pytest.mark.parametrize("norm", NORMS)
def test_faint_images(norm: str) -> None:
    """The ε of blocks is not scaled."""
    assert_same(1e-7 * np.random.default_rng(0).random((30, 40)), block_norm=norm)


def test_gradients_off_a_boundary_by_rounding() -> None:
    """Resizing leaves some of 1e-17 in flat directions; scikit-image drops those just below 0°, and so it is here."""
    image = np.zeros((64, 64))
    image[:, 20:45] = 1
    image = transform.resize(image, (45, 45), anti_aliasing=True)
    down, right = image[2:, 1:-1] - image[:-2, 1:-1], image[1:-1, 2:] - image[1:-1, :-2]
    assert (np.arctan2(down, right) * 180 / np.pi % 180 == 180).any()
    for orientations in (4, 6, 7, 9, 12):
        assert_same(image, orientations=orientations)


def test_nan_stays_where_scikit_image_leaves_it() -> None:
    image = crop(4, 80, 80).astype(float)
    image[20, 30, 1] = np.nan
    image[60, 61, :] = np.inf
    with np.errstate(invalid="ignore"):
        assert_same(image[..., 0])
    image[60, 61, :] = 0
    assert_same(image, channel_axis=-1)
    assert np.isfinite(hog(image, channel_axis=-1)).any()


def test_roots_of_negative_values_are_nan_with_a_warning() -> None:
    image = crop(4, 64, 64)[..., 0].astype(float)
    image[10, 10] = -1
    result = []
    for f in (hog, feature.hog):
        with pytest.warns(RuntimeWarning, match="invalid value encountered in sqrt"):
            result.append(f(image, transform_sqrt=True))
    assert_allclose(*result, rtol=0, atol=TOLERANCE)
    assert np.isnan(result[0]).any()
    assert np.isfinite(result[0]).any()


@pytest.mark.parametrize("dtype", [torch.uint8, torch.float16, torch.float32, torch.float64])
@pytest.mark.parametrize("colour", [False, True])
def test_tensors_are_described_as_arrays_are(dtype: torch.dtype, colour: bool) -> None:
    image = torch.from_numpy(crop(5, 50, 60)).to(dtype)
    image, axis = (image, -1) if colour else (image[..., 0], None)
    for root in (False, True):
        result = hog(image, visualize=True, transform_sqrt=root, channel_axis=axis)
        expected = hog(image.numpy(), visualize=True, transform_sqrt=root, channel_axis=axis)
        for ours, theirs in zip(result, expected, strict=True):
            assert_array_equal(ours.numpy(), theirs)
            assert ours.numpy().dtype == theirs.dtype


@pytest.mark.slow
@pytest.mark.parametrize("norm", NORMS)
def test_tensors_have_derivatives(norm: str) -> None:
    image = torch.rand(6, 8, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0)).requires_grad_()

    def both(values: torch.Tensor) -> torch.Tensor:
        options = {"pixels_per_cell": (3, 4), "cells_per_block": (2, 1), "channel_axis": -1, "visualize": True}
        descriptor, picture = hog(values, block_norm=norm, transform_sqrt=True, **options)
        return torch.cat([descriptor, picture.flatten()])

    assert torch.autograd.gradcheck(both, image)
    expected = torch.autograd.functional.jacobian(both, image)
    torch.testing.assert_close(torch.func.jacrev(both)(image.detach()), expected)
    torch.testing.assert_close(torch.func.jacfwd(both)(image.detach()), expected)


REFUSED: dict[str, tuple[Any, dict[str, Any], str]] = {
    "three dimensions": (np.zeros((32, 32, 3)), {}, "two spatial dimensions"),
    "no channels": (np.zeros((32, 32)), {"channel_axis": -1}, "two spatial dimensions"),
    "0 channels": (np.zeros((32, 32, 0)), {"channel_axis": -1}, "at least one channel"),
    "two axes": (np.zeros((32, 32, 3)), {"channel_axis": (-1, 0)}, "channel_axis must be an integer"),
    "no block": (np.zeros((23, 40)), {}, "at least: 24 rows and 24 cols"),
    "complex": (np.zeros((32, 32), complex), {}, "must be real"),
    "norm": (np.zeros((32, 32)), {"block_norm": "L3"}, "block_norm must be one of"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refusals(case: str) -> None:
    """One sentence where scikit-image, too, raises ValueError."""
    image, options, words = REFUSED[case]
    with pytest.raises(ValueError, match=words):
        hog(image, **options)
    with pytest.raises(ValueError, match=words):
        hog(torch.from_numpy(image), **options)
    with pytest.raises(ValueError):  # noqa: PT011, its words are its own
        feature.hog(image, **options)


def test_tensors_that_the_loops_cannot_read_are_refused_by_its_own_word() -> None:
    with pytest.raises(TypeError, match=r"^image must be a dense tensor, got torch.sparse_coo: write tensor.to_dense"):
        hog(torch.rand(32, 32).to_sparse())


# arguments that nobody would think of: the same result, or an error of the same kind
ODD: dict[str, dict[str, Any]] = {
    "1 orientation": {"orientations": 1},
    "floats": {"pixels_per_cell": (8.0, np.float64(6))},
    "lists": {"pixels_per_cell": [8, 6], "cells_per_block": [2, 2]},
    "one number": {"pixels_per_cell": 8},
    "a truth value as number": {"feature_vector": 0, "visualize": 1, "transform_sqrt": 1},
    "too high an axis": {"channel_axis": 3},
    "another norm": {"block_norm": "l2"},
    "too few cells": {"cells_per_block": (6, 6)},
}


@pytest.mark.parametrize("colour", [False, True])
@pytest.mark.parametrize("case", ODD)
def test_odd_arguments_have_the_same_outcome(case: str, colour: bool) -> None:
    image = crop(7, 40, 48) if colour else crop(7, 40, 48)[..., 1]
    outcomes = []
    for f in (hog, feature.hog):
        options = {"channel_axis": -1 if colour else None, **ODD[case]}
        try:
            outcomes.append(f(image, **options))
        except (TypeError, ValueError) as error:
            outcomes.append(error)
    ours, theirs = outcomes
    if isinstance(theirs, Exception):
        assert isinstance(ours, type(theirs))
        if "small" in str(theirs):
            assert str(ours) == str(theirs)
        return
    assert not isinstance(ours, Exception), ours
    for mine, original in zip(*(o if isinstance(o, tuple) else (o,) for o in outcomes), strict=True):
        assert mine.shape == original.shape
        assert_allclose(mine, original, rtol=0, atol=TOLERANCE * max(1.0, np.abs(original).max()))


@pytest.mark.parametrize("root", [False, True])
@pytest.mark.parametrize("colour", [False, True])
def test_masked_arrays(colour: bool, root: bool) -> None:
    image = crop(8, 40, 48).astype(float)
    masked = np.ma.masked_array(image, image > 128) if colour else np.ma.masked_array(image, image > 128)[..., 0]
    assert_same(masked, channel_axis=-1 if colour else None, transform_sqrt=root)
    filled = feature.hog(masked.filled(0), channel_axis=-1 if colour else None, transform_sqrt=root)
    assert np.abs(hog(masked, channel_axis=-1 if colour else None, transform_sqrt=root) - filled).max() > 0.01
