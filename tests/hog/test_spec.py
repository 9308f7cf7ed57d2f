"""HOGSpec: what it refuses, and how it is stored."""

from __future__ import annotations

import dataclasses
import json
import math
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nablahog.hog import (
    BilinearCells,
    BlockCells,
    BlockNorm,
    BoxCells,
    CellNorm,
    FourBlockNorm,
    GlobalNorm,
    HOGSpec,
    presets,
)

from ..fuzz.specs import CHOICES, specs
from .zoo import SPECS, spec

# --- JSON ------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
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


def test_json_of_the_first_version() -> None:
    """Eleven fields, and of the four-block normaliser three; the rest is what all dialects then had in common."""
    text = (
        '{"name": "uoctti", "value_range": 255.0, "colour": "largest", "border": "ignore", "bins": 18, "signed": true, '
        '"bin_offset": 0.0, "vote": "linear", "cell_size": [8, 8], "partial_cells": "round", '
        '"normalizer": {"epsilon": 0.0001, "clip": 0.2, "kind": "four-block"}}'
    )
    assert HOGSpec.from_json(text) == presets.uoctti()


def changed(**changes: Any) -> str:
    return json.dumps(json.loads(presets.paper().to_json()) | changes)


@pytest.mark.parametrize(
    "text",
    [
        "{",
        "null",
        "[]",
        "{}",
        changed(surplus=1),
        changed(bins="nine"),
        changed(cell_size=[8]),
        changed(value_range=float("nan")),
        changed(value_range=10**400),
        changed(normalizer=None),
        changed(normalizer={"kind": "unknown"}),
        changed(normalizer={"kind": ["global"]}),
        changed(normalizer={"kind": "global", "surplus": 0}),
        changed(normalizer={"kind": "four-block", "parts": [["directed"]]}, signed=True, bins=18),
        changed(normalizer={"kind": "block"}),  # of how many cells?
        changed(pooling={"kind": "global"}),
        changed(pooling={"kind": "block", "block": [16, 16], "step": [8, 8], "sigma": 4.0}),  # needs blocks
    ],
)
def test_bad_json_is_a_value_error(text: str) -> None:
    with pytest.raises(ValueError, match=r"\w+ \w+"):
        HOGSpec.from_json(text)


# --- fields ----------------------------------------------------------------------------------------------------------

WRONG: list[tuple[str, list[Any]]] = [
    ("name", [None, b"paper"]),
    ("value_range", [0, math.nan, math.inf, "255", None, True]),
    ("bins", [2, -9, 9.0, True, 10**6]),
    ("bin_offset", [9, -0.1, math.nan, "0"]),
    ("signed", [0, None]),
    ("cell_size", [8, (8,), (0, 8), (8.0, 8), (True, 8), None]),
    ("normalizer", [None, "global", GlobalNorm]),
    *((field, ["Gray", None, []]) for field in ("colour", "vote", "angle", "layout", *CHOICES)),
]


@pytest.mark.parametrize(("field", "values"), WRONG)
def test_a_wrong_field_is_named(field: str, values: list[Any]) -> None:
    for value in values:
        with pytest.raises(ValueError, match=rf"^{field} must [^\n]+, got [^\n]+$"):
            dataclasses.replace(spec(), **{field: value})


WRONG_PARTS: list[tuple[Callable[..., Any], str, list[Any]]] = [
    *((kind, "epsilon", [0, math.nan, None]) for kind in (GlobalNorm, CellNorm, FourBlockNorm)),
    (GlobalNorm, "form", ["L2"]),
    (FourBlockNorm, "texture", ["VLFeat", []]),
    (FourBlockNorm, "floor", [1]),
    (FourBlockNorm, "parts", [(), ("texture", "zero"), ("blocks", "texture"), ("directed",) * 2, "directed", ([],)]),
    (partial(BlockNorm, block=(2, 2)), "form", ["l2"]),
    (BlockNorm, "block", [2, (2,), (0, 2), (2.0, 2)]),
    (BilinearCells, "beyond", [""]),
    (BoxCells, "window", [1, -1, 8.0, True]),
    (partial(BlockCells, (2, 2), (1, 1)), "sigma", [0, math.nan]),
]


@pytest.mark.parametrize(("kind", "field", "values"), WRONG_PARTS)
def test_a_wrong_field_of_a_part_is_named(kind: Callable[..., Any], field: str, values: list[Any]) -> None:
    for value in values:
        with pytest.raises(ValueError, match=rf"^{field} must "):
            kind(**{field: value})


@pytest.mark.parametrize(
    "changes",
    [
        {"normalizer": FourBlockNorm(), "signed": True, "bins": 9},
        {"normalizer": FourBlockNorm(), "bins": 9},  # directed channels of unsigned bins
        {"normalizer": FourBlockNorm(parts=("undirected", "texture"), texture="dpm"), "bins": 9},
        {"vote": "hard", "signed": True, "bins": 9},
        {"angle": "vlfeat", "signed": True, "bins": 9, "bin_offset": 0.0},
        {"angle": "opencv", "counterclockwise": True},
        {"angle": "vlfeat"},
        {"layout": "colour-planes"},
        {"layout": "blocks"},
        {"layout": "blocks", "normalizer": BlockNorm((2, 2)), "colour": "separate"},
        {"pooling": BlockCells((6, 8), (4, 4), 2.0)},
        {"pooling": BlockCells((8, 4), (4, 4), 2.0)},
        {"pooling": BlockCells((8, 4), (4, 4), 2.0), "normalizer": BlockNorm((2, 1), (1, 1))},
    ],
)
def test_refuses_what_does_not_go_together(changes: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"go(es)? with|must be (even|True)|whole cells"):
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


@pytest.mark.parametrize("s", SPECS.values(), ids=SPECS)
def test_parts_hold_their_fields_alone(s: HOGSpec) -> None:
    """Not the classes of all parts as well, which a pickle would have to find again."""
    for part in (s.normalizer, s.pooling):
        assert [*vars(part)] == [field.name for field in dataclasses.fields(part)]


def test_a_new_process_knows_all_normalisers_and_poolings() -> None:
    texts = [s.to_json() for s in SPECS.values()]
    code = f"from nablahog.hog.spec import HOGSpec; print(sum(HOGSpec.from_json(t).to_json() == t for t in {texts}))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.stdout == f"{len(texts)}\n", run.stderr
