"""Shares: they add up, and say what is the case where that is known."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
import torch

from nablahog.dialects.common_form import Channels, same_channels
from nablahog.dialects.shapley import shapley
from nablahog.hog import BilinearCells, FourBlockNorm, HOGSpec, presets

from .common import CAT, SPECS, distance, percent, total


def _additive(worth: list[float]) -> list[float]:
    return [sum(itertools.compress(worth, taken)) for taken in itertools.product((0, 1), repeat=len(worth))]


@pytest.mark.parametrize("number", [1, 3, 10])
def test_of_a_game_without_interplay_each_has_its_worth(number: int) -> None:
    worth = [float(k * k - 3) for k in range(number)]
    assert shapley(_additive(worth), number) == pytest.approx(worth)


@pytest.mark.parametrize("number", [1, 4, 9])
def test_shares_add_up_to_the_whole(number: int) -> None:
    progress = np.random.default_rng(number).normal(size=2**number).tolist()
    assert sum(shapley(progress, number)) == pytest.approx(progress[-1] - progress[0])


def test_two_that_only_help_together_share_alike() -> None:
    assert shapley([0, 0, 0, 1], 2) == [0.5, 0.5]
    assert shapley([0, 0, 0, 0, 0, 0, 1, 1], 3) == pytest.approx([0.5, 0.5, 0])  # the first two have the highest bits


def test_a_figure_for_each_subset() -> None:
    with pytest.raises(ValueError, match="expected the values of 8 subsets of 3 players, got 7"):
        shapley([0.0] * 7, 3)


@pytest.mark.parametrize(
    ("a", "b"), [("dpm", "piotr"), ("skimage", "opencv"), ("aubry", "cnn_hog"), ("paper", "maskfeat")]
)
def test_shares_of_presets_add_up_to_the_squared_distance_either_way(a: str, b: str) -> None:
    there, back = distance(SPECS[a], SPECS[b]), distance(SPECS[b], SPECS[a])
    assert there.distance == pytest.approx(back.distance, rel=1e-6)
    assert total(there) == pytest.approx(there.distance**2, rel=1e-6)
    assert [each.convention.name for each in there.contributions] == [
        each.convention.name for each in back.contributions
    ]
    for one, other in zip(there.contributions, back.contributions, strict=True):
        assert one.value == pytest.approx(other.value, abs=1e-6)
        assert one.settings == other.settings[::-1]


VLFEAT, SKIMAGE, FOUR = SPECS["vlfeat"], SPECS["skimage"], FourBlockNorm()
ONE: dict[str, tuple[HOGSpec, HOGSpec]] = {
    "border": (VLFEAT, replace(VLFEAT, border="reflect")),
    "mask": (VLFEAT, replace(VLFEAT, mask="sobel")),
    "colour rule": (VLFEAT, replace(VLFEAT, colour="gray")),
    "colour ties": (VLFEAT, replace(VLFEAT, colour_ties="dlib")),
    "votes": (VLFEAT, replace(VLFEAT, vote="linear")),
    "bin ties": (VLFEAT, replace(VLFEAT, boundary="upper")),
    "bins": (VLFEAT, replace(VLFEAT, bin_offset=0.5)),
    "partial cells": (SKIMAGE, replace(SKIMAGE, partial_cells="ceil")),
    "pooling": (SKIMAGE, replace(SKIMAGE, pooling=BilinearCells())),
    "value range": (SPECS["aubry"], replace(SPECS["aubry"], value_range=255.0)),
    "ε": (SPECS["aubry"], replace(SPECS["aubry"], normalizer=FourBlockNorm(9.0, parts=("undirected",)))),
    "clip": (VLFEAT, replace(VLFEAT, normalizer=replace(FOUR, clip=0.1))),
    "outermost blocks": (VLFEAT, replace(VLFEAT, normalizer=replace(FOUR, outside="missing"))),
    "normaliser": (SKIMAGE, presets.skimage(cells_per_block=(2, 2))),
    "gamma": (SKIMAGE, replace(SKIMAGE, gamma="sqrt")),
}


@pytest.mark.parametrize("name", ONE)
def test_one_convention_has_it_all(name: str) -> None:
    result = distance(*ONE[name])
    assert result.distance > 1e-3
    (share,) = result.contributions
    assert share.convention.name == name
    assert share.value == pytest.approx(result.distance**2, rel=1e-6)


def test_dlib_and_dpm_differ_in_nothing_but_colour_ties() -> None:
    result = distance(SPECS["dpm"], SPECS["dlib"], image=CAT[..., :48, :64])
    assert percent(result) == {"colour ties": 100}
    gray = distance(SPECS["dpm"], SPECS["dlib"], image=CAT[:1, :48, :64])
    assert gray.same
    assert gray.contributions == []


def test_identical_specs_are_the_same() -> None:
    for name, spec in SPECS.items():
        result = distance(spec, replace(spec, name="another", layout="cells"))
        assert result.distance == 0, name
        assert result.same
        assert result.contributions == []
        assert (result.largest, result.rms) == (0, 0)


def test_vlfeat_and_dpm_differ_in_texture_alone() -> None:
    image = CAT[..., :48, :64]
    assert distance(SPECS["vlfeat"], SPECS["dpm"], image=image).same
    form = same_channels(SPECS["vlfeat"], SPECS["dpm"])
    assert form == Channels(("directed", "undirected", "texture"))
    result = distance(SPECS["vlfeat"], SPECS["dpm"], form, image)
    assert percent(result) == {"texture": 100}
    assert distance(SPECS["vlfeat"], SPECS["dpm"], Channels(("directed", "undirected")), image).same


def test_an_offset_and_a_sense_rename_bins() -> None:
    spec = replace(SPECS["skimage"], bins=18, bin_offset=0.0, boundary="first")
    for other in (replace(spec, bin_offset=9.0), replace(spec, counterclockwise=True)):
        assert distance(spec, other, image=CAT[:1]).distance < 0.1  # there are ties, and these go by the order of bins
        assert distance(*(replace(s, vote="linear") for s in (spec, other)), image=CAT[:1]).same


def test_nothing_is_as_far_from_something_as_its_length() -> None:
    flat = torch.zeros(1, 32, 32, dtype=torch.uint8)
    assert distance(SKIMAGE, SPECS["paper"], image=flat).distance == 0
    framed = distance(SPECS["cnn_hog"], replace(SPECS["cnn_hog"], border="reflect"), image=flat)
    assert framed.distance == pytest.approx(1)  # one sees an edge around what is nothing to the other
    assert percent(framed) == {"border": 100}
