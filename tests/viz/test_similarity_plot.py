"""Boxes where they belong, and curves that go through their points."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from nablahog.viz.pictures import RED
from nablahog.viz.similarity_plot import LEFT, RIGHT, VIEW, WIDTH, boxed, by_azimuth

BLUE = (24, 74, 150)
TEXTS = {"what": "patches", "how": "central differences"}


def where(picture: NDArray[np.float64], colour: tuple[int, int, int]) -> NDArray[np.bool_]:
    """The pixels that have about this colour."""
    near: NDArray[np.bool_] = (np.abs(picture * 255 - np.array(colour)[:, None, None]) < 50).all(axis=0)
    return near


def columns(mask: NDArray[np.bool_]) -> list[float]:
    """The least and the largest azimuth at which there is something."""
    result = np.flatnonzero(mask.any(axis=0))
    return [float((column + 0.5 - LEFT) / (WIDTH - LEFT - RIGHT) * 360) for column in (result[0], result[-1])]


def test_boxes() -> None:
    picture = np.full((1, 30, 40), 0.5)
    drawn = boxed(picture, [(10.2, 5, 19.8, 25), (-5, -5, 4, 4), (35, 28, 90, 90)])
    assert drawn.shape == (3, 30, 40)
    red = (drawn != 0.5).any(axis=0) & (np.abs(drawn - 0.5) > 0.01).any(axis=0)
    np.testing.assert_allclose(drawn[:, 5, 10], RED, atol=0.01)
    assert red[5:7, 10:20].all()
    assert red[5:25, 18:20].all()
    assert not red[7:23, 12:18].any()
    assert not red[:, 21:34].any()
    assert red[3, :4].all()
    assert red[28, 35:].all()
    assert not boxed(picture, []).std()


@pytest.mark.parametrize("azimuth", [0.0, 130.0, 359.9])
def test_the_pose_found_is_marked(azimuth: float) -> None:
    values = 3 + np.cos(np.radians(np.arange(0, 360, 4)))
    picture = by_azimuth(values, values, values, **TEXTS, azimuth=azimuth)
    assert picture.shape[::2] == (3, WIDTH)
    red = where(picture, (255, 38, 26))
    lines = red.sum(axis=0) > 300
    assert columns(np.broadcast_to(lines, red.shape)) == pytest.approx([azimuth, azimuth], abs=1)


def test_the_curve_is_highest_where_similarity_is() -> None:
    azimuths = np.arange(0, 360, 2)
    values = np.exp(-(((azimuths - 200) / 20.0) ** 2))
    blue = where(by_azimuth(values, np.zeros(180), np.zeros(180), **TEXTS, azimuth=0)[:, 24:260], BLUE)
    assert columns(blue) == pytest.approx([0, 360], abs=1)
    rows = blue.argmax(axis=0)
    rows[~blue.any(axis=0)] = 1000
    assert columns((rows == rows.min()) & blue) == pytest.approx([200, 200], abs=4)


def test_traces_go_round() -> None:
    flat = np.ones(90)
    traces = [([350.0, 355, 365, 370], [0.5] * 4), ([20.0, 5, -5, -20], [1.5] * 4), ([0.0, 0.0], [0.2, 0.3])]
    picture = by_azimuth(flat, flat, flat, **TEXTS, azimuth=180, traces=traces)[:, 24:260]
    orange = picture[1] - picture[2] > 0.1  # which nothing else has
    assert columns(orange) == pytest.approx([0, 360], abs=3)
    for side in (slice(LEFT + 1, LEFT + 4), slice(WIDTH - RIGHT - 4, WIDTH - RIGHT - 1)):
        assert len(np.flatnonzero(np.diff(orange[:, side].any(axis=1)))) >= 4  # two lines
    assert not orange[:, (np.arange(WIDTH) > LEFT + 100) & (np.arange(WIDTH) < WIDTH - RIGHT - 100)].any()


def test_views_lie_below_their_azimuths() -> None:
    flat = np.ones(90)
    views = [np.full((10, 10), k / 8) for k in range(8)]
    plain = by_azimuth(flat, flat, flat, **TEXTS, azimuth=180)
    strip = by_azimuth(flat, flat, flat, **TEXTS, azimuth=180, views=views)[:, plain.shape[1] :]
    for k, view in enumerate(views):
        middle = round(LEFT + k / 8 * (WIDTH - LEFT - RIGHT))
        assert strip[0, VIEW // 2, middle] == pytest.approx(view[0, 0], abs=0.01)


@pytest.mark.parametrize("level", [0.0, 1e-12, -7.0, 1e9])
def test_any_level(level: float) -> None:
    picture = by_azimuth(np.full(12, level), np.zeros(12), np.zeros(12), **TEXTS, azimuth=0)
    assert np.isfinite(picture).all()


def test_derivatives_are_drawn_over_what_they_are_compared_with() -> None:
    azimuths = np.arange(0, 360, 2)
    rising, falling = np.where(azimuths < 180, 1.0, -1.0), np.where(azimuths < 180, -1.0, 1.0)
    apart = by_azimuth(rising, rising, falling, **TEXTS, azimuth=0)[:, 330:]
    alike = by_azimuth(rising, rising, rising, **TEXTS, azimuth=0)[:, 330:]
    gray = [(np.abs(picture * 255 - 150) < 12).all(axis=0)[:, LEFT + 20 : 500].sum() for picture in (apart, alike)]
    assert gray[0] > 3 * gray[1]
