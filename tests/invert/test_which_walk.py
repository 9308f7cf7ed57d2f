"""Arrays as other programs leave them: decided and right, or undecided, with what they look like."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from skimage import data, feature

import nablahog
from nablahog import presets, which_hog

cv2 = pytest.importorskip("cv2")

Array = NDArray[np.floating]


def photograph(name: str = "astronaut", width: int = 64, height: int = 128) -> NDArray[np.uint8]:
    return np.asarray(Image.fromarray(getattr(data, name)()).convert("L").resize((width, height)))


def skimage(name: str = "astronaut", width: int = 64, height: int = 128, norm: str = "L2-Hys") -> Array:
    vector: Array = feature.hog(photograph(name, width, height), cells_per_block=(2, 2), block_norm=norm)
    return vector


def opencv(name: str = "astronaut", width: int = 64, height: int = 128, stride: int = 8) -> Array:
    hog = cv2.HOGDescriptor((width, height), (16, 16), (stride, stride), (8, 8), 9)
    vector: Array = hog.compute(photograph(name, width, height)).ravel()
    return vector


def ours(preset: str, width: int = 64, height: int = 128) -> Array:
    image = np.dstack([photograph("astronaut", width, height)] * 3)
    return nablahog.hog(image, getattr(presets, preset)(), layout="native")


def in_one_row(count: int) -> Array:
    return np.concatenate([skimage(name, 64, 64) for name in SQUARES[:count]])


SQUARES = ("astronaut", "camera", "coffee", "chelsea")

DECIDED: dict[str, tuple[Callable[[], Array], str, tuple[int, int]]] = {
    "six decimals": (lambda: skimage().round(6), "skimage", (128, 64)),
    "five decimals": (lambda: skimage("coffee", 64, 64).round(5), "skimage", (64, 64)),
    "seven decimals of L1": (lambda: skimage(norm="L1").round(7), "skimage", (128, 64)),
    "six decimals of OpenCV": (lambda: opencv().round(6), "opencv", (128, 64)),
    "five decimals of VLFeat": (lambda: ours("vlfeat").ravel().round(5), "vlfeat", (128, 64)),
    "float32": (lambda: skimage().astype(np.float32), "skimage", (128, 64)),
}
MATRIX = in_one_row(3).reshape(3, -1)
ASKED: dict[str, tuple[Callable[[], Array], str]] = {
    "four decimals": (lambda: skimage().round(4), "rounded"),
    "bytes": (lambda: np.uint8(255 * opencv()), "rounded"),
    "two images in a row": (
        lambda: np.concatenate([skimage(name, 64, 64) for name in SQUARES[:2]]),
        "reshape(2, 1764)",
    ),
    "four images in a row": (lambda: in_one_row(4), "reshape(4, 1764)"),
    "OpenCV's columns and rows": (lambda: opencv().reshape(7, 15, 36), "ravel()"),
    "OpenCV's rows and columns": (lambda: opencv().reshape(15, 7, 36), "lines of 15"),
    "axes of MATLAB": (lambda: ours("dlib", 64, 96).T, "transpose"),
    "a narrow image": (lambda: ours("vlfeat", 200, 32).ravel(), "narrow"),
    "a narrow image of FHOG": (lambda: ours("piotr", 200, 32).ravel(), "narrow"),
    "three blocks cut off": (lambda: opencv(width=128, height=64)[:-108], ""),
    "nine blocks cut off": (lambda: opencv()[:-324], ""),
    "blocks that share no cells": (lambda: opencv(stride=16), ""),
    "places in rows": (lambda: opencv().reshape(105, 36), "ravel()"),
    "places of VLFeat in rows": (lambda: ours("vlfeat").reshape(31, -1).T, "ravel()"),
    "a column of labels": (lambda: np.c_[[-1, 1, -1], MATRIX], "first column"),
    "a column of labels at the end": (lambda: np.c_[MATRIX, [0, 1, 0]], "last"),
    "descriptors in columns": (lambda: MATRIX.T, ".T"),
    "a factor": (lambda: skimage(norm="L2") * 0.95, ""),
}


@pytest.mark.parametrize("name", DECIDED)
def test_decided_and_right(name: str) -> None:
    make, preset, size = DECIDED[name]
    found = which_hog(make())
    assert found.decided_by
    assert (found.candidates[0].preset, found.candidates[0].image_size) == (preset, size)


@pytest.mark.parametrize("name", ASKED)
def test_asked_about(name: str) -> None:
    make, words = ASKED[name]
    found = which_hog(make())
    assert not found.decided_by
    assert words in found.remark


ASSUMED: dict[str, tuple[Callable[[], Array], str]] = {
    "windows without overlap": (
        lambda: (
            cv2.HOGDescriptor((64, 64), (16, 16), (8, 8), (8, 8), 9)
            .compute(photograph("gravel", 128, 128), (64, 64))
            .ravel()
        ),
        "several in a row",
    ),
    "reversed OpenCV": (lambda: opencv()[::-1], "reverse"),
    "reversed scikit-image": (lambda: skimage()[::-1], "reverse"),
    "VLFeat with axes of NumPy": (lambda: np.moveaxis(ours("vlfeat"), 0, 2), "vlfeat"),
    "a stride of 4": (lambda: opencv(stride=4), "block_stride"),
}


@pytest.mark.parametrize("name", ASSUMED)
def test_what_may_be_wrong_is_assumed(name: str) -> None:
    make, words = ASSUMED[name]
    found = which_hog(make())
    assert not found.decided_by or words in found.assumed
