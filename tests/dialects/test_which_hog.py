"""What docs/which_hog.md says, figure by figure."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import pytest
from torch import Tensor

from nablahog.dialects.distances import UNRELATED
from nablahog.hog import FourBlockNorm, HOGSpec, hog, presets
from nablahog.hog.layout import native_shape

from .common import SPECS, entries, photograph

TEXT = (Path(__file__).parents[2] / "docs" / "which_hog.md").read_text()
PHOTOGRAPHS = ("astronaut", "camera", "chelsea", "coffee")
TWO_BY_TWO = presets.skimage(cells_per_block=(2, 2))


def some(name: str, spec: HOGSpec) -> Tensor:
    """That of a part of it."""
    return hog(photograph(name)[None, :, 44:236, 60:252].double() / 255, spec)[0]


def vectors(name: str, spec: HOGSpec) -> Tensor:
    """Those of its blocks, or cells, that are not 0."""
    result = some(name, spec).flatten(0, 1)
    return result[result.norm(dim=1) > 0]


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


LENGTHS: list[tuple[int, tuple[int, int], HOGSpec]] = [
    (3780, (128, 64), presets.opencv()),
    (3780, (128, 64), TWO_BY_TWO),
    (6804, (128, 64), presets.skimage()),
    (1764, (64, 64), presets.opencv()),
    (1764, (64, 64), TWO_BY_TWO),
    (1764, (128, 128), SPECS["seeing3d"]),
    (324, (32, 32), presets.opencv()),
    (324, (32, 32), TWO_BY_TWO),
    (324, (32, 32), presets.skimage()),
    (324, (64, 64), SPECS["seeing3d"]),
    (8100, (128, 128), presets.opencv()),
    (8100, (128, 128), TWO_BY_TWO),
    (15876, (128, 128), presets.skimage()),
    (26244, (224, 224), presets.opencv()),
    (26244, (224, 224), TWO_BY_TWO),
    (54756, (224, 224), presets.skimage()),
    (3968, (128, 64), SPECS["vlfeat"]),
    (2604, (128, 64), SPECS["dlib"]),
    (2688, (128, 64), SPECS["dpm"]),
    (4096, (128, 64), SPECS["piotr"]),
    (3456, (128, 64), SPECS["cnn_hog"]),
    (3456, (128, 64), SPECS["maskfeat"]),
    (7560, (128, 64), presets.opencv(nbins=18, signed=True)),
]


def test_lengths() -> None:
    for length, size, spec in LENGTHS:
        assert math.prod(native_shape(spec, size)) == length, spec.name
    said = {int(number) for row in table("Common lengths") for number in row[0].split(", ")}
    assert said == {length for length, _, _ in LENGTHS}


def test_numbers_for_each_place() -> None:
    size = (100, 76)  # 12.5 x 9.5 cells
    rules = {"⌊H/c⌉ × ⌊W/c⌉": (13, 10), "(⌊H/c⌉ − 2) × (⌊W/c⌉ − 2)": (11, 8), "⌊H/c⌋ × ⌊W/c⌋": (12, 9)}
    rules["(⌊H/c⌋ − 2) × (⌊W/c⌋ − 2)"] = (10, 7)
    checked = 0
    for numbers, places, _, names in table("## 1. Count"):
        (first,) = re.findall(r"^\d+", numbers)
        for name in re.findall(r"`(\w+)`", names):
            if name not in SPECS or "zeros" in names or "variant" in names:
                continue
            spec = SPECS[name] if "2x2" not in names or name != "skimage" else TWO_BY_TWO
            assert spec.channels == int(first), name
            if places in rules:
                assert spec.grid(*size) == rules[places], name
            else:
                assert spec.grid(64, 80) == (7, 9)
            checked += 1
    assert checked == 13
    dalal = presets.vlfeat("dalaltriggs")
    assert (dalal.channels, dalal.grid(*size)) == (36, (13, 10))
    assert [s.grid(100, 100)[0] for s in (SPECS["piotr"], SPECS["vlfeat"], SPECS["dpm"])] == [12, 13, 11]
    for name in ("dpm", "piotr"):
        assert (entries("chelsea", SPECS[name])[..., -1] == 0).all()


@pytest.mark.parametrize("name", PHOTOGRAPHS)
def test_largest_values(name: str) -> None:
    for preset in ("vlfeat", "dpm", "dlib", "piotr", "cnn_hog", "aubry", "seeing3d"):
        assert some(name, SPECS[preset])[..., :27].max().item() == pytest.approx(0.4, abs=1e-6)
    assert some(name, presets.vlfeat("dalaltriggs")).max().item() == pytest.approx(0.2)
    most = 9 * 0.2 / math.sqrt(18)
    assert round(most, 4) == 0.4243
    for preset in ("vlfeat", "uoctti"):
        assert some(name, SPECS[preset])[..., 27:].max() <= most + 1e-9
    for preset in ("dpm", "dlib", "piotr"):
        assert some(name, SPECS[preset])[..., 27:31].max() > most


@pytest.mark.parametrize("name", PHOTOGRAPHS)
def test_texture_adds_up(name: str) -> None:
    assert round(2 / math.sqrt(18), 4) == round(2 * 0.2357, 4) == 0.4714
    for preset in ("vlfeat", "uoctti", "dpm", "dlib", "piotr"):
        directed, undirected, texture = some(name, SPECS[preset])[..., :31].split([18, 9, 4], dim=2)
        vlfeat = (texture.sum(2) * 18**0.5 - 2 * undirected.sum(2)).abs().max()
        dpm = (texture.sum(2) / 0.2357 - 2 * directed.sum(2)).abs().max()
        right, wrong = (vlfeat, dpm) if preset in ("vlfeat", "uoctti") else (dpm, vlfeat)
        assert right < 1e-6
        assert wrong > 1


@pytest.mark.parametrize("name", PHOTOGRAPHS)
def test_lengths_of_blocks(name: str) -> None:
    scikit = {form: vectors(name, presets.skimage(block_norm=form)) for form in ("L1", "L1-sqrt", "L2", "L2-Hys")}
    for form in ("L2", "L2-Hys"):
        assert (scikit[form].norm(dim=1) - 1).abs().quantile(0.99) < 1e-6
    assert (scikit["L1-sqrt"].norm(dim=1) - 1).abs().median() < 1e-6
    assert (scikit["L1"].sum(dim=1) - 1).abs().median() < 1e-6
    opencv = vectors(name, presets.opencv()).norm(dim=1)
    assert opencv.max() < 0.999
    assert opencv.quantile(0.05) > 0.99
    cells = vectors(name, SPECS["maskfeat"]).unflatten(1, (3, 9)).norm(dim=2)
    assert ((cells - 1).abs() < 1e-9).float().mean() > 0.9
    assert some(name, presets.paper(global_form="robust")).norm().item() == pytest.approx(1)


@pytest.mark.parametrize("name", PHOTOGRAPHS)
def test_clipped_entries_are_equal(name: str) -> None:
    for form, many in (("L2-Hys", True), ("L2", False), ("L1", False), ("L1-sqrt", False), ("opencv", True)):
        spec = presets.opencv() if form == "opencv" else presets.skimage(block_norm=form)  # type: ignore[arg-type]
        two = vectors(name, spec).topk(2, dim=1).values
        equal = ((two[:, 0] - two[:, 1]) <= 1e-6 * two[:, 0]).double().mean().item()
        assert (equal >= 0.5) if many else (equal < 0.05), form


def test_border_of_the_network() -> None:
    result = entries("camera", SPECS["cnn_hog"])
    assert result[0].max().item() == result[:, -1].max().item() == pytest.approx(0.2)
    assert result[0, 0].max().item() == pytest.approx(0.1)
    assert result.max().item() == pytest.approx(0.4)


def test_the_table_of_conventions() -> None:
    heads = [
        "preset",
        "image",
        "colour",
        "derivative",
        "bins",
        "vote",
        "between",
        "cells",
        "pooling",
        "normaliser",
        "clip",
    ]
    rows = [dict(zip(heads, row, strict=True)) for row in table("## The conventions")]
    assert {row["preset"].strip("`") for row in rows} == SPECS.keys() - {"uoctti", "aubry"}
    for row in rows:
        spec = SPECS[row["preset"].strip("`")]
        scheme: Any = spec.normalizer
        name = spec.name
        colour = {"largest": "largest", "gray": "gray", "separate": "each by itself"}[spec.colour]
        assert colour in row["colour"], name
        assert row["bins"].startswith(str(spec.bins)), name
        assert ("360" in row["bins"] or row["bins"] == "18, 0°") == spec.signed, name
        first = {0.0: "0°", 0.5: "10°", 5.0: "80°"}[spec.bin_offset]
        assert first in row["bins"], name
        assert row["vote"].startswith({"linear": "shared", "hard": ("all to one", "as dpm")}[spec.vote]), name
        ties_ = "–" if spec.vote == "linear" else "upper" if spec.boundary == "upper" else "lower"
        assert ties_ in row["between"] or (name == "maskfeat" and "begins" in row["between"]), name
        if name != "opencv":
            assert ("⌊·⌋" in row["cells"]) == (spec.partial_cells == "floor"), name
        assert ("dropped" in row["cells"]) == (isinstance(scheme, FourBlockNorm) and scheme.outside == "drop"), name
        assert row["clip"] == (f"{scheme.clip:g}" if hasattr(scheme, "clip") else "none"), name
        numbers = [float(number) for number in re.findall(r"\d+(?:\.\d+)?(?:e-\d+)?", row["normaliser"])]
        assert scheme.epsilon in [pytest.approx(number) for number in numbers], name
        if spec.value_range == 1:
            assert row["image"] == "0…1", name
    assert pytest.approx(1.41, abs=0.005) == UNRELATED


@pytest.mark.parametrize("name", ["dialects.svg", "which_hog.png", "which_hog.py"])
def test_what_it_shows_is_there(name: str) -> None:
    assert name in TEXT
    assert (Path(__file__).parents[2] / "docs" / name).is_file()
