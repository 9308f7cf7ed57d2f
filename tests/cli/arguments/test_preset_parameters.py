"""Presets by name: what can be said of them on a command line."""

from __future__ import annotations

from typing import Any, Literal, Optional

import pytest

from nablahog import presets
from nablahog.cli.arguments.preset_parameters import PRESETS, as_text, defaults_of, parameters_of, parsed, window_of
from nablahog.cli.inputs.spec import SpecOptions, make_spec

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
        ("2", Optional[int], 2),  # noqa: UP045, as Python 3.10 has it
        ("l2-hys", Literal["L2", "L2-Hys"], "L2-Hys"),
    ],
)
def test_parsed(text: str, hint: Any, value: Any) -> None:
    result = parsed(text, hint)
    assert (result, type(result)) == (value, type(value))
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


def test_windows() -> None:
    assert window_of("opencv", {}) == (128, 64)
    assert window_of("opencv", {"win_size": (48, 96)}) == (96, 48)
    assert window_of("skimage", {}) is None
