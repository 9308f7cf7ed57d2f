"""HOGSpec: what it refuses, and how it is stored."""

from __future__ import annotations

import dataclasses
import json
import math
import re
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nablahog.hog import (
    BlockCells,
    BlockNorm,
    CellNorm,
    FourBlockNorm,
    HOGSpec,
    presets,
)
from nablahog.hog.normalizers import Part, Texture

from ..fuzz.specs import CHOICES, PARTS_LISTS, specs
from .zoo import SPECS, spec

# --- JSON ------------------------------------------------------------------------------------------------------------


@given(s=specs(), name=st.text())
def test_json_round_trip(s: HOGSpec, name: str) -> None:
    s = dataclasses.replace(s, name=name)
    text = s.to_json()
    assert "\n" not in text
    assert HOGSpec.from_json(text) == s
    assert hash(HOGSpec.from_json(text)) == hash(s)


@pytest.mark.parametrize("name", SPECS)
def test_json_holds_every_field(name: str) -> None:
    stored = json.loads(SPECS[name].to_json())
    assert set(stored) == {field.name for field in dataclasses.fields(HOGSpec)}
    assert stored["normalizer"]["kind"] == SPECS[name].normalizer.kind
    assert stored["pooling"]["kind"] == SPECS[name].pooling.kind


FIRST_FIELDS = (
    *("name", "value_range", "colour", "border", "bins", "signed", "bin_offset"),
    *("vote", "cell_size", "partial_cells", "normalizer"),
)


@pytest.mark.parametrize("make", [presets.paper, presets.uoctti, presets.aubry])
def test_json_of_the_first_version(make: Callable[[], HOGSpec]) -> None:
    """Eleven fields, and of the four-block normaliser three; the rest is what all dialects then had in common."""
    stored = {name: value for name, value in json.loads(make().to_json()).items() if name in FIRST_FIELDS}
    for name in ("texture", "outside", "floor"):
        stored["normalizer"].pop(name, None)
    assert HOGSpec.from_json(json.dumps(stored)) == make()


def test_json_of_the_first_version_letter_by_letter() -> None:
    text = (
        '{"name": "uoctti", "value_range": 255.0, "colour": "largest", "border": "ignore", "bins": 18, "signed": true, '
        '"bin_offset": 0.0, "vote": "linear", "cell_size": [8, 8], "partial_cells": "round", '
        '"normalizer": {"epsilon": 0.0001, "clip": 0.2, "kind": "four-block"}}'
    )
    assert HOGSpec.from_json(text) == presets.uoctti()  # without parts: all three that there were


@pytest.mark.parametrize("name", SPECS)
def test_json_without_what_is_as_by_default(name: str) -> None:
    stored = json.loads(SPECS[name].to_json())
    for field in dataclasses.fields(HOGSpec):
        default = field.default_factory() if callable(field.default_factory) else field.default
        if getattr(SPECS[name], field.name) == default:
            del stored[field.name]
    assert HOGSpec.from_json(json.dumps(stored)) == SPECS[name]


def changed(**changes: Any) -> str:
    return json.dumps(json.loads(presets.paper().to_json()) | changes)


def without(field: str) -> str:
    return json.dumps({k: v for k, v in json.loads(presets.paper().to_json()).items() if k != field})


@pytest.mark.parametrize(
    "text",
    [
        "",
        "HOG",
        "{",
        "null",
        "5",
        "[]",
        '"paper"',
        "{}",
        changed(surplus=1),
        changed(name=5),
        changed(bins="nine"),
        changed(bins=9.0),
        changed(bins=None),
        changed(cell_size=8),
        changed(cell_size=[8]),
        changed(cell_size=[8.0, 8.0]),
        changed(cell_size=None),
        changed(colour="grey"),
        changed(colour=["gray"]),
        changed(value_range=float("nan")),
        changed(value_range=float("inf")),
        changed(value_range=0),
        changed(bin_offset="0"),
        changed(signed="no"),
        changed(normalizer=None),
        changed(normalizer="global"),
        changed(normalizer={}),
        changed(normalizer={"kind": "unknown"}),
        changed(normalizer={"kind": ["global"]}),
        changed(normalizer={"kind": "global", "epsilon": 0}),
        changed(normalizer={"kind": "global", "surplus": 0}),
        changed(normalizer={"kind": "four-block"}),  # needs signed bins
        changed(normalizer={"kind": "four-block", "parts": ["colour"]}, signed=True, bins=18),
        changed(normalizer={"kind": "four-block", "parts": [["directed"]]}, signed=True, bins=18),
        changed(normalizer={"kind": "four-block", "parts": 3}, signed=True, bins=18),
        changed(normalizer={"kind": "block"}),  # of how many cells?
        changed(normalizer={"kind": "block", "block": [2]}),
        changed(normalizer={"kind": "block", "block": 2}),
        changed(normalizer={"kind": "bilinear"}),
        changed(pooling=None),
        changed(pooling="box"),
        changed(pooling={}),
        changed(pooling={"kind": "global"}),
        changed(pooling={"kind": "box", "mean": 1}),
        changed(pooling={"kind": "block", "block": [16, 16], "step": [8, 8], "sigma": 4.0}),  # needs blocks
        changed(gamma=0.5),
        changed(counterclockwise=1),
        changed(layout="blocks"),
        *(without(name) for name in FIRST_FIELDS),
    ],
)
def test_bad_json_is_a_value_error(text: str) -> None:
    with pytest.raises(ValueError, match=r"\w+ \w+"):
        HOGSpec.from_json(text)


def test_huge_number_in_json_is_a_value_error() -> None:
    with pytest.raises(ValueError, match=r"^value_range must be a number in 1e-12 … 1e\+12"):
        HOGSpec.from_json(changed(value_range=10**400))


# --- fields ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [0, -1.0, math.nan, math.inf, "255", None, True])
def test_refuses_value_range(value: Any) -> None:
    with pytest.raises(ValueError, match=r"^value_range must be a number in 1e-12 … 1e\+12, got "):
        spec(value_range=value)


@pytest.mark.parametrize("value", [None, 5, b"paper"])
def test_refuses_name(value: Any) -> None:
    with pytest.raises(ValueError, match=r"^name must be text, got "):
        dataclasses.replace(presets.paper(), name=value)


@pytest.mark.parametrize("field", ["colour", "vote", "angle", "layout", *CHOICES])
@pytest.mark.parametrize("value", ["", "Gray", None, 1, []])
def test_refuses_unknown_choices_and_names_the_known(field: str, value: Any) -> None:
    with pytest.raises(ValueError, match=rf"^{field} must be one of '[\w-]+', .*, got {re.escape(repr(value))}$"):
        spec(**{field: value})


@pytest.mark.parametrize("bins", [2, 0, -9, 9.0, "9", None, True])
def test_refuses_bins(bins: Any) -> None:
    with pytest.raises(ValueError, match=r"^bins must be an integer in 3 … 1000, got "):
        spec(bins=bins)


@pytest.mark.parametrize("field", ["signed", "counterclockwise"])
@pytest.mark.parametrize("value", [0, 1, None, "yes"])
def test_refuses_what_is_not_true_or_false(field: str, value: Any) -> None:
    with pytest.raises(ValueError, match=rf"^{field} must be True or False, got "):
        spec(**{field: value})


@pytest.mark.parametrize("bin_offset", [9, 9.5, -0.1, math.nan, math.inf, "0", None])
def test_refuses_bin_offset(bin_offset: Any) -> None:
    with pytest.raises(ValueError, match=r"^bin_offset must lie in \[0, bins\), in bins, got "):
        spec(bin_offset=bin_offset)


@pytest.mark.parametrize("size", [8, (8,), (8, 8, 8), [8], (0, 8), (8, -1), (8.0, 8), (True, 8), None, "88"])
def test_refuses_cell_size(size: Any) -> None:
    with pytest.raises(
        ValueError, match=r"^cell_size must be a pair \(height, width\) of integers in 1 … 1,000,000, got"
    ):
        spec(cell_size=size)


@pytest.mark.parametrize("parts", PARTS_LISTS)
@pytest.mark.parametrize("texture", ["vlfeat", "dpm"])
def test_four_block_normalisers_of_unsigned_bins(parts: tuple[Part, ...], texture: Texture) -> None:
    """Allowed if no channel is made of directed histograms."""
    scheme = FourBlockNorm(parts=parts, texture=texture)
    if "directed" in parts or ("texture" in parts and texture == "dpm"):
        with pytest.raises(ValueError, match=r"sums directed histograms: signed must be True, got False$"):
            spec(normalizer=scheme, bins=9)
    else:
        unsigned, signed = spec(normalizer=scheme, bins=9), spec(normalizer=scheme, signed=True, bins=18)
        assert unsigned.channels == signed.channels


@pytest.mark.parametrize(
    "changes",
    [
        {"normalizer": FourBlockNorm(), "signed": True, "bins": 9},
        {"vote": "hard", "signed": True, "bins": 9},
        {"angle": "vlfeat", "signed": True, "bins": 9, "bin_offset": 0.0},
    ],
)
def test_refuses_bins_without_opposites(changes: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"pair each bin with its opposite: bins must be even, got 9$"):
        spec(**changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"angle": "opencv", "counterclockwise": True}, "goes with bins that follow each other clockwise"),
        ({"angle": "vlfeat"}, "goes with bins of which the first is centred at 0, clockwise"),
        ({"angle": "vlfeat", "bin_offset": 0.0, "counterclockwise": True}, "the first is centred at 0, clockwise"),
        ({"layout": "colour-planes"}, "the layout 'colour-planes' goes with separate colours"),
        ({"layout": "blocks"}, "the layout 'blocks' goes with a BlockNorm"),
        ({"layout": "block-vector"}, "the layout 'block-vector' goes with a BlockNorm"),
        ({"layout": "opencv-vector", "normalizer": CellNorm()}, "the layout 'opencv-vector' goes with a BlockNorm"),
        (
            {"layout": "blocks", "normalizer": BlockNorm((2, 2)), "colour": "separate"},
            "the layout 'blocks' goes with a BlockNorm, and not with separate colours",
        ),
        ({"pooling": BlockCells((6, 8), (4, 4), 2.0)}, r"blocks of \(6, 8\) pixels are no whole cells of \(4, 4\)"),
        ({"pooling": BlockCells((8, 4), (4, 4), 2.0)}, r"go with a BlockNorm of block and step \(2, 1\)"),
        (
            {"pooling": BlockCells((8, 4), (4, 4), 2.0), "normalizer": BlockNorm((2, 1), (1, 1))},
            r"go with a BlockNorm of block and step \(2, 1\)",
        ),
    ],
)
def test_refuses_what_does_not_go_together(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        spec(**changes)


def test_equal_specs_are_one_key() -> None:
    """Whole numbers may be given as integers."""
    whole = dataclasses.replace(
        presets.uoctti(), bin_offset=0, value_range=255, normalizer=FourBlockNorm(epsilon=1, clip=1)
    )
    real = dataclasses.replace(
        presets.uoctti(), bin_offset=0.0, value_range=255.0, normalizer=FourBlockNorm(epsilon=1.0, clip=1.0)
    )
    assert whole == real
    assert whole.to_json() == real.to_json()
    assert len({whole, real}) == 1


def test_is_immutable() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        presets.paper().bins = 18  # type: ignore[misc]


@pytest.mark.parametrize(
    ("spec", "shown"),
    [
        (presets.paper(), "<HOGSpec presets.paper()>"),
        (presets.uoctti(6), "<HOGSpec presets.uoctti() with cell_size=(6, 6)>"),
        (
            presets.skimage(8, cells_per_block=(2, 2)),
            "<HOGSpec presets.skimage() with bins=8, normalizer.block=(2, 2)>",
        ),
        (presets.cnn_hog(bilinear=True), "<HOGSpec presets.cnn_hog() with name='cnn-hogb', vote='linear'>"),
        (presets.opencv(win_size=(64, 64)), "<HOGSpec presets.opencv()>"),  # the window is no part of it
    ],
)
def test_a_spec_shows_what_differs_from_the_nearest_preset(spec: HOGSpec, shown: str) -> None:
    assert repr(spec) == shown
