"""Presets: their arguments, their sizes, and what they have in common."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch.testing import assert_close

from nablahog.hog import BlockCells, BlockNorm, hog, presets

from .zoo import PRESETS, SPECS, fits, integers, noise

# --- channels and grid -----------------------------------------------------------------------------------------------


def test_channels() -> None:
    assert presets.paper().channels == 9
    assert presets.paper(bins=12).channels == 12
    assert presets.uoctti().channels == 31
    assert presets.uoctti(orientations=4).channels == 16
    assert presets.aubry().channels == 9
    assert presets.aubry(orientations=4).channels == 4
    assert presets.vlfeat(orientations=5).channels == 19
    assert presets.vlfeat("dalaltriggs", orientations=5).channels == 20
    assert presets.dpm().channels == presets.piotr().channels == 32
    assert presets.dlib().channels == 31
    assert presets.cnn_hog().channels == presets.maskfeat().channels == 27
    assert presets.seeing3d().channels == 9
    assert presets.skimage().channels == 81
    assert presets.opencv().channels == 36


@given(name=st.sampled_from(sorted(SPECS)), rows=st.integers(1, 6), cols=st.integers(1, 6))
def test_image_size_is_the_way_back(name: str, rows: int, cols: int) -> None:
    assert SPECS[name].grid(*SPECS[name].image_size(rows, cols)) == (rows, cols)


@given(name=st.sampled_from(sorted(SPECS)), height=st.integers(1, 40), width=st.integers(1, 40))
def test_grid_is_that_of_the_descriptor(name: str, height: int, width: int) -> None:
    s, image = SPECS[name], noise(1, 1, height, width)
    if fits(s, 1, height, width):
        assert hog(image, s).shape == (1, *s.grid(height, width), s.channels)
    else:
        with pytest.raises(ValueError, match=r"at least one (cell|block) of \d+x\d+ pixels|too few for a "):
            hog(image, s)


# --- arguments -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "axis"),
    [
        ({"win_size": (64, 130)}, "height"),
        ({"block_size": (16, 12)}, "height"),
        ({"block_size": (128, 16)}, "width"),
    ],
)
def test_opencv_refuses_sizes(arguments: dict[str, Any], axis: str) -> None:
    with pytest.raises(ValueError, match=f"^along the {axis}, a block must be whole cells"):
        presets.opencv(**arguments)


def test_presets_refuse() -> None:
    with pytest.raises(ValueError, match=r"^variant must be one of 'uoctti', 'dalaltriggs', got 'dt'$"):
        presets.vlfeat("dt")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"^cell_size must be at least 2: dlib makes another .* of one, got 1$"):
        presets.dlib(1)
    with pytest.raises(ValueError, match=r"^cell_size must be even, got 5$"):
        presets.cnn_hog(5)


def test_opencvs_sizes_are_width_and_height() -> None:
    s = presets.opencv((48, 64), (16, 24), (8, 4), (8, 6))
    assert s.cell_size == (6, 8)
    assert s.grid(64, 48) == (11, 5)
    assert isinstance(s.normalizer, BlockNorm)
    assert s.normalizer.block == (4, 2)


# --- what they have in common ----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_dpm_in_the_middle_of_a_continuous_image_is_piotrs() -> None:
    """Whose boundaries, borders and outermost cells are others, and images in 0…1; see the preset."""
    image = noise(1, 3, 48, 56)
    exact = dataclasses.replace(presets.dpm(), directions="float32")
    piotr = dataclasses.replace(presets.piotr(), value_range=255.0)
    assert_close(hog(image, piotr)[:, 2:-2, 2:-2], hog(image, exact)[:, 1:-1, 1:-1], rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", PRESETS)
def test_linear_votes_are_continuous(name: str) -> None:
    """What ``with_linear_votes`` is for: a small change of the image makes a small one of the descriptor."""
    s = PRESETS[name]().with_linear_votes()
    assert (s.vote, s.angle) == ("linear", "exact")
    s = dataclasses.replace(s, colour="gray" if s.colour == "largest" else s.colour, gamma="none")
    image, change = integers(1, 3, *s.image_size(2, 2), levels=4), noise(1, 3, *s.image_size(2, 2))
    assert (hog(image + 1e-7 * change, s) - hog(image, s)).abs().max() < 1e-4


@pytest.mark.parametrize("norm", ["L2-Hys", "L2", "L1-sqrt", "L1"])
def test_dalal_and_triggs_blocks(norm: Any) -> None:
    """Those of the paper's window: 7 x 15 blocks of 2x2 cells, σ of 8 pixels."""
    s = presets.dalal_triggs(norm=norm)
    assert (s.grid(128, 64), s.channels) == ((15, 7), 36)
    assert s.pooling == BlockCells((16, 16), (8, 8), 8.0)
    entries = hog(noise(1, 3, 128, 64), s).flatten(0, 2)
    length = entries.sum(1) if norm == "L1" else entries.square().sum(1).sqrt()
    assert_close(length, torch.ones_like(length), rtol=0, atol=0.02)  # but for ε
