"""The figures, on pairs whose values are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from skimage import data
from skimage.metrics import peak_signal_noise_ratio

from nablahog.metrics import (
    cross_correlation,
    mutual_information,
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
    for measure in (cross_correlation, mutual_information, ssim, psnr):
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


@pytest.mark.parametrize("measure", [cross_correlation, mutual_information, ssim, psnr])
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
