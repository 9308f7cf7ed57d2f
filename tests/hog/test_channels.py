"""Channels by name, and of other dialects, against the operator itself."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch.testing import assert_close

from nablahog.hog import FourBlockNorm, HOGSpec, hog, presets
from nablahog.hog.channels import channel_names, convert_channels
from nablahog.hog.normalizers import PARTS

from .zoo import noise

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
    "texture": (presets.vlfeat(), presets.dlib(), "the dpm texture channels of dlib cannot"),
    "directed": (presets.seeing3d(8), presets.dpm(), "the directed channels of dpm cannot"),
    "cells": (presets.vlfeat(), presets.vlfeat(cell_size=4), "cell_size"),
    "votes": (presets.uoctti(), presets.dpm(), "vote"),
    "clip": (presets.piotr(), presets.piotr(clip=0.3), "clip"),
    "no blocks": (presets.vlfeat(), presets.skimage(), "the channels of skimage are no directed"),
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
