"""The operator against the slow reference, over every option and awkward sizes."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import torch
from torch import Tensor

from nablahog.hog import FourBlockNorm, GlobalNorm, HOGSpec, hog, presets
from nablahog.hog.descriptor import histograms
from nablahog.hog.normalize import normalize
from nablahog.hog.orientation import votes

from . import reference
from .zoo import DOUBLE, SPECS, integers, noise, spec


def assert_equals_reference(images: Tensor, spec: HOGSpec) -> None:
    expected = np.stack([reference.hog(image.numpy(), spec) for image in images])
    actual = hog(images, spec)
    assert actual.dtype == images.dtype
    np.testing.assert_allclose(actual.numpy(), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
@pytest.mark.parametrize("name", SPECS)
def test_equals_reference(name: str, channels: int) -> None:
    assert_equals_reference(noise(1, channels, 14, 11), SPECS[name])


@pytest.mark.parametrize("name", SPECS)
def test_histograms_equal_reference(name: str) -> None:
    """In votes: a constant factor in the pooling would cancel in most normalisers."""
    images = noise(2, 3, 14, 11)
    expected = np.stack([reference.histograms(image.numpy(), SPECS[name]) for image in images])
    actual = histograms(images, SPECS[name]).permute(0, 2, 3, 1)
    np.testing.assert_allclose(actual.numpy(), expected, rtol=1e-12, atol=1e-12 * expected.max())


@pytest.mark.parametrize("name", SPECS)
def test_equals_reference_on_bytes(name: str) -> None:
    """Few grey levels: flat areas, ties between channels, gradients on the boundaries of hard bins."""
    assert_equals_reference(integers(1, 3, 12, 12, levels=4), SPECS[name])


@pytest.mark.parametrize("border", ["reflect", "replicate", "zero", "ignore"])
@pytest.mark.parametrize("partial_cells", ["floor", "round", "ceil"])
@pytest.mark.parametrize("cell_size", [(3, 5), (4, 2), (1, 1)])
def test_borders_and_partial_cells(border: str, partial_cells: str, cell_size: tuple[int, int]) -> None:
    assert_equals_reference(noise(1, 1, 10, 12), spec(border=border, partial_cells=partial_cells, cell_size=cell_size))


@pytest.mark.parametrize("border", ["reflect", "replicate", "zero", "ignore"])
@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (2, 2), (2, 7), (3, 1)])
def test_images_of_few_rows(border: str, shape: tuple[int, int]) -> None:
    assert_equals_reference(noise(2, 2, *shape), spec(border=border, cell_size=(1, 1)))
    assert_equals_reference(noise(2, 2, *shape), spec(border=border, cell_size=(1, 4), partial_cells="ceil"))


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (3, 2), (4, 4)])
@pytest.mark.parametrize("vote", ["linear", "hard"])
def test_uoctti_of_few_rows(shape: tuple[int, int], vote: str) -> None:
    assert_equals_reference(noise(1, 3, *shape), presets.uoctti(1, vote=vote))


@pytest.mark.parametrize(("height", "width"), [(4, 4), (5, 4), (6, 6), (7, 9), (8, 8)])
def test_cells_larger_than_the_rest(height: int, width: int) -> None:
    """One cell, and every remainder that rounds up or down."""
    for rule, make in itertools.product(("floor", "round", "ceil"), (spec, _four_block)):
        assert_equals_reference(noise(1, 1, height, width), make(partial_cells=rule))


def _four_block(partial_cells: str) -> HOGSpec:
    return spec(signed=True, bins=8, partial_cells=partial_cells, normalizer=FourBlockNorm())


@pytest.mark.parametrize("bins", [3, 4, 9, 11])
@pytest.mark.parametrize("signed", [False, True])
@pytest.mark.parametrize("bin_offset", [0.0, 0.3, 0.5])
def test_linear_votes_of_any_direction(bins: int, signed: bool, bin_offset: float) -> None:
    """Every whole degree: bin centres, half-way points and the wrap at ±180° among them."""
    angles = torch.deg2rad(torch.arange(-180, 181, dtype=DOUBLE))
    gx, gy = 1.7 * angles.cos(), 1.7 * angles.sin()
    s = spec(bins=bins, signed=signed, bin_offset=bin_offset)
    actual = votes(gx.view(1, 1, -1), gy.view(1, 1, -1), s)[0, :, 0].T
    expected = np.stack([reference.vote(x, y, s) for x, y in zip(gx.tolist(), gy.tolist(), strict=True)])
    np.testing.assert_allclose(actual.numpy(), expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize("orientations", [4, 6, 9])
@pytest.mark.parametrize("signed", [False, True])
def test_hard_votes_on_bin_boundaries(orientations: int, signed: bool) -> None:
    """Integer gradients: with 9 orientations, vertical ones tie between two bins and the first must win."""
    s = spec(vote="hard", signed=signed, bins=2 * orientations if signed else orientations, bin_offset=0.0)
    g = torch.arange(-6, 7, dtype=DOUBLE)
    gx, gy = g.repeat_interleave(len(g)), g.repeat(len(g))
    actual = votes(gx.view(1, 1, -1), gy.view(1, 1, -1), s)[0, :, 0].T
    expected = np.stack([reference.vote(x, y, s) for x, y in zip(gx.tolist(), gy.tolist(), strict=True)])
    np.testing.assert_allclose(actual.numpy(), expected, rtol=1e-15, atol=0)


@pytest.mark.parametrize("scheme", [GlobalNorm(0.5), GlobalNorm(0.5, "robust")])
@pytest.mark.parametrize("scale", [0.0, 1e-9, 1.0, 1e6])
def test_global_norm_at_any_scale(scheme: GlobalNorm, scale: float) -> None:
    v = scale * noise(2, 9, 3, 2)
    expected = np.stack([reference.global_norm(one.numpy(), scheme) for one in v])
    np.testing.assert_allclose(normalize(v, spec(normalizer=scheme)).numpy(), expected, rtol=1e-13, atol=0)
