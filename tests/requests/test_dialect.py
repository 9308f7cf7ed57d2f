"""Kinds of descriptors: parameters of presets as texts, which spec they ask for, and what contradicts them."""

from __future__ import annotations

from typing import Any, Literal, Optional

import pytest

from nablahog import presets
from nablahog.hog import HOGSpec
from nablahog.requests.dialect import (
    PRESETS,
    Dialect,
    as_text,
    make_spec,
    opencv_window_size,
    parse_value,
    preset_defaults,
    preset_parameters,
)

PAIR = tuple[int, int]


@pytest.mark.parametrize(
    ("text", "hint", "value"),
    [
        ("-3", int, -3),
        ("2e-3", float, 2e-3),
        ("False", bool, False),
        ("8×16", PAIR, (8, 16)),
        ("8x6", int | PAIR, (8, 6)),
        ("none", int | None, None),
        ("2", Optional[int], 2),  # noqa: UP045, as Python 3.10 has it
        ("l2-hys", Literal["L2", "L2-Hys"], "L2-Hys"),
    ],
)
def test_parsed(text: str, hint: Any, value: Any) -> None:
    result = parse_value(text, hint)
    assert (result, type(result)) == (value, type(value))
    assert parse_value(as_text(value), hint) == value


@pytest.mark.parametrize(
    ("text", "hint", "expected"),
    [
        ("٣", int, "an integer"),
        ("nan", float, "a number"),
        ("yes", bool, "true or false"),
        ("8x8x8", PAIR, "two integers"),
        ("L3", Literal["L1", "L2"], "one of L1, L2"),
        ("8x", int | PAIR, "an integer of at most six digits or two integers"),
    ],
)
def test_texts_of_no_such_value(text: str, hint: Any, expected: str) -> None:
    with pytest.raises(ValueError, match=f"expected .*{expected}"):
        parse_value(text, hint)


@pytest.mark.parametrize("name", PRESETS)
def test_every_parameter_of_every_preset_can_be_written(name: str) -> None:
    defaults = preset_defaults(name)
    assert list(preset_parameters(name)) == list(defaults)
    texts = {key: as_text(value) for key, value in defaults.items()}
    spec = Dialect(name, texts).spec
    assert spec == make_spec(name, {}) == (presets.aubry(8) if name == "aubry" else getattr(presets, name)())


def test_windows() -> None:
    assert opencv_window_size("opencv", {}) == (128, 64)
    assert opencv_window_size("opencv", {"win_size": (48, 96)}) == (96, 48)
    assert opencv_window_size("skimage", {}) is None


@pytest.mark.parametrize(
    ("dialect", "spec"),
    [
        (Dialect(), presets.uoctti(8)),
        (Dialect("aubry"), presets.aubry(8)),
        (Dialect("paper", {"cell_size": "8x6"}), presets.paper((8, 6))),
        (Dialect("vlfeat", {"bilinear_orientations": "true"}), presets.vlfeat(bilinear_orientations=True)),
        (Dialect(settings={"orientations": "6"}), presets.uoctti(orientations=6)),
    ],
)
def test_what_options_ask_for(dialect: Dialect, spec: HOGSpec) -> None:
    assert dialect.spec == spec


def test_python_makes_the_same_spec() -> None:
    dialect = Dialect("paper", {"cell_size": "8x6", "bins": "12"})
    assert dialect.python == "nablahog.presets.paper(cell_size=(8, 6), bins=12)"
    assert Dialect("aubry").python == "nablahog.presets.aubry(cell_size=8)"


@pytest.mark.parametrize(
    ("settings", "message"),
    [({"cell_size": "eight"}, "^cell_size: "), ({"bins": "9.5"}, "^bins: "), ({"cells": "8"}, "no parameter 'cells'")],
)
def test_wrong_settings_are_refused_when_they_are_made(settings: dict[str, str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Dialect("paper", settings)


def _refusal(name: str, key: str, text: str) -> str | None:
    try:
        Dialect(name, {key: text})
    except ValueError as error:
        return str(error)
    return None


@pytest.mark.parametrize("name", PRESETS)
def test_any_small_value_is_a_spec_or_a_sentence(name: str) -> None:
    for key in (*preset_parameters(name), "nonsense"):
        for text in ("-1", "0", "2", "3x1", "0.5", "none"):
            refusal = _refusal(name, key, text)
            assert refusal is None or (key in refusal and "\n" not in refusal)


@pytest.mark.parametrize(
    ("dialect", "spec", "differing"),
    [
        (Dialect("skimage"), presets.skimage(feature_vector=False), None),  # another layout of the same
        (Dialect("skimage"), presets.skimage(pixels_per_cell=(6, 6)), None),  # not asked for
        (Dialect("skimage", {"pixels_per_cell": "8"}), presets.skimage(pixels_per_cell=(6, 6)), "cell_size"),
        (Dialect("uoctti", {"vote": "hard"}), presets.uoctti(), "vote"),
        (Dialect("dlib"), presets.dpm(), "name"),
        (Dialect("paper"), presets.paper(bins=6), "bins"),
        (Dialect(settings={"cell_size": "6"}), presets.vlfeat(cell_size=6), None),  # of whatever preset the file is
        (Dialect(settings={"cell_size": "6"}), presets.vlfeat(), "cell_size"),
    ],
)
def test_descriptor_files_and_options(dialect: Dialect, spec: HOGSpec, differing: str | None) -> None:
    if differing is None:
        dialect.check(spec)
    else:
        with pytest.raises(ValueError, match=f"another spec than asked for: its {differing} is"):
            dialect.check(spec)
