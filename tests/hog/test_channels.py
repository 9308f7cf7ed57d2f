"""Channels of mirrored images and of other dialects, against the operator itself; and the order of OpenCV's vector."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor
from torch.testing import assert_close

from nablahog.hog import BilinearCells, BlockCells, BlockNorm, BoxCells, CellNorm, FourBlockNorm, HOGSpec, hog, presets
from nablahog.hog.channels import channel_names, convert_channels, mirrored_channels, reorder_texture
from nablahog.hog.layout import from_layout
from nablahog.hog.normalizers import PARTS

from .zoo import noise, spec

seeds = st.integers(0, 2**31 - 1)
small = st.integers(1, 4)


# --- names -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", presets.__all__)
def test_each_channel_has_a_name_of_its_own(name: str) -> None:
    spec = presets.BY_NAME[name]
    names = channel_names(name)
    assert len(names) == len({*names}) == spec.channels


def test_names_say_what_a_channel_is() -> None:
    assert channel_names("paper")[:2] == ("10°", "30°")
    assert channel_names("opencv")[-1] == "cell 1, 1 of the block: 170°"
    assert channel_names("dpm")[27:] == (
        *(f"texture: block {block}" for block in ("down-right", "up-right", "down-left", "up-left")),
        "always 0",
    )
    assert channel_names("maskfeat")[9] == "green, 80°"


# --- mirrored --------------------------------------------------------------------------------------------------------

# all of them at cells of 4; with a derivative across the border, where hard votes would tie
DIALECTS: dict[str, HOGSpec] = {
    "paper": presets.paper(4),
    "uoctti": presets.uoctti(4),
    "vlfeat": presets.vlfeat(cell_size=4),
    "vlfeat-dalaltriggs": presets.vlfeat("dalaltriggs", cell_size=4, orientations=7),
    "dpm": presets.dpm(4),
    "dlib": presets.dlib(4),
    "piotr": presets.piotr(4, orientations=6),
    "cnn-hog": presets.cnn_hog(4),
    "cnn-hogb": presets.cnn_hog(4, bilinear=True),
    "seeing3d": presets.seeing3d(4),
    "aubry": presets.aubry(4),
    "skimage": replace(presets.skimage(8, (4, 4), (2, 3), channel_axis=-1), border="replicate"),
    "maskfeat": replace(presets.maskfeat(4, gaussian_window=4), border="replicate"),
    # a Gaussian so wide that its middle does not matter, and angles that are not float32
    "opencv": replace(
        presets.opencv((16, 16), (8, 8), (4, 4), (4, 2), 10, win_sigma=1e9, gamma=False, signed=True), angle="exact"
    ),
}


def assert_mirrors(s: HOGSpec, image: Tensor) -> None:
    order = mirrored_channels(s)
    assert order is not None
    assert sorted(order) == list(range(s.channels))
    assert [order[k] for k in order] == list(range(s.channels))
    expected = hog(image, s).flip(2)[..., list(order)]
    assert_close(hog(image.flip(3), s), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", DIALECTS)
def test_mirrored_image_has_permuted_descriptor(name: str) -> None:
    for channels, (rows, cols) in itertools.product((1, 3), [(4, 4), (3, 5)]):
        assert_mirrors(DIALECTS[name], noise(1, channels, 4 * rows, 4 * cols, seed=rows))


@given(
    seed=seeds,
    rows=st.integers(3, 4),
    cols=st.integers(3, 5),
    parts=st.sampled_from(
        [p for n in range(1, 6) for p in itertools.combinations(PARTS, n) if {*p} & {*PARTS[:2], PARTS[3]}]
    ),
    texture=st.sampled_from(["vlfeat", "dpm"]),
    outside=st.sampled_from(["repeat", "drop", "missing"]),
    orientations=st.integers(3, 8),
    half=st.booleans(),
    counterclockwise=st.booleans(),
    colour=st.sampled_from(["gray", "largest", "separate"]),
    vote=st.sampled_from(["linear", "hard"]),
    unsigned=st.booleans(),
)
@settings(max_examples=60)
def test_every_four_block_normaliser(
    seed: int,
    rows: int,
    cols: int,
    parts: tuple,
    texture: str,
    outside: str,
    orientations: int,
    half: bool,
    counterclockwise: bool,
    colour: str,
    vote: str,
    unsigned: bool,
) -> None:
    scheme = FourBlockNorm(0.01, 0.3, parts, texture, outside)
    signed = scheme.needs_directed or not unsigned
    s = spec(
        normalizer=scheme,
        signed=signed,
        bins=2 * orientations if signed else orientations,
        bin_offset=0.5 if half else 0.0,
        counterclockwise=counterclockwise,
        colour=colour,
        vote=vote,
        border="replicate",
        cell_size=(3, 4),
    )
    assert_mirrors(s, noise(1, 3, 3 * rows, 4 * cols, seed=seed))


@given(
    seed=seeds,
    block=st.tuples(small, small),
    step=st.tuples(small, small),
    blocks=st.tuples(small, small),
    form=st.sampled_from(["L1", "L1-sqrt", "L2", "L2-Hys"]),
    separate=st.booleans(),
    mean=st.booleans(),
)
@settings(max_examples=30)
def test_every_block_normaliser(
    seed: int, block: tuple, step: tuple, blocks: tuple, form: str, separate: bool, mean: bool
) -> None:
    """Of blocks that cover the width."""
    rows, cols = ((n - 1) * s + b for n, s, b in zip(blocks, step, block, strict=True))
    s = spec(
        normalizer=BlockNorm(block, step, form, 0.01),
        pooling=BoxCells(mean=mean) if mean else BilinearCells(),
        colour="separate" if separate else "largest",
        bins=7,
        cell_size=(2, 3),
    )
    assert_mirrors(s, noise(1, 3, 2 * rows, 3 * cols, seed=seed))


@given(seed=seeds, signed=st.booleans(), offset=st.sampled_from([0, 0.5, 1, 2.5, 6]), bins=st.sampled_from([8, 10]))
def test_every_offset_of_half_a_bin(seed: int, signed: bool, offset: float, bins: int) -> None:
    s = spec(signed=signed, bin_offset=offset, bins=bins, colour="separate", normalizer=CellNorm())
    assert_mirrors(s, noise(1, 3, 8, 12, seed=seed))


def test_permutations_in_words() -> None:
    """As VLFeat states its own; DPM's texture, in its order, swaps others."""
    directed = (9, 8, 7, 6, 5, 4, 3, 2, 1, 0, 17, 16, 15, 14, 13, 12, 11, 10)
    undirected = (18, 26, 25, 24, 23, 22, 21, 20, 19)
    assert mirrored_channels(presets.vlfeat()) == (*directed, *undirected, 28, 27, 30, 29)
    assert mirrored_channels(presets.dpm()) == (*directed, *undirected, 29, 30, 27, 28, 31)
    assert mirrored_channels(presets.skimage(3, cells_per_block=(1, 2))) == (5, 4, 3, 2, 1, 0)
    assert mirrored_channels(presets.paper()) == (8, 7, 6, 5, 4, 3, 2, 1, 0)


@pytest.mark.parametrize(
    "s", [spec(bin_offset=0.25), spec(signed=True, bins=9, bin_offset=0.5, colour="separate")], ids=["quarter", "odd"]
)
def test_bins_that_are_not_mirrored_onto_bins(s: HOGSpec) -> None:
    assert mirrored_channels(s) is None


def test_opencvs_gaussian_is_not_in_the_middle() -> None:
    s = presets.opencv((64, 64), gamma=False)
    image = noise(1, 1, 64, 64)
    order = mirrored_channels(s)
    assert order is not None
    difference = (hog(image.flip(3), s) - hog(image, s).flip(2)[..., list(order)]).abs()
    assert 1e-3 < difference.max() < 0.1


# --- converted -------------------------------------------------------------------------------------------------------


def four(parts: tuple, texture: str = "vlfeat", **fields: object) -> HOGSpec:
    return replace(
        presets.uoctti(4, vote="hard"), name="test", normalizer=FourBlockNorm(parts=parts, texture=texture), **fields
    )


IMAGE = noise(2, 3, 24, 32)
LEFT = ("directed", "undirected")
OTHER_EPSILON = {"value_range": 255.0, "normalizer": FourBlockNorm(parts=("undirected",))}
EXACT: dict[str, tuple[HOGSpec, HOGSpec]] = {
    "the same": (presets.vlfeat(cell_size=4), presets.uoctti(4, vote="hard")),
    "without zero": (presets.dpm(4), presets.dlib(4)),
    "with zero": (presets.dlib(4), presets.dpm(4)),
    "without texture": (presets.vlfeat(cell_size=4), four(LEFT)),
    "one part": (presets.uoctti(4), replace(presets.aubry(4), **OTHER_EPSILON)),
    "sums of blocks": (presets.vlfeat("dalaltriggs", cell_size=4), four(("undirected", "texture"))),
    "unsigned": (four(("undirected", "blocks")), replace(presets.seeing3d(4), **OTHER_EPSILON)),
    "separate": (four(PARTS, "dpm", colour="separate"), four(("undirected", "texture"), "dpm", colour="separate")),
}


@pytest.mark.parametrize("case", EXACT)
def test_conversion_is_what_the_other_dialect_finds(case: str) -> None:
    source, target = EXACT[case]
    result = convert_channels(hog(IMAGE, source), source, target)
    assert_close(result, hog(IMAGE, target), rtol=0, atol=1e-12)


def test_histogram_channels_of_vlfeat_are_dpms_but_in_the_outermost_cells() -> None:
    vlfeat, dpm = presets.vlfeat(cell_size=4), presets.dpm(4)
    shared = replace(dpm, normalizer=FourBlockNorm(parts=(*LEFT, "zero"), outside="drop"))
    from_vlfeat = convert_channels(hog(IMAGE, vlfeat), vlfeat, shared)[:, 1:-1, 1:-1]
    from_dpm = convert_channels(hog(IMAGE, dpm), dpm, shared)
    assert_close(from_vlfeat, from_dpm, rtol=0, atol=1e-12)
    assert_close(from_dpm, hog(IMAGE, shared), rtol=0, atol=1e-12)


def test_conversion_keeps_any_leading_shape_and_is_linear() -> None:
    source, target = presets.dlib(), presets.dpm()
    descriptor = noise(31, dtype=torch.float32)
    result = convert_channels(descriptor, source, target)
    assert result.shape == (32,)
    assert result.dtype == torch.float32
    assert result[31] == 0
    assert torch.equal(convert_channels(descriptor.expand(2, 1, 4, 31), source, target)[1, 0, 3], result)
    assert torch.equal(convert_channels(3 * descriptor, source, target), 3 * result)


REFUSED: dict[str, tuple[HOGSpec, HOGSpec, str]] = {
    "VLFeat's texture to dlib's": (presets.vlfeat(), presets.dlib(), "the dpm texture channels of dlib cannot be made"),
    "DPM's texture to VLFeat's": (presets.dpm(), presets.vlfeat(), "the vlfeat texture channels of vlfeat cannot"),
    "directed": (presets.seeing3d(8), presets.dpm(), "the directed channels of dpm cannot be made"),
    "blocks": (presets.vlfeat(), presets.vlfeat("dalaltriggs"), "the blocks channels of vlfeat-dalaltriggs cannot"),
    "cells": (presets.vlfeat(), presets.vlfeat(cell_size=4), r"its cell_size is \(8, 8\), not \(4, 4\)"),
    "orientations": (presets.vlfeat(), presets.vlfeat(orientations=8), "its orientations is 9, not 8"),
    "votes": (presets.uoctti(), presets.dpm(), "its vote is 'linear', not 'hard'"),
    "clip": (presets.piotr(), presets.piotr(clip=0.3), "its clip is 0.2, not 0.3"),
    "no blocks": (presets.vlfeat(), presets.skimage(), "the channels of skimage are no directed"),
    "nor these": (presets.paper(), presets.vlfeat(), "the channels of paper are no directed"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_not_exact_is_refused(case: str) -> None:
    source, target, words = REFUSED[case]
    with pytest.raises(ValueError, match=words):
        convert_channels(torch.zeros(1, 2, 2, source.channels), source, target)


def test_wrong_shapes_are_refused() -> None:
    for shape in [(2, 30), ()]:
        with pytest.raises(ValueError, match="has 31 channels in its last dimension"):
            convert_channels(torch.zeros(shape), presets.vlfeat(), presets.vlfeat())


# --- texture ---------------------------------------------------------------------------------------------------------


def test_texture_in_the_other_order() -> None:
    """Of an image whose gradients all point down, directed histograms are undirected ones: both libraries' values."""
    image = (noise(1, 1, 24, 32) + 4 * torch.arange(24.0, dtype=torch.float64).unsqueeze(1)) / 100
    vlfeat, dpm = four((*LEFT, "texture")), four((*LEFT, "texture"), "dpm")
    ours, theirs = hog(image, vlfeat), hog(image, dpm)
    assert_close(ours[..., :27], theirs[..., :27], rtol=0, atol=1e-12)
    assert (ours[..., 27:] - theirs[..., 27:]).abs().max() > 0.01
    assert_close(reorder_texture(theirs, dpm)[..., 27:], ours[..., 27:], rtol=1e-4, atol=0)
    assert_close(reorder_texture(ours, vlfeat)[..., 27:], theirs[..., 27:], rtol=1e-4, atol=0)


@pytest.mark.parametrize(
    "s", [presets.dpm(), presets.vlfeat(), four(PARTS, colour="separate")], ids=["dpm", "vlfeat", "all"]
)
def test_reordering_twice_changes_nothing(s: HOGSpec) -> None:
    descriptor = noise(2, s.channels)
    once = reorder_texture(descriptor, s)
    assert int((once != descriptor).sum()) == 2 * 2 * s.colours
    assert torch.equal(reorder_texture(once, s), descriptor)


@pytest.mark.parametrize("s", [presets.aubry(), presets.paper()], ids=["aubry", "paper"])
def test_no_texture_no_order(s: HOGSpec) -> None:
    with pytest.raises(ValueError, match=r"no texture|are no directed"):
        reorder_texture(noise(1, s.channels), s)


# --- OpenCV's vector -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("row", "col"), [(4, 4), (20, 12), (60, 40), (123, 59), (76, 4)])
def test_where_opencvs_entries_are(row: int, col: int) -> None:
    """A bright pixel: gradients to the right and left of it in bins 0 and 8, above and below it in bin 4."""
    cv2 = pytest.importorskip("cv2")
    if not hasattr(cv2, "HOGDescriptor"):
        pytest.skip("OpenCV 5 has no HOG in its main package")
    image = np.zeros((128, 64), np.uint8)
    image[row, col] = 200
    vector = cv2.HOGDescriptor().compute(image)
    result = from_layout(torch.from_numpy(vector).unsqueeze(0), presets.opencv(), (128, 64))
    blocks = result.reshape(15, 7, 2, 2, 9)  # rows and columns of blocks, of cells in a block, bins

    expected = np.zeros((15, 7, 2, 2, 9), bool)
    votes = [(row, col - 1, (0, 8)), (row, col + 1, (0, 8)), (row - 1, col, (4,)), (row + 1, col, (4,))]
    for (y, x, bins), (i, j, k, m) in itertools.product(votes, np.ndindex(15, 7, 2, 2)):
        inside = 0 <= y - 8 * i < 16 and 0 <= x - 8 * j < 16
        near = abs(y - (8 * i + 8 * k + 3.5)) < 8 and abs(x - (8 * j + 8 * m + 3.5)) < 8
        if inside and near:
            expected[i, j, k, m, list(bins)] = True
    assert np.array_equal(blocks.numpy() > 1e-6, expected)

    for i, j, k, m, b in np.ndindex(blocks.shape):
        index = ((j * 15 + i) * 4 + m * 2 + k) * 9 + b  # blocks and cells column by column
        assert vector[index] == blocks[i, j, k, m, b]


def test_block_cells_are_not_bilinear_ones() -> None:
    """The spec of the test above is the one of votes that stay in their block."""
    assert isinstance(presets.opencv().pooling, BlockCells)
