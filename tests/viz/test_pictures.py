"""Glyphs point the right way; sheets hold what they should."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

import nablahog
from nablahog import HOGSpec, presets
from nablahog.hog import FourBlockNorm
from nablahog.viz import pictures
from nablahog.viz.pictures import RED, Panel, contact_sheet, difference, edge_votes, fade_unsure, glyphs, outlined

SIZE = 96


def _step(angle: float) -> torch.Tensor:
    """(1, 1, SIZE, SIZE): a soft edge through the middle whose gradient points to ``angle``, degrees from x to y."""
    y, x = torch.meshgrid(torch.arange(SIZE) - (SIZE - 1) / 2, torch.arange(SIZE) - (SIZE - 1) / 2, indexing="ij")
    across = x * math.cos(math.radians(angle)) + y * math.sin(math.radians(angle))
    return torch.sigmoid(across / 2)[None, None]


def _line_direction(picture: NDArray[np.float64]) -> float:
    """Direction of the longest axis of the bright pixels, degrees from x to y, in [0, 180)."""
    y, x = np.indices(picture.shape)
    covariance = np.cov(np.stack([x.ravel(), y.ravel()]), aweights=picture.ravel())
    dx, dy = np.linalg.eigh(covariance)[1][:, 1]
    return math.degrees(math.atan2(dy, dx)) % 180


EVERY = {
    **{name: getattr(presets, name)() for name in presets.__all__},
    "paper-oblong": presets.paper((8, 4)),
    "uoctti-hard": presets.uoctti(vote="hard"),
    "vlfeat-dalaltriggs": presets.vlfeat("dalaltriggs"),
    "skimage-oblong": presets.skimage(8, (6, 8), (2, 1), "L1-sqrt"),
    "opencv-stride": presets.opencv((96, 96), (24, 24), (6, 4), (12, 12), signed=True, nbins=16),
    "maskfeat-even": presets.maskfeat(nbins=8),
    "uoctti-separate": presets.uoctti(colour="separate"),
    "signed-blocks": dataclasses.replace(presets.uoctti(), normalizer=FourBlockNorm(parts=("blocks",))),
    "directed": dataclasses.replace(presets.uoctti(), normalizer=FourBlockNorm(parts=("directed", "texture"))),
}


@pytest.mark.parametrize("name", EVERY)
def test_every_dialect_shows_the_edge(name: str) -> None:
    """In the middle of the image, whose cells the picture shows, a stroke lies along the edge."""
    for gradient in (0, 65, 155, 205):
        check_stroke(EVERY[name], gradient)


def check_stroke(spec: HOGSpec, gradient: int) -> None:
    picture = glyphs(nablahog.hog(_step(gradient), spec)[0], spec, cell_pixels=33)
    wide = round(33 * spec.cell_size[1] / spec.cell_size[0])
    rows, cols = picture.shape[0] // 33, picture.shape[1] // wide
    covered = [n * side for n, side in zip((rows, cols), spec.cell_size, strict=True)]
    assert all(SIZE - side < n < SIZE + side for n, side in zip(covered, spec.cell_size, strict=True))
    cell = picture[rows // 2 * 33 : (rows // 2 + 1) * 33, cols // 2 * wide : (cols // 2 + 1) * wide]
    if wide != 33:
        cell = cell[:, (wide - 33) // 2 : (wide - 33) // 2 + 33]
    bin_width = 180 / (spec.bins // 2 if spec.signed else spec.bins)
    error = abs((_line_direction(cell) - gradient) % 180 - 90)
    assert error <= bin_width / 2 + 2


def test_cells_that_are_left_out_are_black() -> None:
    spec = presets.dpm()
    descriptor = torch.ones(3, 4, spec.channels)
    picture = glyphs(descriptor, spec, cell_pixels=10)
    assert picture.shape == (50, 60)
    assert picture[10:40, 10:50].reshape(3, 10, 4, 10).max(axis=(1, 3)).min() > 0.9
    picture[10:40, 10:50] = 0
    assert not picture.any()


def test_a_cell_is_the_mean_over_its_blocks_and_colours() -> None:
    spec = presets.skimage(cells_per_block=(1, 2))
    descriptor = torch.zeros(1, 2, 1, 2, 9)
    descriptor[0, :, 0, :, 4] = torch.tensor([[1.0, 2.0], [6.0, 3.0]])
    votes, _ = edge_votes(descriptor.flatten(2), spec)
    assert votes[0, :, 4].tolist() == [1, 4, 3]
    colours = torch.zeros(2, 2, 3, 9)
    colours[0, 1, :, 2] = torch.tensor([1.0, 2.0, 6.0])
    votes, angles = edge_votes(colours.flatten(2), presets.maskfeat())
    assert votes[0, 1].tolist() == [0, 0, 3, 0, 0, 0, 0, 0, 0]
    np.testing.assert_allclose(np.degrees(angles) % 180, (90 - 10 - np.arange(9) * 20) % 180)


def test_the_brightest_cells_are_white_and_others_in_proportion() -> None:
    descriptor = torch.ones(20, 20, 9)
    descriptor[0, 0], descriptor[1, 1] = 50, 0.5
    picture = glyphs(descriptor, presets.paper(), cell_pixels=5)
    assert (picture[2::5, 2::5].max(), picture[7, 7]) == (1, 0.5)
    with_gradient = descriptor.clone().requires_grad_()
    assert np.array_equal(glyphs(with_gradient, presets.paper(), cell_pixels=5), picture)


def test_values_below_0_are_drawn_as_0() -> None:
    spec = presets.skimage(cells_per_block=(1, 1), block_norm="L1-sqrt")
    assert not glyphs(-torch.ones(1, 1, 9), spec).any()
    assert glyphs(torch.ones(1, 1, 9), spec).any()


def test_cells_of_overlapping_blocks_are_one() -> None:
    spec = presets.opencv((24, 16))  # a row of two blocks, of three columns of cells
    votes, angles = edge_votes(torch.ones(1, 2, 36), spec)
    assert votes.shape == (2, 3, 9)
    np.testing.assert_allclose(votes, votes.mean(), rtol=0.2)  # the Gaussian of a block is taken out again
    np.testing.assert_allclose(np.degrees(angles), np.arange(9) * 20 + 10)


def test_four_block_descriptors_show_their_undirected_channels() -> None:
    spec = presets.uoctti()
    descriptor = torch.zeros(1, 1, 31)
    descriptor[..., :18] = 1
    descriptor[..., 27:] = 1
    assert not glyphs(descriptor, spec).any()
    votes, angles = edge_votes(torch.arange(31.0).reshape(1, 1, 31), spec)
    assert votes.ravel().tolist() == list(range(18, 27))
    np.testing.assert_allclose(np.degrees(angles), np.arange(9) * 20)
    votes, angles = edge_votes(torch.arange(9.0).reshape(1, 1, 9), presets.aubry())
    assert votes.ravel().tolist() == list(range(9))
    np.testing.assert_allclose(np.degrees(angles), np.arange(9) * 20)
    _, angles = edge_votes(torch.zeros(1, 1, 9), presets.paper())
    np.testing.assert_allclose(np.degrees(angles), np.arange(9) * 20 + 10)


def test_odd_descriptors() -> None:
    assert not glyphs(torch.zeros(2, 2, 9), presets.paper()).any()
    assert not glyphs(-torch.ones(2, 2, 9), presets.paper()).any()
    with pytest.raises(ValueError, match=r"\(rows, cols, 9\), got \(2, 2, 31\)$"):
        glyphs(torch.zeros(2, 2, 31), presets.paper())
    with pytest.raises(TypeError, match=r"got a path: write nablahog\.load_descriptor"):
        glyphs("descriptor.npz", "paper")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="cell_pixels"):
        glyphs(torch.zeros(2, 2, 9), presets.paper(), cell_pixels=0)


def test_an_image_is_gray_where_it_is_not_sure_what_is_bright() -> None:
    image, confidence = np.array([[1.0, 0.0, 1.0, 0.0]]), np.array([[0.9, 0.8, 0.65, 0.4]])
    np.testing.assert_allclose(fade_unsure(image, confidence, 0.8), [[1, 0, 0.75, 0.5]])


def test_difference() -> None:
    a = np.array([[0.0, 1.0, 0.3]])
    np.testing.assert_allclose(difference(a, np.array([[1.0, 0.0, 0.3]])), [[0, 1, 0.5]])
    with pytest.raises(ValueError, match="one shape"):
        difference(a, a.T)


def test_an_outline() -> None:
    picture = np.full((1, 12, 12), 0.5)
    inside = np.zeros((12, 12), bool)
    inside[4:, 4:8] = True
    drawn = outlined(picture, inside)
    changed = (drawn != 0.5).any(axis=0)
    assert drawn.shape == (3, 12, 12)
    assert changed[4:, 3].all()
    assert changed[3, 4:8].all()
    assert changed[4:, 4].all()
    assert not changed[6:, 5:7].any()  # inside, and where the object leaves the picture
    assert not changed[:3].any()
    assert drawn[:, 6, 4].tolist() == list(RED)


def test_contact_sheet() -> None:
    red = torch.tensor([1.0, 0, 0])[:, None, None].expand(3, 10, 20)
    rows = [[Panel(red, "red"), Panel(np.zeros((40, 20)), "black, a long caption")], [Panel(red, "red again")]]
    sheet = contact_sheet(rows, height=40, margin=5)
    assert sheet.width == 5 + 80 + 5 + 20 + 5
    pixels = np.asarray(sheet).reshape(-1, 3)
    assert (pixels == [255, 0, 0]).all(1).sum() == 2 * 40 * 80
    assert (pixels == [255, 255, 255]).all(1).sum() > 1000
    assert contact_sheet([[Panel(np.zeros((64, 64)), "")]]).width == 8 + 256 + 8
    with pytest.raises(ValueError, match="at least one panel"):
        contact_sheet([[]])


def test_captions_that_fit_are_whole() -> None:
    class Font:
        getlength = staticmethod(len)

    assert [pictures._shorten(text, Font(), 4) for text in ("abc", "abcd", "abcde")] == ["abc", "abcd", "abc…"]  # type: ignore[arg-type]


def test_glyphs_in_strips_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pictures, "STRIP_PIXELS", 500)
    spec = presets.uoctti((8, 4))
    descriptor = torch.rand(5, 7, spec.channels)
    image = pictures.glyph_image(descriptor, spec, 12)
    assert (image.mode, image.size) == ("L", (7 * 6, 5 * 12))
    assert np.array_equal(np.asarray(image), np.rint(glyphs(descriptor, spec, 12) * 255))
    assert not np.asarray(pictures.glyph_image(torch.zeros(5, 7, spec.channels), spec, 12)).any()
