"""The figures, on pairs whose values are known, and viewpoints by the rules of PASCAL3D+."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
import PIL.Image
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from skimage import data
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from nablahog.metrics import (
    VIEW_COUNTS,
    azimuth_error,
    cross_correlation,
    mutual_information,
    near_view,
    psnr,
    rotation_error,
    same_view,
    ssim,
    view,
)
from nablahog.render import pose
from nablahog.render.camera import rotations

CAMERA = data.camera()[::4, ::4] / 255.0


@pytest.fixture
def random() -> np.random.Generator:
    return np.random.default_rng(0)


def test_an_image_and_itself() -> None:
    assert cross_correlation(CAMERA, CAMERA) == pytest.approx(1)
    assert ssim(CAMERA, CAMERA) == pytest.approx(1)
    levels, counts = np.unique(CAMERA, return_counts=True)
    assert len(levels) > 100
    p = counts / counts.sum()
    # 256 bins keep all 8-bit levels apart, so the information is the entropy of the levels
    assert mutual_information(CAMERA, CAMERA) == pytest.approx(-(p * np.log2(p)).sum())


def test_a_correlation_is_never_above_1(random: np.random.Generator) -> None:
    """Though the sum of products may be, by a rounding."""
    values = [cross_correlation(image, image) for image in random.random((200, 5, 7))]
    assert 1 - 1e-12 < min(values) <= max(values) == 1


def test_an_image_and_its_negative() -> None:
    assert cross_correlation(CAMERA, 1 - CAMERA) == pytest.approx(-1)
    assert mutual_information(CAMERA, 1 - CAMERA) == pytest.approx(mutual_information(CAMERA, CAMERA), abs=0.05)
    assert ssim(CAMERA, 1 - CAMERA) < 0


def test_independent_noise(random: np.random.Generator) -> None:
    a, b = random.random((2, 512, 512))
    assert abs(cross_correlation(a, b)) < 0.01
    assert abs(ssim(a, b)) < 0.05
    assert mutual_information(a, b, bins=8) < 0.001
    # the stated bias, to first order in bins by pixels: there are four pixels for each of 256² pairs of bins
    for bins, within in ((128, 0.05), (256, 0.1)):
        expected = (bins - 1) ** 2 / (2 * math.log(2) * 512**2)
        assert mutual_information(a, b, bins=bins) == pytest.approx(expected, rel=within)


def test_mutual_information_of_two_bits() -> None:
    quarters = np.repeat(np.array([[0.1, 0.4, 0.6, 0.9]]), 4, axis=0)
    assert mutual_information(quarters, quarters) == pytest.approx(2)
    assert mutual_information(quarters, quarters > 0.5) == pytest.approx(1)
    assert mutual_information(quarters, quarters.T) == pytest.approx(0, abs=1e-12)


def test_constant_images_correlate_with_nothing() -> None:
    for level in (0.0, 0.1, 1 / 3, 1.0):
        flat = np.full(CAMERA.shape, level)
        assert cross_correlation(flat, CAMERA) == cross_correlation(CAMERA, flat) == cross_correlation(flat, flat) == 0
        assert mutual_information(flat, CAMERA) == pytest.approx(0, abs=1e-9)


def test_bytes_and_lists() -> None:
    levels = data.camera()[::8, ::8]
    for measure in (cross_correlation, mutual_information, ssim, psnr):
        expected = measure(levels / 255.0, 1 - levels / 255.0)
        assert measure(levels, 255 - levels) == pytest.approx(expected)
        assert measure(torch.from_numpy(levels), (1 - levels / 255.0).tolist()) == pytest.approx(expected)


def test_ssim_is_that_of_scikit_image(random: np.random.Generator) -> None:
    for size in ((7, 7), (40, 33), (128, 128)):
        a = random.random(size)
        b = np.clip(a + 0.2 * random.standard_normal(size), 0, 1)
        assert ssim(a, b) == pytest.approx(structural_similarity(a, b, data_range=1), abs=1e-13)


def test_ssim_needs_its_window() -> None:
    assert math.isnan(ssim(CAMERA[:6], CAMERA[:6]))
    assert ssim(CAMERA[:7], CAMERA[:7]) == pytest.approx(1)


def test_psnr_is_that_of_scikit_image(random: np.random.Generator) -> None:
    for noise in (1e-6, 1e-3, 0.1, 1.0):
        other = (CAMERA + noise * random.standard_normal(CAMERA.shape)).clip(0, 1)
        expected = peak_signal_noise_ratio(CAMERA, other, data_range=1.0)
        assert psnr(CAMERA, other) == psnr(other, CAMERA) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("measure", [cross_correlation, mutual_information, ssim, psnr])
def test_wrong_images(measure: Callable[..., float]) -> None:
    zeros = np.zeros((8, 8))
    for one, other, message in (
        (zeros, np.zeros((8, 9)), r"one shape \(H, W\), got \(8, 8\) and \(8, 9\)"),
        (zeros[None], zeros[None], r"\(1, 8, 8\): write image\.convert"),
        (zeros[None, None], zeros[None, None], r"write image\[0, 0\]"),
        (zeros, np.array([[0.0, 255.0]]).repeat(8, 0).repeat(4, 1), "images in 0…1, got values in 0 … 255"),
        (zeros, zeros * np.nan, "nan"),
    ):
        with pytest.raises(ValueError, match=message):
            measure(one, other)


# --- viewpoints

# quarters of degrees: sums of them are exact, and edges of all divisions are among them
AZIMUTHS = st.integers(-4 * 1080, 4 * 1080).map(lambda quarters: quarters / 4)
DIVISIONS = st.sampled_from(VIEW_COUNTS)


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
    assert near_view(true + 360 / views - 0.25, true, views)
    assert not near_view(true + 360 / views, true, views)
    if azimuth_error(result, true) == 0:
        assert same_view(result, true, views)
    if same_view(result, true, views):
        assert azimuth_error(result, true) <= 360 / views
    assert same_view(result, true, views) == same_view(result + 360, true - 720, views)


COMPARISONS = (azimuth_error, partial(same_view, views=4), partial(near_view, views=4))
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
    assert rotation_error(np.zeros((4, 1, 3)), np.zeros((5, 3))).shape == (4, 5)


def test_wrong_angles() -> None:
    wrong: list[tuple[Callable[..., object], object, object, str]] = [
        (rotation_error, [0, 0], [0, 0], "along the last axis, got shape"),
        (rotation_error, [0, math.nan, 0], [0, 0, 0], "NaN or infinity"),
        (rotation_error, np.zeros((2, 3)), np.zeros((5, 3)), "as many true angles"),
        *((compare, [1, 2, 3], [1, 2], "as many true angles") for compare in COMPARISONS),
        *(
            (azimuth_error, [0, bad], 0, "expected angles in degrees, got NaN or infinity")
            for bad in (math.nan, math.inf)
        ),
        (partial(same_view, views=4), 0, math.nan, "expected angles"),
    ]
    for compare, result, true, message in wrong:
        with pytest.raises(ValueError, match=message):
            compare(result, true)
    with pytest.raises(TypeError, match="real numbers"):
        azimuth_error([[1, 2], [3]], 10)  # type: ignore[list-item]
    for truth in (True, [[False], [True]]):
        with pytest.raises(TypeError, match="got truth values"):
            azimuth_error(truth, 10)


@pytest.mark.parametrize("measure", [view, partial(same_view, 0), partial(near_view, 0)])
def test_the_number_of_views_is_limited(measure: Callable[..., np.ndarray]) -> None:
    for views in (0, -4, 65_537):
        with pytest.raises(ValueError, match="views must be"):
            measure(0, views=views)
    with pytest.raises((ValueError, TypeError), match="views must be"):
        measure(0, views=4.5)
    for views in (1, 65_536):
        measure(0, views=views)


def test_a_palette_is_colours() -> None:
    levels = (CAMERA * 255).round().astype(np.uint8)
    turned = PIL.Image.fromarray(255 - levels).convert("L").quantize(256)  # whose indices are in another order
    gray = np.asarray(turned.convert("L"))
    for measure in (cross_correlation, mutual_information, psnr):
        assert measure(PIL.Image.fromarray(gray), levels) == measure(gray, levels)
    with pytest.raises(ValueError, match=r"one shape \(H, W\), got .*3"):
        cross_correlation(turned, levels)
