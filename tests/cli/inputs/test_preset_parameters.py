"""Presets by name: what can be said of them on a command line."""

from __future__ import annotations

import re
from typing import Any, Literal

import pytest

from nablahog import presets
from nablahog.cli.inputs.preset_parameters import PRESETS, as_text, defaults_of, parameters_of, parsed, window_of
from nablahog.cli.inputs.spec import SpecOptions, make_spec
from nablahog.hog import HOGSpec

PAIR = tuple[int, int]


@pytest.mark.parametrize(
    ("text", "hint", "value"),
    [
        ("12", int, 12),
        ("-3", int, -3),
        ("1.5", float, 1.5),
        ("-1", float, -1.0),
        ("2e-3", float, 2e-3),
        ("true", bool, True),
        ("False", bool, False),
        ("8x16", PAIR, (8, 16)),
        ("8×16", PAIR, (8, 16)),
        ("8", PAIR, (8, 8)),
        ("8", int | PAIR, 8),
        ("8x6", int | PAIR, (8, 6)),
        ("none", int | None, None),
        ("2", int | None, 2),
        ("l2-hys", Literal["L2", "L2-Hys"], "L2-Hys"),
    ],
)
def test_parsed(text: str, hint: Any, value: Any) -> None:
    found = parsed(text, hint)
    assert (found, type(found)) == (value, type(value))
    assert parsed(as_text(value), hint) == value


@pytest.mark.parametrize(
    ("text", "hint", "message"),
    [
        ("8.5", int, "expected an integer of at most six digits, got '8.5'"),
        ("", int, "got ''"),
        ("٣", int, "expected an integer"),
        ("1000000", int, "at most six digits"),
        ("nan", float, "expected a number, got 'nan'"),
        ("inf", float, "expected a number"),
        ("yes", bool, "expected true or false, got 'yes'"),
        ("8x8x8", PAIR, "expected two integers as 8x8, got '8x8x8'"),
        ("x8", PAIR, "expected two integers"),
        ("L3", Literal["L1", "L2"], "expected one of L1, L2, got 'L3'"),
        ("many", int | None, "expected an integer of at most six digits or none, got 'many'"),
        ("8x", int | PAIR, "expected an integer of at most six digits or two integers as 8x8, got '8x'"),
    ],
)
def test_texts_of_no_such_value(text: str, hint: Any, message: str) -> None:
    with pytest.raises(ValueError, match="expected") as error:
        parsed(text, hint)
    assert message in str(error.value)


@pytest.mark.parametrize("name", PRESETS)
def test_every_parameter_of_every_preset_can_be_written(name: str) -> None:
    defaults = defaults_of(name)
    assert list(parameters_of(name)) == list(defaults)
    for key, hint in parameters_of(name).items():
        assert parsed(as_text(defaults[key]), hint) == defaults[key]
    texts = tuple((key, as_text(value)) for key, value in defaults.items())
    assert SpecOptions(name, settings=texts).spec() == make_spec(name, {})


def test_the_presets_are_those_of_the_library() -> None:
    assert set(PRESETS) == set(presets.__all__)
    for name in set(PRESETS) - {"aubry"}:
        assert make_spec(name, {}) == getattr(presets, name)()
    assert make_spec("aubry", {}) == presets.aubry(8)


@pytest.mark.parametrize(
    ("wanted", "spec"),
    [
        (SpecOptions(), presets.uoctti(8)),
        (SpecOptions("paper", (8, 6)), presets.paper((8, 6))),
        (SpecOptions("paper", vote="linear"), presets.paper()),
        (SpecOptions("aubry", (5, 5), "hard"), presets.aubry(5, vote="hard")),
        (SpecOptions("vlfeat", (4, 4), "linear"), presets.vlfeat(cell_size=4, bilinear_orientations=True)),
        (SpecOptions("cnn_hog", vote="linear"), presets.cnn_hog(bilinear=True)),
        (SpecOptions("skimage", (6, 4)), presets.skimage(pixels_per_cell=(6, 4))),
        (SpecOptions("opencv", (4, 8)), presets.opencv(cell_size=(8, 4))),  # (width, height) there
        (SpecOptions("maskfeat", settings=(("nbins", "6"), ("nbins", "7"))), presets.maskfeat(nbins=7)),
        (SpecOptions("skimage", settings=(("channel_axis", "2"),)), presets.skimage(channel_axis=2)),
        (SpecOptions(settings=(("orientations", "6"),)), presets.uoctti(orientations=6)),
    ],
)
def test_what_is_wanted(wanted: SpecOptions, spec: HOGSpec) -> None:
    assert wanted.spec() == spec


@pytest.mark.parametrize(
    ("wanted", "message"),
    [
        ({"descriptor": "dlib", "settings": (("a", "1"),)}, "--set: dlib has no parameter 'a', but cell_size"),
        ({"descriptor": "dlib", "settings": (("cell_size", "a"),)}, "--set cell_size: expected an integer"),
        ({"descriptor": "dlib", "cell": (8, 6)}, "cells of dlib are square: expected --cell N, got 8x6"),
        ({"descriptor": "opencv", "cell": (5, 5)}, "opencv with cell_size=5x5: along the width, a block must be"),
        ({"descriptor": "skimage", "settings": (("orientations", "2"),)}, "skimage with orientations=2: bins must be"),
        ({"descriptor": "cnn_hog", "cell": (0, 0)}, "cnn_hog with cell_size=0: cell_size must be"),
        ({"descriptor": "opencv", "settings": (("block_stride", "0"),)}, "opencv with block_stride=0x0: along the"),
        (
            {"descriptor": "dpm", "cell": (8, 8), "settings": (("cell_size", "8"),)},
            "--cell and --set cell_size say the same: expected one of them",
        ),
        (
            {"descriptor": "opencv", "vote": "hard"},
            "the opencv descriptor has linear votes: --vote hard goes with aubry, cnn_hog, uoctti, vlfeat",
        ),
        ({"descriptor": "dpm", "vote": "linear"}, "the dpm descriptor has hard votes: --vote linear goes with"),
    ],
)
def test_what_cannot_be(wanted: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(message)}"):
        SpecOptions(**wanted)


def _refusal(name: str, key: str, text: str) -> str | None:
    try:
        SpecOptions(name, settings=((key, text),))
    except ValueError as error:
        return str(error)
    return None


@pytest.mark.parametrize("name", PRESETS)
def test_any_small_value_is_a_spec_or_a_sentence(name: str) -> None:
    for key in parameters_of(name):
        for text in ("-1", "0", "1", "2", "3", "7", "0x0", "3x1", "0.5", "none", "true"):
            refusal = _refusal(name, key, text)
            assert refusal is None or (key in refusal and "\n" not in refusal)


def test_windows() -> None:
    assert window_of("opencv", {}) == (128, 64)
    assert window_of("opencv", {"win_size": (48, 96)}) == (96, 48)
    assert window_of("skimage", {}) is None


@pytest.mark.parametrize(
    ("wanted", "spec", "message"),
    [
        (SpecOptions("skimage"), presets.skimage(feature_vector=False), None),  # another layout of the same
        (SpecOptions("skimage"), presets.skimage(pixels_per_cell=(6, 6)), None),
        (
            SpecOptions("skimage", (8, 8)),
            presets.skimage(pixels_per_cell=(6, 6)),
            "its cell_size is (6, 6), not (8, 8)",
        ),
        (
            SpecOptions("skimage", settings=(("pixels_per_cell", "8"),)),
            presets.skimage(pixels_per_cell=(6, 6)),
            "its cell_size is (6, 6), not (8, 8)",
        ),
        (SpecOptions(settings=(("orientations", "6"),)), presets.uoctti(), "its bins is 18, not 12"),
        (SpecOptions("vlfeat"), presets.vlfeat(cell_size=4), None),
        (SpecOptions("dlib"), presets.dpm(), "its name is 'dpm', not 'dlib'"),
    ],
)
def test_descriptor_files_that_say_the_same(wanted: SpecOptions, spec: HOGSpec, message: str | None) -> None:
    if message is None:
        wanted.check(spec)
    else:
        with pytest.raises(ValueError, match="another spec than asked for") as error:
            wanted.check(spec)
        assert message in str(error.value)
