"""Viewpoints by the rules of PASCAL3D+."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from nablahog.metrics import VIEWS, azimuth_error, near_view, rotation_error, same_view, view
from nablahog.render import pose
from nablahog.render.camera import rotations

# quarters of degrees: sums of them are exact, and edges of all divisions are among them
AZIMUTHS = st.integers(-4 * 1080, 4 * 1080).map(lambda quarters: quarters / 4)
DIVISIONS = st.sampled_from(VIEWS)


def _published(azimuth: float, views: int) -> int:
    """What the published code does, for an azimuth in 0…360: the edges in turn, and the last interval is the first."""
    width = 360 / views
    edges = [0.0, *(width / 2 + k * width for k in range(views))]
    if azimuth > edges[-1]:
        return 0
    return next((k for k, edge in enumerate(edges) if azimuth < edge), len(edges) - 1) - 1


@given(AZIMUTHS, DIVISIONS)
def test_the_published_intervals(azimuth: float, views: int) -> None:
    assert view(azimuth, views) == _published(azimuth % 360, views)


def test_intervals_by_hand() -> None:
    assert view([0, 44.9, 45, 90, 134.9, 135, 225, 314.9, 315, 315.1, 359.9, 360, -44], 4).tolist() == [
        *(0, 0, 1, 1, 1, 2, 3, 3, 3, 0, 0, 0, 0)
    ]
    assert view([7.4, 7.5, 352.5, 352.6], 24).tolist() == [0, 1, 23, 0]
    assert view(-1e-17, 24) == 0  # whose remainder is rounded to 360
    assert view([10, 200], 1).tolist() == [0, 0]


@given(AZIMUTHS, AZIMUTHS, AZIMUTHS, st.integers(-2, 2))
def test_errors(result: float, true: float, turn: float, times: int) -> None:
    error = azimuth_error(result, true)
    assert 0 <= error <= 180
    assert error == azimuth_error(true, result) == azimuth_error(result + turn, true + turn)
    assert error == azimuth_error(result + 360 * times, true)
    assert azimuth_error(result, result) == 0
    assert azimuth_error(result + 180, true) == 180 - error
    assert np.cos(np.radians(error)) == pytest.approx(np.cos(np.radians(result - true)), abs=1e-9)


@given(AZIMUTHS, AZIMUTHS, DIVISIONS)
def test_criteria(result: float, true: float, views: int) -> None:
    assert near_view(result, true, views) == (azimuth_error(result, true) < 360 / views)
    if azimuth_error(result, true) == 0:
        assert same_view(result, true, views)
    if same_view(result, true, views):
        assert azimuth_error(result, true) <= 360 / views
    assert same_view(result, true, views) == same_view(result + 360, true - 720, views)


ANGLES = st.floats(-720, 720)
VIEWPOINTS = st.tuples(ANGLES, ANGLES, ANGLES)


def _camera(viewpoint: tuple[float, float, float]) -> Rotation:
    """Azimuth about the object's z, then elevation about x, whose 90° look down on it, then the image's own turn."""
    azimuth, elevation, theta = viewpoint
    return Rotation.from_euler("ZXZ", [-theta, 90 + elevation, -azimuth], degrees=True)


@given(VIEWPOINTS, VIEWPOINTS)
def test_rotation_errors_by_scipy(result: tuple[float, float, float], true: tuple[float, float, float]) -> None:
    expected = np.degrees((_camera(result) * _camera(true).inv()).magnitude())
    assert rotation_error(result, true) == pytest.approx(expected, abs=1e-5)


@given(VIEWPOINTS)
def test_rotations_are_the_renderers(viewpoint: tuple[float, float, float]) -> None:
    azimuth, elevation, theta = viewpoint
    matrix = rotations(pose(azimuth, elevation, theta=theta))[0].numpy()
    np.testing.assert_allclose(matrix, _camera(viewpoint).as_matrix(), atol=1e-9)


def test_rotation_errors_broadcast() -> None:
    errors = rotation_error(np.zeros((4, 1, 3)), np.zeros((5, 3)))
    assert errors.shape == (4, 5)
    with pytest.raises(ValueError, match="along the last axis, got shape"):
        rotation_error([0, 0], [0, 0])
    with pytest.raises(ValueError, match="NaN or infinity"):
        rotation_error([0, float("nan"), 0], [0, 0, 0])


def test_no_azimuth() -> None:
    for bad in (float("nan"), float("inf")):
        with pytest.raises(ValueError, match="expected angles in degrees, got NaN or infinity"):
            azimuth_error([0, bad], 0)
        with pytest.raises(ValueError, match="expected angles"):
            same_view(0, bad, 4)
