"""All pairs of some presets, and what is said of them."""

from __future__ import annotations

import csv
import io

import numpy as np
import pytest
import torch

from nablahog.dialects import Comparison, compare
from nablahog.dialects.compare import cliques
from nablahog.dialects.distances import UNRELATED
from nablahog.dialects.heatmap import heat_map
from nablahog.dialects.tables import channels, conventions, csv_rows, matrix, pairs, same, shares, tie_rows
from nablahog.hog import presets

from .common import CAT, SPECS, distance

NAMES = ("skimage", "dlib", "vlfeat", "dpm")


@pytest.fixture(scope="module")
def result() -> Comparison:
    return compare(CAT[..., :64], {name: SPECS[name] for name in NAMES})


def test_every_pair_as_if_it_were_alone(result: Comparison) -> None:
    assert [(pair.a, pair.b) for pair in result.pairs][:3] == [
        ("skimage", "dlib"),
        ("skimage", "vlfeat"),
        ("skimage", "dpm"),
    ]
    for pair in result.pairs:
        alone = distance(SPECS[pair.a], SPECS[pair.b], image=CAT[..., :64])
        assert pair.orientations == alone
        assert (pair.channels is None) == ("skimage" in (pair.a, pair.b)) == (pair.parts == ())


def test_the_matrix_is_symmetric(result: Comparison) -> None:
    distances = result.matrix()
    np.testing.assert_array_equal(distances, distances.T)
    assert (distances.diagonal() == 0).all()
    assert distances[0, 1:].min() > 10 * distances[1:, 1:].max()


def test_neighbours_are_alike(result: Comparison) -> None:
    order = result.by_likeness()
    assert sorted(order) == sorted(NAMES)
    assert "skimage" in (order[0], order[-1])
    assert abs(order.index("vlfeat") - order.index("dpm")) == 1
    rows = matrix(result)
    assert [row["distance"] for row in rows] == [f"{i} {name}" for i, name in enumerate(order, start=1)]
    i, j = order.index("skimage"), order.index("dlib")
    assert rows[i][str(j + 1)] == result.pairs[0].orientations.distance
    assert rows[i][str(i + 1)] is None


def test_the_same_is_said_to_be(result: Comparison) -> None:
    assert same(result) == ["The same in a common form: vlfeat, dpm."]
    rows = {str(row["pair"]): row for row in pairs(result)}
    assert next(iter(rows)) == "vlfeat – dpm"
    assert rows["vlfeat – dpm"]["shares of the squared distance"] == "the same"
    assert rows["dlib – dpm"]["shares of the squared distance"] == "colour ties 100%"
    of_channels = {str(row["pair"]): row for row in channels(result)}
    assert of_channels["vlfeat – dpm"]["shares of the squared distance"] == "texture 100%"
    assert of_channels["vlfeat – dpm"]["channels"] == "directed, undirected, texture"
    gray = compare(CAT[:1, :, :64], {name: SPECS[name] for name in ("vlfeat", "dlib", "dpm")})
    assert same(gray) == [
        "The same in a common form: vlfeat, dlib, dpm.",
        "The same directed, undirected, texture channels: dlib, dpm.",
    ]


def test_shares_below_0_have_a_minus(result: Comparison) -> None:
    whole = result.pairs[0].orientations
    turned = [type(each)(each.convention, each.settings, -each.value) for each in whole.contributions[:1]]
    assert "−" in shares(type(whole)(whole.distance, turned, 0, 0, whole.region))


def test_the_csv_file_adds_up(result: Comparison) -> None:
    text = io.StringIO()
    csv.writer(text).writerows(csv_rows(result))
    rows = list(csv.DictReader(io.StringIO(text.getvalue())))
    compared = {(row["a"], row["b"], row["compared"]) for row in rows}
    assert len(compared) == 6 + 3
    for of in compared:
        some = [row for row in rows if (row["a"], row["b"], row["compared"]) == of]
        squared = float(some[0]["distance"]) ** 2
        if some[0]["convention"]:
            assert sum(float(row["share"]) for row in some) == pytest.approx(squared, rel=1e-6)
            assert sum(float(row["percent"]) for row in some) == pytest.approx(100, rel=1e-6)
        else:
            assert squared < 1e-9
    (tie,) = (
        row
        for row in rows
        if (row["a"], row["b"]) == ("dlib", "dpm")
        and row["convention"] == "colour ties"
        and row["compared"] == "common form"
    )
    assert (tie["a_says"], tie["b_says"]) == ("colour_ties=dlib", "colour_ties=first")
    assert (tie["rows"], tie["cols"]) == ("4", "6")


def test_the_presets_are_described(result: Comparison) -> None:
    rows = {row["preset"]: row for row in conventions(SPECS)}
    assert rows["dpm"]["votes"] == "hard, ties first, four-decimals"
    assert rows["dpm"]["bins"] == "18 over 360°, first at 0°"
    assert rows["opencv"]["image"] == "0…255, root"
    assert rows["opencv"]["votes"] == "linear, angle opencv"
    assert rows["maskfeat"]["bins"] == "9 over 180°, first at 80°"
    assert rows["skimage"]["cells"] == "floor, box, mean yes, window 0"
    ties = {row["preset"]: row for row in tie_rows(result.ties)}
    assert ties["skimage"]["between two channels"] is None
    assert ties["dpm"]["at"] == "90°, 270°"


def test_the_heat_map() -> None:
    distances = np.array([[0, 0.3, 1.4], [0.3, 0, 1e-7], [1.4, 1e-7, 0]])
    drawing = heat_map(distances, ["a", "b", "opencv:gamma=false"])
    tiles = [shape.opacity for shape in drawing.shapes if shape.kind == "rectangle"]
    strengths = np.array(tiles[:9]).reshape(3, 3)
    np.testing.assert_allclose(strengths, np.sqrt(distances / UNRELATED))
    assert tiles[9:] == sorted(tiles[9:])  # the scale
    texts = [shape for shape in drawing.shapes if shape.kind == "text"]
    on_tiles = [shape.text for shape in texts if shape.colour.startswith("on-")]
    assert on_tiles == ["0.300", "1.400", "0.300", "0", "1.400", "0"]
    assert {shape.text: shape.colour for shape in texts}["1.400"] == "on-strong-heat"
    assert drawing.description == (
        "Of 3 pairs the closest are opencv:gamma=false and b, 0.000, and the furthest apart opencv:gamma=false and a, "
        "1.400."
    )


def test_groups_of_which_all_are_alike() -> None:
    assert cliques("abcd", [("a", "b"), ("c", "a"), ("b", "c")]) == [["a", "b", "c"]]
    assert cliques("abcd", [("a", "b"), ("b", "c"), ("c", "d")]) == [["a", "b"], ["c", "d"]]
    assert cliques("ab", []) == []


def test_progress_is_told() -> None:
    steps: list[tuple[int, int, str]] = []
    compare(CAT[:1], {name: SPECS[name] for name in NAMES[:2]}, lambda *each: steps.append(each))
    assert [done for done, _, _ in steps] == list(range(len(steps)))
    assert {total for _, total, _ in steps} == {len(steps)}


def test_refusals() -> None:
    some = {name: SPECS[name] for name in NAMES}
    for image in (CAT.float(), CAT[:2], CAT[0]):
        with pytest.raises(ValueError, match="expected an image"):
            compare(image, some)
    with pytest.raises(ValueError, match="at least two dialects"):
        compare(CAT, {"dpm": SPECS["dpm"]})
    with pytest.raises(ValueError, match="cells of one size"):
        compare(CAT, {"dpm": SPECS["dpm"], "other": presets.dpm(4)})
    with pytest.raises(ValueError, match="too few for a dpm descriptor"):
        compare(torch.zeros(1, 16, 40, dtype=torch.uint8), {name: SPECS[name] for name in ("vlfeat", "dpm")})
