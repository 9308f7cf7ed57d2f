"""Conventions are exchanged so that there always is such a HOG."""

from __future__ import annotations

import itertools
from dataclasses import replace

import pytest

from nablahog.dialects.common_form import Orientations, region, same_channels
from nablahog.dialects.conventions import differing, essential, exchangeable, exchanged
from nablahog.dialects.describer import Describer
from nablahog.dialects.distances import Query
from nablahog.hog import BlockNorm, HOGSpec, presets

from .common import CAT, SPECS

PAIRS = list(itertools.combinations(SPECS, 2))


def _names(a: HOGSpec, b: HOGSpec) -> list[str]:
    return [each.name for each in exchangeable(essential(a, 3), essential(b, 3))[0]]


@pytest.mark.parametrize(("a", "b"), PAIRS, ids="-".join)
def test_mixtures_of_presets_are_hogs(a: str, b: str) -> None:
    describer = Describer(CAT)
    for form in (Orientations(), same_channels(SPECS[a], SPECS[b])):
        if form is None:
            continue
        one, other = (describer_spec(SPECS[name], form) for name in (a, b))
        conventions, mixtures = exchangeable(one, other)
        assert len(mixtures) == 2 ** len(conventions)
        assert mixtures[0] == one
        assert differing(mixtures[-1], other) == []
        assert len(conventions) <= 8
        for taken, spec in zip(itertools.product((0, 1), repeat=len(conventions)), mixtures, strict=True):
            assert spec == exchanged(one, other, itertools.compress(conventions, taken))
            region(spec, describer.size)
        query = Query(describer, SPECS[a], SPECS[b], form)
        assert [each.name for each in query.conventions] == [each.name for each in conventions]


def describer_spec(spec: HOGSpec, form: Orientations) -> HOGSpec:
    return essential(form.reduced(spec), 3)


def test_groups_are_called_by_what_differs() -> None:
    dpm, piotr, vlfeat = SPECS["dpm"], SPECS["piotr"], SPECS["vlfeat"]
    assert _names(dpm, dpm) == []
    assert _names(dpm, piotr) == [
        *("value range", "border", "bin ties", "partial cells and pooling", "outermost blocks"),
    ]
    assert _names(vlfeat, SPECS["cnn_hog"]) == [
        *("value range", "colour rule", "border", "partial cells", "ε", "outermost blocks", "channels"),
    ]
    assert _names(SPECS["skimage"], SPECS["maskfeat"]) == ["colour rule", "mask", "bins", "pooling", "normaliser"]
    assert _names(SPECS["uoctti"], replace(SPECS["uoctti"], angle="vlfeat")) == ["arctangent"]
    assert _names(dpm, replace(dpm, directions="float32")) == ["direction table"]
    assert _names(presets.opencv(), presets.opencv(gamma=False)) == ["gamma"]


def test_what_cannot_be_exchanged_alone_is_joined() -> None:
    """Votes within blocks go with blocks of that size."""
    conventions, mixtures = exchangeable(*(essential(spec, 3) for spec in (presets.opencv(), presets.skimage())))
    assert [each.name for each in conventions] == [
        *("gamma", "colour rule", "colour ties", "votes", "pooling + normaliser"),
    ]
    assert {type(spec.pooling) for spec in mixtures} == {
        type(presets.opencv().pooling),
        type(presets.skimage().pooling),
    }
    joined = conventions[-1]
    assert joined.fields == ("pooling", "normalizer")
    assert joined.settings(presets.skimage()).startswith(
        "pooling=box(mean=True, window=0), normalizer=block(block=(3, 3)"
    )


def test_directed_channels_go_with_signed_bins() -> None:
    one = presets.uoctti()
    other = presets.vlfeat("dalaltriggs", bilinear_orientations=True)
    assert _names(one, replace(other, angle="exact", layout="cells")) == ["bins + channels"]


def test_vlfeats_angle_goes_with_bins_that_begin_at_0() -> None:
    one = presets.vlfeat(bilinear_orientations=True)
    other = replace(presets.vlfeat(), vote="linear", bin_offset=0.5)
    assert _names(one, other) == ["bins + arctangent"]


def test_mixtures_of_no_use_are_refused() -> None:
    """As if there were no room for blocks of three cells without colour."""
    one = presets.paper(8)
    other = replace(one, normalizer=BlockNorm((3, 3)), colour="largest", border="zero")
    conventions, _ = exchangeable(
        one, other, lambda spec: (spec.colour == "gray") == (spec.normalizer.kind == "global")
    )
    assert [each.name for each in conventions] == ["colour rule + normaliser", "border"]


def test_what_decides_nothing_is_no_convention() -> None:
    gray = [essential(SPECS[name], 1) for name in ("vlfeat", "dlib")]
    assert gray[0].colour == gray[1].colour == "gray"
    assert [each.name for each in exchangeable(*gray)[0]] == [
        "direction table",
        "pooling",
        "texture",
        "outermost blocks",
    ]
    linear = essential(SPECS["uoctti"], 3)
    assert essential(replace(linear, boundary="upper", directions="four-decimals"), 3) == linear
    assert essential(replace(SPECS["paper"], colour_ties="dlib"), 3) == essential(SPECS["paper"], 3)


def test_an_image_too_small_is_said_to_be() -> None:
    describer = Describer(CAT[:, :16])
    with pytest.raises(ValueError, match=r"an image of 16x74 pixels .* too few for a dpm descriptor"):
        Query(describer, SPECS["paper"], SPECS["dpm"], Orientations())
