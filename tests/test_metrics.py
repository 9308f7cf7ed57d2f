"""The figures, on pairs whose values are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from skimage import data
from skimage.metrics import peak_signal_noise_ratio

from nablahog.metrics import (
    cross_correlation,
    euclidean_distance,
    mean_distance,
    mutual_information,
    normalised_error,
    psnr,
    ssim,
)

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


@pytest.mark.parametrize("level", [0.0, 0.1, 1 / 3, 1.0])
def test_constant_images_correlate_with_nothing(level: float) -> None:
    flat = np.full(CAMERA.shape, level)
    assert cross_correlation(flat, CAMERA) == cross_correlation(CAMERA, flat) == cross_correlation(flat, flat) == 0.0
    assert mutual_information(flat, CAMERA) == pytest.approx(0, abs=1e-9)


def test_bytes_and_lists() -> None:
    levels = data.camera()[::8, ::8]
    for measure in (cross_correlation, mutual_information, ssim, psnr, euclidean_distance):
        expected = measure(levels / 255.0, 1 - levels / 255.0)
        assert measure(levels, 255 - levels) == pytest.approx(expected)
        assert measure(torch.from_numpy(levels), (1 - levels / 255.0).tolist()) == pytest.approx(expected)


def test_ssim_needs_its_window() -> None:
    assert math.isnan(ssim(CAMERA[:6], CAMERA[:6]))
    assert ssim(CAMERA[:7], CAMERA[:7]) == pytest.approx(1)


@pytest.mark.parametrize("noise", [1e-6, 1e-3, 0.1, 1.0])
def test_psnr_is_that_of_scikit_image(noise: float, random: np.random.Generator) -> None:
    other = (CAMERA + noise * random.standard_normal(CAMERA.shape)).clip(0, 1)
    expected = peak_signal_noise_ratio(CAMERA, other, data_range=1.0)
    assert psnr(CAMERA, other) == psnr(other, CAMERA) == pytest.approx(expected, rel=1e-12)


def test_euclidean_distance(random: np.random.Generator) -> None:
    a, b = random.random((2, 3, 5))
    squares = [(a[i, j] - b[i, j]) ** 2 for i, j in np.ndindex(a.shape)]
    assert euclidean_distance(a, b) == pytest.approx(math.sqrt(sum(squares)))
    assert euclidean_distance(a, a) == 0
    assert psnr(a, b) == pytest.approx(-20 * math.log10(euclidean_distance(a, b) / math.sqrt(a.size)))


@pytest.mark.parametrize("count", [2, 3, 7])
def test_the_mean_distance_is_over_all_pairs(count: int, random: np.random.Generator) -> None:
    images = random.random((count, 6, 5))
    total = 0.0
    for i in range(count):
        for j in range(count):
            total += math.sqrt(float(((images[i] - images[j]) ** 2).sum()))
    assert mean_distance(images) == pytest.approx(total / (count * (count - 1)), rel=1e-12)
    assert mean_distance(reversed(images)) == pytest.approx(mean_distance(images), rel=1e-12)


def test_sets_without_a_mean_distance() -> None:
    assert math.isnan(mean_distance([]))
    assert math.isnan(mean_distance([CAMERA]))
    assert math.isnan(mean_distance([CAMERA, CAMERA, CAMERA[:-1]]))
    assert math.isnan(mean_distance([CAMERA[:8, :16], CAMERA[:16, :8]]))  # as many pixels
    assert mean_distance([CAMERA, CAMERA]) == 0


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (np.zeros((1, 8, 8)), r"expected an image \(H, W\), got \(1, 8, 8\)"),
        (np.zeros((0, 8)), r"got \(0, 8\)"),
        (np.full((8, 8), 2.0), "images in 0…1, got values in 2 … 2"),
        (np.full((8, 8), np.nan), "nan"),
    ],
)
def test_the_mean_distance_of_wrong_images(wrong: NDArray[np.float64], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        mean_distance([np.zeros((8, 8)), wrong])


def test_the_normalised_error(random: np.random.Generator) -> None:
    images = random.random((4, 6, 5))
    n = mean_distance(images)
    assert normalised_error(images[0], images[1], n) == euclidean_distance(images[0], images[1]) / n
    assert normalised_error(images[0], images[0], n) == 0
    # an answer that is another photograph of the set has an error of 1 in the mean
    errors = [normalised_error(a, b, n) for i, a in enumerate(images) for j, b in enumerate(images) if i != j]
    assert np.mean(errors) == pytest.approx(1)
    # it does not depend on the scale of gray values
    assert normalised_error(images[0] / 2, images[1] / 2, mean_distance(images / 2)) == pytest.approx(
        normalised_error(images[0], images[1], n)
    )


@pytest.mark.parametrize("measure", [cross_correlation, mutual_information, ssim, psnr, euclidean_distance])
def test_wrong_images(measure: object) -> None:
    assert callable(measure)
    with pytest.raises(ValueError, match=r"one shape \(H, W\), got \(8, 8\) and \(8, 9\)"):
        measure(np.zeros((8, 8)), np.zeros((8, 9)))
    with pytest.raises(ValueError, match="one shape"):
        measure(np.zeros((1, 8, 8)), np.zeros((1, 8, 8)))
    with pytest.raises(ValueError, match=r"images in 0…1, got values in 0 … 255"):
        measure(np.zeros((8, 8)), np.array([[0.0, 255.0]]).repeat(8, 0).repeat(4, 1))
    with pytest.raises(ValueError, match="nan"):
        measure(np.zeros((8, 8)), np.full((8, 8), np.nan))
