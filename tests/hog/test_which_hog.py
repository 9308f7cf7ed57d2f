"""What docs/which_hog.md says of lengths and of values."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from skimage import data
from torch import Tensor

from docs.preset_tables import SPECS
from nablahog.hog import FourBlockNorm, HOGSpec, hog, presets
from nablahog.hog.layout import native_shape
from nablahog.hog.normalizers.unclip import unclip, unclip_exactly
from nablahog.invert.candidates import Candidate
from nablahog.invert.exactness import find_tolerance, identities_that_hold
from nablahog.io.descriptor_file import FittedLayout

TEXT = (Path(__file__).parents[2] / "docs" / "which_hog.md").read_text(encoding="utf-8")
TWO_BY_TWO = presets.skimage(cells_per_block=(2, 2))


def table(heading: str) -> list[list[str]]:
    """The rows of the first table behind a heading, or words, of the page."""
    lines = TEXT[TEXT.index(heading) :].splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("|"))
    rows = []
    for line in lines[first + 2 :]:
        if not line.startswith("|"):
            break
        rows.append([cell.strip() for cell in line.strip("|").split("|")])
    return rows


def described(name: str, spec: HOGSpec) -> Tensor:
    """The descriptor (rows, cols, channels) of a part of a photograph of scikit-image."""
    picture = getattr(data, name)()[44:236, 60:252]
    image = torch.from_numpy(np.atleast_3d(picture)).permute(2, 0, 1).double() / 255
    return hog(image[None], spec)[0]


def test_lengths() -> None:
    by_length = {
        3780: [((128, 64), presets.opencv()), ((128, 64), TWO_BY_TWO)],
        6804: [((128, 64), presets.skimage())],
        1764: [((64, 64), presets.opencv()), ((64, 64), TWO_BY_TWO), ((128, 128), SPECS["seeing3d"])],
        324: [((32, 32), spec) for spec in (presets.opencv(), TWO_BY_TWO, presets.skimage())],
        8100: [((128, 128), presets.opencv()), ((128, 128), TWO_BY_TWO)],
        15876: [((128, 128), presets.skimage())],
        26244: [((224, 224), presets.opencv())],
        54756: [((224, 224), presets.skimage())],
        3968: [((128, 64), SPECS["vlfeat"])],
        2604: [((128, 64), SPECS["dlib"])],
        2688: [((128, 64), SPECS["dpm"])],
        4096: [((128, 64), SPECS["piotr"])],
        3456: [((128, 64), SPECS["cnn_hog"]), ((128, 64), SPECS["maskfeat"])],
        7560: [((128, 64), presets.opencv(nbins=18, signed=True))],
    }
    for length, cases in by_length.items():
        assert {math.prod(native_shape(spec, size)) for size, spec in cases} == {length}
    assert {int(number) for row in table("Common lengths") for number in row[0].split(", ")} == by_length.keys()


@pytest.mark.parametrize("name", ["astronaut", "camera"])
def test_values(name: str) -> None:
    for preset in ("vlfeat", "dpm", "dlib", "piotr", "cnn_hog", "aubry", "seeing3d"):
        assert described(name, SPECS[preset])[..., :27].max().item() == pytest.approx(0.4, abs=1e-6)
    assert described(name, presets.vlfeat("dalaltriggs")).max().item() == pytest.approx(0.2)
    for preset in ("vlfeat", "uoctti", "dpm", "dlib", "piotr"):
        result = described(name, SPECS[preset])
        directed, undirected, texture = result[..., :18], result[..., 18:27], result[..., 27:31]
        vlfeat = (texture.sum(2) * 18**0.5 - 2 * undirected.sum(2)).abs().max()
        dpm = (texture.sum(2) / 0.2357 - 2 * directed.sum(2)).abs().max()
        right, wrong = (vlfeat, dpm) if preset in ("vlfeat", "uoctti") else (dpm, vlfeat)
        assert right < 1e-6
        assert wrong > 1


@pytest.mark.slow
def test_cells_that_have_settled_are_left_out_of_later_rounds() -> None:
    """What is found is that of all rounds for all cells; cells of two images, in several parts."""
    generator = torch.Generator().manual_seed(0)
    histograms = torch.rand(2, 18, 9, 70, generator=generator, dtype=torch.float64).square()
    clipped = (histograms[:, None] * (0.3 + torch.rand(2, 4, 1, 9, 70, generator=generator))).clamp(max=0.2)
    summed, totals = clipped.sum(1) / 2, clipped.sum(2)
    for exact, expected in zip(unclip_exactly(summed, totals, 0.2, 60), unclip(summed, totals, 0.2, 60), strict=True):
        assert exact.shape == expected.shape
        torch.testing.assert_close(exact, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", SPECS)
def test_bounds_that_other_numbers_keep_too_decide_nothing(name: str) -> None:
    array = described("astronaut", SPECS[name]).float().numpy()
    candidate = Candidate(name, {}, SPECS[name], FittedLayout("cells", array.shape, (192, 192)))
    holding = identities_that_hold(array, candidate, find_tolerance(array))
    assert holding is not None
    bounds = ("no entry but", "no entry at", "add up to at most", "entries of blocks are equal")
    assert not [identity.sentence for identity in holding if any(words in identity.sentence for words in bounds)]


@pytest.mark.parametrize("name", sorted(SPECS.keys() - {"skimage", "dalal_triggs"} | {"dalaltriggs"}))
def test_what_is_so_even_that_nothing_is_clipped_is_excluded_by_no_identity(name: str) -> None:
    """But by those of L2-Hys blocks whose ε tells nothing: of photographs, some of these are clipped."""
    spec = presets.vlfeat("dalaltriggs") if name == "dalaltriggs" else SPECS[name].single_colour
    histograms = 1 + 0.1 * torch.rand(1, spec.bins, 6, 7, dtype=torch.float64)
    channels = spec.normalizer.normalize(histograms, spec.signed)
    for identity in spec.normalizer.identities(channels, spec.bins, spec.signed, 1e-6):
        if identity.errors.numel():
            assert (identity.errors.abs() <= 1e-6).double().mean() >= identity.share, identity.sentence


@pytest.mark.parametrize(
    ("name", "bins", "which"),
    [("vlfeat", 18, "19 … 27"), ("vlfeat", 16, "of all orientations"), ("dpm", 16, "of all directions")],
)
def test_texture_adds_up_to_channels_that_are_named(name: str, bins: int, which: str) -> None:
    spec = replace(SPECS[name], bins=bins)
    array = described("astronaut", spec).float().numpy()
    candidate = Candidate(name, {}, spec, FittedLayout("cells", array.shape, (192, 192)))
    holding = identities_that_hold(array, candidate, find_tolerance(array)) or []
    assert f"texture adds up to the sum of channels {which}" in [identity.sentence for identity in holding]


@pytest.mark.parametrize("name", [name for name in SPECS if isinstance(SPECS[name].normalizer, FourBlockNorm)])
def test_what_has_a_scale_does_not_hold_of_twice_the_numbers(name: str) -> None:
    """And what has none does."""
    spec = SPECS[name]
    channels = described("astronaut", spec).permute(2, 0, 1)[None]
    once, twice = (spec.normalizer.identities(times * channels, spec.bins, spec.signed, 1e-6) for times in (1, 2))
    for identity, doubled in zip(once, twice, strict=True):
        right, still = ((each.errors.abs() <= 1e-5).double().mean() for each in (identity, doubled))
        if not identity.is_bound:
            assert (still > 0.99 * right) == (not identity.has_scale), identity.sentence


def test_opposite_directions_add_up_below_half_the_clip() -> None:
    """It is noticed if two entries do not, in a cell whose sum is right, both between a third and half of the clip."""
    array, spec = described("astronaut", SPECS["uoctti"]).float().numpy(), SPECS["uoctti"]
    candidate = Candidate("uoctti", {}, spec, FittedLayout("cells", array.shape, (192, 192)))
    undirected = array[..., 18:27]
    between = (undirected > 0.075) & (undirected < 0.095)
    row, col = np.argwhere(between.sum(axis=2) >= 2)[0]
    one, other = np.flatnonzero(between[row, col])[:2]
    assert identities_that_hold(array, candidate, find_tolerance(array)) is not None
    undirected[row, col, one] += 0.002
    undirected[row, col, other] -= 0.002
    assert identities_that_hold(array, candidate, find_tolerance(array)) is None
