"""Presets: their arguments, their sizes, and what they have in common."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch.testing import assert_close

from nablahog.hog import BlockNorm, FourBlockNorm, HOGSpec, hog, presets
from nablahog.hog.normalizers import Outside, Part

from .zoo import PRESETS, SPECS, fits, integers, noise, spec

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


@pytest.mark.parametrize("name", SPECS)
def test_parts_add_up(name: str) -> None:
    s = SPECS[name]
    if isinstance(s.normalizer, FourBlockNorm):
        lengths = [s.normalizer.channels_of(part, s.bins, s.signed) for part in s.normalizer.parts]
        assert s.colours * sum(lengths) == s.channels


def test_presets_take_one_cell_size_or_two() -> None:
    assert presets.paper(5) == presets.paper((5, 5))
    assert presets.uoctti((4, 7)).cell_size == (4, 7)
    assert presets.aubry(5) == presets.aubry((5, 5)) == presets.aubry()


@given(pixels=st.integers(1, 500), cell=st.integers(1, 40))
def test_number_of_cells(pixels: int, cell: int) -> None:
    for rule, exact in {
        "floor": math.floor(pixels / cell),
        "round": math.floor((pixels + cell // 2) / cell),
        "ceil": math.ceil(pixels / cell),
    }.items():
        s = spec(cell_size=(cell, 1), partial_cells=rule)
        if exact:
            assert s.grid(pixels, 3) == (exact, 3)
        else:
            with pytest.raises(ValueError, match="at least one cell"):
                s.grid(pixels, 3)


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


@pytest.mark.parametrize(
    ("s", "size", "message"),
    [
        (
            presets.dpm(),
            (19, 100),
            "an image of 19x100 pixels (height x width) has 2x13 cells, too few for a dpm descriptor: it leaves the "
            "outermost out, and needs at least 3x3",
        ),
        (
            presets.seeing3d(),
            (100, 12),
            "an image of 100x12 pixels (height x width) has 20x2 cells, too few for a seeing3d descriptor: it leaves "
            "the outermost out, and needs at least 3x3",
        ),
        (
            presets.skimage(),
            (24, 23),
            "an image of 24x23 pixels (height x width) has 3x2 cells, too few for a skimage descriptor: "
            "a block has 3x3",
        ),
        (
            presets.skimage(cells_per_block=(4, 1)),
            (8, 80),
            "an image of 8x80 pixels (height x width) has 1x10 cells, too few for a skimage descriptor: "
            "a block has 4x1",
        ),
        (
            presets.opencv(),
            (16, 15),
            "the image must hold at least one block of 16x16 pixels (height x width), got an image of 16x15",
        ),
        (
            presets.dpm(),
            (3, 30),
            "the image must hold at least one cell of 8x8 pixels (height x width), got an image of 3x30",
        ),
    ],
)
def test_images_too_small(s: HOGSpec, size: tuple[int, int], message: str) -> None:
    for f in (lambda: s.grid(*size), lambda: hog(torch.zeros(1, 3, *size), s)):
        with pytest.raises(ValueError, match="image") as error:
            f()
        assert str(error.value) == message


def test_images_just_large_enough() -> None:
    assert presets.dpm().grid(20, 20) == presets.dlib().grid(20, 20) == (1, 1)  # two cells and a half are three
    assert presets.skimage().grid(24, 31) == (1, 1)
    assert presets.opencv().grid(16, 23) == (1, 1)


# --- arguments -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"win_size": (64, 130)},
            "along the height, a block must be whole cells, .* a window of 130, a block of 16,",
        ),
        (
            {"win_size": (60, 128)},
            "along the width, .* got a window of 60, a block of 16, a stride of 8 and a cell",
        ),
        ({"block_size": (16, 12)}, "along the height, .* a block of 12, a stride of 8 and a cell of 8 pixels"),
        ({"block_size": (128, 16)}, "along the width, .* a window of 64, a block of 128"),
        ({"cell_size": (0, 8)}, "along the width, .* a cell of 0 pixels"),
        ({"block_stride": (8, 0)}, "along the height, .* a stride of 0 and"),
    ],
)
def test_opencv_refuses_sizes(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
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


@pytest.mark.parametrize("outside", ["repeat", "drop", "missing"])
@pytest.mark.parametrize("vote", ["linear", "hard"])
@pytest.mark.parametrize("floor", [False, True])
def test_unsigned_bins_have_the_undirected_channels_of_signed_ones(outside: Outside, vote: str, floor: bool) -> None:
    parts: tuple[Part, ...] = ("undirected", "texture", "blocks")
    for bins, offset in ((9, 0.0), (5, 0.5)):
        scheme = FourBlockNorm(epsilon=0.1, parts=parts, outside=outside, floor=floor)
        fields = {"vote": vote, "bin_offset": offset, "normalizer": scheme, "colour": "largest"}
        unsigned, signed = spec(bins=bins, **fields), spec(bins=2 * bins, signed=True, **fields)
        for image in (noise(2, 3, 17, 14), integers(2, 3, 17, 14, levels=3)):
            assert_close(hog(image, unsigned), hog(image, signed), rtol=0, atol=1e-12)


def test_parts_are_channels_of_the_whole() -> None:
    image = integers(1, 3, 30, 35)
    whole = hog(image, presets.dpm(5))
    for parts, channels in {
        ("directed",): range(18),
        ("undirected",): range(18, 27),
        ("undirected", "zero"): [*range(18, 27), 31],
        ("directed", "texture"): [*range(18), *range(27, 31)],
    }.items():
        normalizer = dataclasses.replace(presets.dpm().normalizer, parts=parts)
        result = hog(image, dataclasses.replace(presets.dpm(5), normalizer=normalizer))
        assert torch.equal(result, whole[..., list(channels)])
    assert (whole[..., 31] == 0).all()


def test_dpm_and_dlib_differ_in_cut_cells_and_ties_only() -> None:
    image = noise(1, 3, 40, 48)
    assert_close(hog(image, presets.dpm())[..., :31], hog(image, presets.dlib()), rtol=0, atol=1e-12)
    cut = noise(1, 3, 38, 45)
    assert (hog(cut, presets.dpm())[..., :31] - hog(cut, presets.dlib())).abs().max() > 1e-3
    tied = integers(1, 3, 40, 48, levels=2)
    assert (hog(tied, presets.dpm())[..., :31] - hog(tied, presets.dlib())).abs().max() > 1e-3


def test_dpm_in_the_middle_of_a_continuous_image_is_piotrs() -> None:
    """Whose boundaries, borders and outermost cells are others, and images in 0…1; see the preset."""
    image = noise(1, 3, 48, 56)
    exact = dataclasses.replace(presets.dpm(), directions="float32")
    piotr = dataclasses.replace(presets.piotr(), value_range=255.0)
    assert_close(hog(image, piotr)[:, 2:-2, 2:-2], hog(image, exact)[:, 1:-1, 1:-1], rtol=0, atol=1e-12)


def test_vlfeat_is_uoctti() -> None:
    image = integers(1, 3, 30, 35)
    for cell_size, orientations in ((8, 9), (5, 6)):
        ours = presets.uoctti(cell_size, orientations=orientations, vote="hard")
        theirs = presets.vlfeat(cell_size=cell_size, orientations=orientations)
        assert torch.equal(hog(image, ours), hog(image, theirs))
        linear = presets.uoctti(cell_size, orientations=orientations)
        bilinear = presets.vlfeat(cell_size=cell_size, orientations=orientations, bilinear_orientations=True)
        assert_close(hog(image, linear), hog(image, bilinear), rtol=0, atol=1e-3)


@pytest.mark.parametrize("name", PRESETS)
def test_linear_votes_are_continuous(name: str) -> None:
    """What ``with_linear_votes`` is for: a small change of the image makes a small one of the descriptor."""
    s = PRESETS[name]().with_linear_votes()
    assert (s.vote, s.angle) == ("linear", "exact")
    s = dataclasses.replace(s, colour="gray" if s.colour == "largest" else s.colour, gamma="none")
    image, change = integers(1, 3, *s.image_size(2, 2), levels=4), noise(1, 3, *s.image_size(2, 2))
    assert (hog(image + 1e-7 * change, s) - hog(image, s)).abs().max() < 1e-4
