"""What docs/which_hog.md says goes wrong most often, figure by figure."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from skimage import color, data
from skimage.feature import hog as skimage_hog
from torch import Tensor

from nablahog.dialects.common_form import same_channels
from nablahog.dialects.describer import Describer
from nablahog.dialects.ties import ties
from nablahog.hog import HOGSpec, hog

from .common import SPECS, distance, entries, percent, photograph


@pytest.mark.parametrize(
    ("name", "tied", "level", "apart", "share"),
    [("astronaut", 4.0, 1.4, 0.118, 97), ("camera", 13.8, 12.4, 0.322, 100)],
)
def test_ties(name: str, tied: float, level: float, apart: float, share: int) -> None:
    image = photograph(name)
    describer = Describer(image)
    result = ties(describer, SPECS["dpm"])
    assert round(100 * (result.between_bins or 0), 1) == tied
    assert round(100 * (ties(describer, SPECS["skimage"]).between_bins or 0), 1) == level
    between = distance(SPECS["dpm"], SPECS["piotr"], image=image)
    assert round(between.distance, 3) == apart
    assert percent(between)["bin ties"] == share
    if name == "astronaut":
        assert round(100 * (result.between_colours or 0), 1) == 2.0
    else:
        form = same_channels(SPECS["dpm"], SPECS["piotr"])
        assert distance(SPECS["dpm"], SPECS["piotr"], form, image).largest == pytest.approx(0.4)


def test_texture_of_vlfeat_and_dpm() -> None:
    vlfeat, dpm = entries("astronaut", SPECS["vlfeat"])[1:-1, 1:-1], entries("astronaut", SPECS["dpm"])[..., :31]
    assert (vlfeat - dpm)[..., :27].abs().max() < 1e-6
    assert round((vlfeat - dpm)[..., 27:].abs().max().item(), 2) == 0.42
    assert round((vlfeat[..., 27:] - dpm[..., [30, 28, 29, 27]]).abs().max().item(), 2) == 0.16


def test_matlab() -> None:
    """Its mode measures angles from the other axis, on an image whose axes are exchanged."""
    image = photograph("astronaut")[:, :128, 100:240]
    vlfeat = SPECS["vlfeat"]
    there = hog(image[None], vlfeat)[0]
    transposed = replace(vlfeat, counterclockwise=True, bin_offset=13.5)
    back = hog(image[None].transpose(2, 3), transposed)[0].transpose(0, 1)
    torch.testing.assert_close(back[..., :27], there[..., :27], rtol=0, atol=1e-6)
    torch.testing.assert_close(back[..., [27, 29, 28, 30]], there[..., 27:], rtol=0, atol=1e-6)
    plain = hog(image[None].transpose(2, 3), vlfeat)[0].transpose(0, 1)
    assert (plain - there).abs().max().item() == pytest.approx(0.4)


def test_ranges() -> None:
    def moved(spec: HOGSpec) -> Tensor:
        one, other = (entries("astronaut", replace(spec, value_range=most)) for most in (1.0, 255.0))
        return (one - other).abs()

    assert round(moved(SPECS["seeing3d"]).max().item(), 2) == 0.37
    assert round(moved(SPECS["vlfeat"]).max().item(), 2) == 0.18
    assert round(moved(SPECS["vlfeat"]).square().mean().sqrt().item(), 3) == 0.005
    assert round(moved(SPECS["maskfeat"]).max().item(), 2) == 0.21
    assert moved(SPECS["skimage"]).square().mean().sqrt().item() < 1e-4


def test_grays() -> None:
    levels = data.astronaut()[:256, :256]
    cv2 = pytest.importorskip("cv2")
    eq1 = cv2.cvtColor(levels, cv2.COLOR_RGB2GRAY).astype(float)
    ours = skimage_hog(eq1)
    theirs, largest = skimage_hog(color.rgb2gray(levels) * 255), skimage_hog(levels, channel_axis=-1)
    assert round(abs(theirs - ours).max(), 2) == 0.21
    assert round(float(np.sqrt(np.mean((theirs - ours) ** 2))), 3) == 0.023
    assert round(float(np.sqrt(np.mean((largest - ours) ** 2))), 3) == 0.033


def test_opencv(tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    window = np.ascontiguousarray(data.astronaut()[40:168, 190:254])
    sizes = (64, 128), (16, 16), (8, 8), (8, 8), 9

    def computed(pixels: Any, gamma: bool) -> Any:
        return cv2.HOGDescriptor(*sizes, 1, -1, 0, 0.2, gamma).compute(np.ascontiguousarray(pixels))

    assert cv2.HOGDescriptor().gammaCorrection is True
    assert cv2.HOGDescriptor(*sizes).gammaCorrection is False
    default = cv2.HOGDescriptor().compute(window)
    without = cv2.HOGDescriptor(*sizes).compute(window)
    assert round(float(abs(default - without).max()), 2) == 0.10
    assert round(float(np.sqrt(np.mean((default - without) ** 2))), 3) == 0.019
    turned = window[..., ::-1]
    assert round(float(abs(computed(window, False) - computed(turned, False)).max()), 2) == 0.02
    assert abs(default - computed(turned, True)).max() == 0
    grays = [cv2.cvtColor(window, code) for code in (cv2.COLOR_RGB2GRAY, cv2.COLOR_BGR2GRAY)]
    assert round(float(abs(computed(grays[0], True) - computed(grays[1], True)).max()), 2) == 0.06
    np.save(tmp_path / "window.npy", window)
    fresh, after = (_thresholds(tmp_path, *thresholds) for thresholds in ((0.05,), (0.2, 0.05)))
    assert abs(after - default).max() == 0
    assert round(float(abs(after - fresh).max()), 2) == 0.18


def _thresholds(folder: Path, *thresholds: float) -> Any:
    """The last of several descriptors of one process."""
    program = (
        "import cv2, numpy, sys\n"
        "window = numpy.load('window.npy')\n"
        "for threshold in map(float, sys.argv[1:]):\n"
        "    hog = cv2.HOGDescriptor((64, 128), (16, 16), (8, 8), (8, 8), 9, 1, -1, 0, threshold, True)\n"
        "    found = hog.compute(window)\n"
        "numpy.save('found.npy', found)\n"
    )
    subprocess.run([sys.executable, "-c", program, *map(str, thresholds)], cwd=folder, check=True)
    return np.load(folder / "found.npy")
