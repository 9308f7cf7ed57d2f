"""Boxes where they belong, and curves that go through their points."""

from __future__ import annotations

import base64
import io

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from nablahog.viz.html import Drawing
from nablahog.viz.pictures import BLUE, RED
from nablahog.viz.similarity_plot import HEIGHTS, LEFT, RIGHT, VIEW, WIDTH, SimilarityPlot, draw_boxes, draw_by_azimuth


def lines(drawing: Drawing, colour: str) -> list[NDArray[np.float64]]:
    """The lines of a colour: (n, 2) of x and y."""
    return [np.array(s.points) for s in drawing.shapes if s.kind == "line" and s.colour == colour]


def azimuths(line: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of the points of a line."""
    return (line[:, 0] - LEFT) / (WIDTH - LEFT - RIGHT) * 360


def test_boxes() -> None:
    picture = np.full((1, 30, 40), 0.5)
    drawn = draw_boxes(picture, [(10.2, 5, 19.8, 25), (-5, -5, 4, 4), (35, 28, 90, 90)])
    assert drawn.shape == (3, 30, 40)
    red = (drawn != 0.5).any(axis=0) & (np.abs(drawn - 0.5) > 0.01).any(axis=0)
    np.testing.assert_allclose(drawn[:, 5, 10], RED, atol=0.01)
    assert red[5:7, 10:20].all()
    assert red[5:25, 18:20].all()
    assert not red[7:23, 12:18].any()
    assert not red[:, 21:34].any()
    assert red[3, :4].all()
    assert red[28, 35:].all()
    assert not draw_boxes(picture, []).std()
    np.testing.assert_allclose(draw_boxes(picture, [(10, 5, 20, 25)], BLUE)[:, 5, 10], BLUE, atol=0.01)


@pytest.mark.parametrize("azimuth", [0.0, 130.0, 359.9])
def test_the_pose_found_is_marked(azimuth: float) -> None:
    values = 3 + np.cos(np.radians(np.arange(0, 360, 4)))
    drawing = draw_by_azimuth(values, values, kind="patches", azimuth=azimuth)
    upper, lower = lines(drawing, "mark")
    for line in (upper, lower):
        assert azimuths(line) == pytest.approx([azimuth, azimuth])
    assert abs(upper[0, 1] - upper[1, 1]) == pytest.approx(HEIGHTS[0])
    assert f"the pose found has {azimuth:.1f}°" in drawing.description


def test_the_curve_is_highest_where_similarity_is() -> None:
    at = np.arange(0, 360, 2)
    values = np.exp(-(((at - 200) / 20.0) ** 2))
    drawing = draw_by_azimuth(values, np.zeros(180), kind="patches", azimuth=0)
    curve = next(line for line in lines(drawing, "curve") if len(line) > 2)
    assert azimuths(curve)[[0, -1]] == pytest.approx([0, 360])
    assert azimuths(curve)[curve[:, 1].argmin()] == pytest.approx(200)
    assert "largest at an azimuth of 200°" in drawing.description


@pytest.mark.parametrize(("largest", "step"), [(1.0, 0.2), (2.9, 1.0), (7.0, 2.0), (0.03, 0.01), (150.0, 50.0)])
def test_labels_are_round_numbers(largest: float, step: float) -> None:
    """At least three steps of 1, 2 or 5 times a power of ten; the part reaches 5 % beyond the values."""
    plot = SimilarityPlot(np.array([0.0, largest]), np.zeros(2), "")
    texts = [shape for shape in plot.drawing.shapes if shape.kind == "text" and shape.anchor == "end"]
    above, below = ([s.text for s in texts if (s.points[0][1] < plot.low.top) == upper] for upper in (True, False))
    assert [float(text) for text in above] == pytest.approx([k * step for k in range(len(above))])
    assert (len(above) - 1) * step <= 1.05 * largest < len(above) * step
    level = [line[0, 1] for line in lines(plot.drawing, "grid") if line[0, 1] == line[1, 1]]
    places = [*(plot.top.y(float(text)) for text in above), *(plot.low.y(float(text)) for text in below)]
    assert level == pytest.approx(places)
    assert "0" in below


def test_all_lies_in_the_drawing_and_no_text_on_another() -> None:
    flat = np.ones(90)
    drawing = draw_by_azimuth(
        flat, flat, kind="patches", azimuth=180, traces=[([0.0, 90.0], [1.0, 1.0])], views=[np.ones((4, 4))] * 8
    )
    for shape in drawing.shapes:
        for x, y in shape.points:
            assert 0 <= x <= drawing.width, shape
            assert 0 <= y <= drawing.height, shape
    places = [(shape.points[0], shape.anchor) for shape in drawing.shapes if shape.kind == "text"]
    assert len(set(places)) == len(places)


def test_traces_go_round() -> None:
    flat = np.ones(90)
    traces = [([350.0, 355, 365, 370], [0.5] * 4), ([20.0, 5, -5, -20], [1.5] * 4), ([0.0, 0.0], [0.2, 0.3])]
    drawing = draw_by_azimuth(flat, flat, kind="patches", azimuth=180, traces=traces)
    around = [np.sort(azimuths(line)) for line in lines(drawing, "path")]
    for one in ((350, 360), (0, 10), (340, 360), (0, 20)):  # out on one side, back on the other
        assert any(line[[0, -1]] == pytest.approx(one) for line in around), one
    assert all((line >= -1e-6).all() and (line <= 360 + 1e-6).all() for line in around)
    starts = [shape for shape in drawing.shapes if shape.kind == "dot"]
    assert [azimuths(np.array(shape.points))[0] for shape in starts] == pytest.approx([350, 20, 0])
    assert all((shape.colour, shape.fill) == ("path", "ground") for shape in starts)


def test_views_lie_below_their_azimuths() -> None:
    flat = np.ones(90)
    views = [np.full((10, 10), k / 8) for k in range(8)]
    plain = draw_by_azimuth(flat, flat, kind="patches", azimuth=180)
    drawing = draw_by_azimuth(flat, flat, kind="patches", azimuth=180, views=views)
    shown = [shape for shape in drawing.shapes if shape.kind == "image"]
    middles = np.array([[shape.points[0][0] + VIEW / 2, shape.points[0][1]] for shape in shown])
    assert azimuths(middles) == pytest.approx(np.arange(8) * 45)
    assert (middles[:, 1] == plain.height).all()
    assert drawing.height > plain.height + VIEW
    for shape, view in zip(shown, views, strict=True):
        levels = np.asarray(Image.open(io.BytesIO(base64.b64decode(shape.text))))
        np.testing.assert_allclose(levels, 255 * view, atol=1)


def test_derivatives_are_drawn_below() -> None:
    rising = np.where(np.arange(0, 360, 2) < 180, 1.0, -1.0)
    drawing = draw_by_azimuth(np.zeros(180), rising, kind="patches", azimuth=0)
    _, derivatives = (line for line in lines(drawing, "curve") if len(line) == 181)
    assert derivatives[10, 1] < derivatives[100, 1]  # 1 is above -1


def test_a_curve_that_is_not_yet_known_everywhere_and_a_steep_tangent_stay_within_their_parts() -> None:
    values = np.where(np.arange(180) < 90, np.linspace(0, 2, 180), np.nan)
    plot = SimilarityPlot(values, values, "a part", width=320, heights=(100, 80))
    plot.curve(values, values)
    plot.tangent(20.0, 0.1, 0.5)
    upper, lower = lines(plot.drawing, "curve")
    assert len(upper) == len(lower) == 90
    (tangent,) = lines(plot.drawing, "path")
    for axes, line in ((plot.top, upper), (plot.low, lower), (plot.top, tangent)):
        assert (line[:, 1] >= axes.top - 1e-6).all()
        assert (line[:, 1] <= axes.top + axes.height + 1e-6).all()
        assert (line[:, 0] <= 320 - RIGHT).all()
    dots = [shape for shape in plot.drawing.shapes if shape.kind == "dot"]
    assert [shape.colour for shape in dots] == ["path", "path"]
    assert np.array([shape.points[0] for shape in dots])[:, 0] == pytest.approx(tangent[:, 0].mean())
    plot.tangent(180.0, 1.0, 0.0)  # 15° to each side
    assert np.diff(lines(plot.drawing, "path")[1][:, 0]) == pytest.approx(30 / 360 * (320 - LEFT - RIGHT))
    across, down = tangent[1] - tangent[0]
    per_pixel = (plot.top.largest - plot.top.least) / 100, 360 / (320 - LEFT - RIGHT)
    assert -down * per_pixel[0] / (across * per_pixel[1]) == pytest.approx(0.5)
