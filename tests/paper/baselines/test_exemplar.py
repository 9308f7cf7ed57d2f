"""The baseline finds renderings again, and its star matching does what its description says."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

from nablahog.inputs.boxes import Box
from nablahog.io.images import sample_photograph
from nablahog.paper.baselines import exemplar
from nablahog.paper.baselines.exemplar import NOTHING, UNLIKE, Layout, Pyramid, detect, star_match
from nablahog.paper.baselines.exemplar_views import EXEMPLAR_SPEC, ExemplarViews, ViewSampling, learn_views
from nablahog.pose.background import default_background
from nablahog.render import Camera, Mesh, render

from ...chairs import chair

VIEW_SAMPLING = ViewSampling(azimuths=(0, 30, 60, 150, 250), elevations=(20,))
HEIGHT, WIDTH = 300, 400


@cache
def meshes() -> dict[str, Mesh]:
    return {name: chair(seed) for name, seed in (("a", 1), ("b", 4))}


@cache
def models() -> dict[str, ExemplarViews]:
    background = default_background(EXEMPLAR_SPEC)
    return {name: learn_views(mesh, background, VIEW_SAMPLING) for name, mesh in meshes().items()}


def scene(mesh: Mesh, azimuth: float, x: float, y: float, focal: float, behind: Tensor) -> tuple[Tensor, Any]:
    """A model before a photograph (1, H, W), and the box around it."""
    pose = torch.tensor([[azimuth, 20, 2, 0, x, y]], dtype=torch.float64)
    camera = Camera(focal, *behind.shape[1:])
    image = render(mesh, pose, camera, background=behind[None], supersampling=2)[0].float()
    alone = render(mesh, pose, camera, background=0.0, supersampling=2)[0, 0]
    rows, cols = (alone > 0).nonzero().T
    box = Box(float(cols.min()), float(rows.min()), float(cols.max()) + 1, float(rows.max()) + 1)
    noise = torch.randn(image.shape, generator=torch.Generator().manual_seed(0))
    return (image + 0.02 * noise).clamp(0, 1), box


def clutter() -> Tensor:
    return sample_photograph("coffee")[:, :HEIGHT, :WIDTH].mean(0, keepdim=True)


def iou(a: Any, b: Any) -> float:
    return Box(*a).iou(Box(*b))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "azimuth"), [("a", 30), ("b", 250)])
@pytest.mark.parametrize("focal", [200, 560])
def test_a_rendering_is_found_again(name: str, azimuth: float, focal: float) -> None:
    image, box = scene(meshes()[name], azimuth, 30, -10, focal, clutter())
    output = detect(image, box, models())
    assert (output.model, output.azimuth, output.elevation) == (name, azimuth, 20)
    assert output.confidence > 0.5
    assert 5 <= output.inliers <= 10
    assert iou(output.box, box) > 0.65  # sizes come in steps of a quarter
    colour = detect(image.expand(3, -1, -1).double(), box, models())
    assert (colour.model, colour.azimuth) == (name, azimuth)
    assert colour.confidence == pytest.approx(output.confidence, rel=1e-2)


def test_between_views_it_is_the_nearest(monkeypatch: pytest.MonkeyPatch) -> None:
    image, box = scene(meshes()["b"], 56, 0, 0, 300, clutter())
    assert detect(image, box, models()).azimuth == 60
    monkeypatch.setattr(exemplar, "AT_ONCE", 1)  # one model after the other
    again = detect(image, box, models())
    assert (again.model, again.azimuth) == ("b", 60)


def test_the_box_says_which_object_is_meant() -> None:
    image, left = scene(meshes()["a"], 0, -45, 0, 250, clutter())
    image, right = scene(meshes()["b"], 150, 45, 0, 250, image)
    assert detect(image, left, models()).model == "a"
    assert detect(image, right, models()).model == "b"
    assert iou(detect(image, left, {"b": models()["b"]}, agreement=0.7).box, left) > 0.7


def test_nothing_is_found_in_a_flat_image() -> None:
    with pytest.raises(ValueError, match="no element of any view is found"):
        detect(torch.full((1, 120, 120), 0.5), (10.0, 10.0, 110.0, 110.0), models())


# --- star matching ---------------------------------------------------------------------------------------------------

ROWS, COLS = np.array([6, 5, 3]), np.array([7, 5, 4])
START = np.concatenate([[0], np.cumsum(ROWS * COLS)])
CELL, OCTAVE = 4.0, 2.0
PYRAMID = Pyramid(ROWS, COLS, START, CELL, OCTAVE)


def expected_matches(
    scores: NDArray[np.float32], level: Any, positions: Any, first: Any, boxes: Any, expected: Any, agreement: float
) -> list[list[float]]:
    """What ``star_match`` says of itself, step by step."""
    maps = [
        [scores[e, START[k] : START[k + 1]].reshape(ROWS[k], COLS[k]) for k in range(len(ROWS))]
        for e in range(len(scores))
    ]
    result = []
    for view in range(len(first) - 1):
        members = range(first[view], first[view + 1])
        best = [-math.inf] + 6 * [math.nan]
        for root in members:
            for at in range(len(ROWS)):
                left = maps[root][at].copy()
                while left.max() > 0:
                    y, x = np.unravel_index(left.argmax(), left.shape)
                    left[max(0, y - 1) : y + 2, max(0, x - 1) : x + 2] = NOTHING
                    pixels = CELL * 2 ** (at / OCTAVE)
                    origin = (np.array([y, x]) - positions[root]) * pixels
                    larger = at - level[root]
                    confidence, inliers = 0.0, 0
                    for e in members:
                        there = level[e] + larger
                        if not 0 <= there < len(ROWS):
                            continue
                        row, col = np.rint(positions[e] + origin / (CELL * 2 ** (there / OCTAVE))).astype(int)
                        near = maps[e][there][max(0, row - 1) : max(0, row + 2), max(0, col - 1) : max(0, col + 2)]
                        score = float(near.max()) if near.size else NOTHING
                        if e == root:
                            score = float(maps[root][at][y, x])
                        if not (0 <= row < ROWS[there] and 0 <= col < COLS[there]) or score == NOTHING:
                            score = max(0.0, score)
                        confidence += score
                        inliers += score > 0
                    box = np.tile(origin[::-1], 2) + boxes[view] * 2 ** (larger / OCTAVE)
                    rank = confidence + min(0, inliers - 5)
                    if iou(box, expected) < agreement:
                        rank -= UNLIKE
                    if rank > best[0]:
                        best = [rank, confidence, inliers, *box]
        result.append(best)
    return result


@pytest.mark.parametrize("agreement", [0.0, 0.3])
@pytest.mark.parametrize("seed", range(4))
def test_star_matching_step_by_step(seed: int, agreement: float) -> None:
    generator = np.random.default_rng(seed)
    first = np.array([0, 4, 4, 10])  # the second view has no element
    elements = first[-1]
    scores = generator.normal(-1.2, 1, (elements, START[-1])).astype(np.float32)
    scores[:, generator.random(START[-1]) < 0.2] = NOTHING
    level = generator.integers(0, 3, elements)
    positions = generator.integers(0, 5, (elements, 2))
    boxes = np.sort(generator.uniform(0, 30, (3, 2, 2)), axis=1).reshape(3, 4)
    box = np.array([3.0, 2.0, 20.0, 18.0])
    output = star_match(scores, PYRAMID, Layout(level, positions, first, boxes), box, agreement)
    expected = np.array(expected_matches(scores, level, positions, first, boxes, box, agreement))
    assert output[1, 0] == -math.inf
    assert np.isfinite(output[[0, 2]]).all()
    np.testing.assert_allclose(output[[0, 2]], expected[[0, 2]], rtol=1e-5, atol=1e-4)
    assert expected[1, 0] == -math.inf


def test_nothing_scores_above_0() -> None:
    one = np.zeros((1, 2), np.int64)
    scores = np.full((1, START[-1]), -0.1, np.float32)
    layout = Layout(one[0, :1], one, np.array([0, 1]), np.zeros((1, 4)))
    output = star_match(scores, PYRAMID, layout, np.array([0.0, 0, 9, 9]), 0.0)
    assert output[0, 0] == -math.inf
