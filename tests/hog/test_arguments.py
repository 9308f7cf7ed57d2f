"""What ``hog`` refuses."""

from __future__ import annotations

import re
import subprocess
import sys
import warnings
from typing import Any

import numpy as np
import pytest
import torch

from nablahog.hog import HOG, hog, presets


def assert_one_sentence(message: str) -> None:
    assert "\n" not in message
    assert 20 < len(message) < 190


@pytest.mark.parametrize("images", [None, 3, "image", [[0.0]]])
def test_hog_refuses_what_is_no_image(images: Any) -> None:
    with pytest.raises(TypeError, match=r"^images must be a torch tensor \(B, C, H, W\), .*, got \w+$") as error:
        hog(images, presets.paper())
    assert_one_sentence(str(error.value))


@pytest.mark.parametrize("shape", [(), (8,), (8, 8), (3, 8, 8), (1, 1, 3, 8, 8), (1, 0, 8, 8)])
def test_hog_refuses_other_shapes(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=r"^images must have shape \(B, C, H, W\) with at least one channel") as error:
        hog(torch.zeros(shape), presets.paper())
    assert str(shape) in str(error.value)
    assert_one_sentence(str(error.value))


@pytest.mark.parametrize(
    "dtype", [torch.float8_e5m2, torch.int8, torch.int16, torch.int64, torch.bool, torch.complex64]
)
def test_hog_refuses_other_dtypes(dtype: torch.dtype) -> None:
    with pytest.raises(TypeError, match=r"^images must be floats in 0…1, or uint8 in 0…255, got ") as error:
        hog(torch.zeros(1, 1, 8, 8, dtype=dtype), presets.paper())
    assert str(dtype) in str(error.value)
    assert_one_sentence(str(error.value))


@pytest.mark.parametrize("shape", [(7, 8), (8, 7), (0, 8), (8, 0), (1, 1)])
def test_hog_refuses_images_smaller_than_a_cell(shape: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match=r"^the image must hold at least one cell of 8x8 pixels") as error:
        hog(torch.zeros(1, 1, *shape), presets.paper())
    assert "{}x{}".format(*shape) in str(error.value)
    assert_one_sentence(str(error.value))


@pytest.mark.parametrize(
    ("shape", "write"), [((8, 8), "images[None, None]"), ((3, 8, 8), "images[None] for one image (C, H, W)")]
)
def test_hog_says_what_to_write(shape: tuple[int, ...], write: str) -> None:
    with pytest.raises(ValueError, match=re.escape(f", got {shape}: write {write}")):
        hog(torch.zeros(shape), presets.paper())


@pytest.mark.parametrize("spec", ["hog", "Skimage", ""])
def test_presets_of_other_names_are_refused(spec: str) -> None:
    with pytest.raises(ValueError, match=rf"^spec must be a HOGSpec or one of aubry, .*, got {spec!r}$"):
        hog(torch.zeros(1, 1, 8, 8), spec)
    with pytest.raises(ValueError, match=r"^spec must be a HOGSpec or one of aubry"):
        HOG(spec)


def test_a_spec_is_a_spec_or_a_name() -> None:
    with pytest.raises(TypeError, match=r"^spec must be a HOGSpec or the name of a preset, got function$"):
        hog(torch.zeros(1, 1, 8, 8), presets.paper)  # type: ignore[call-overload]


def test_other_layouts_are_refused() -> None:
    with pytest.raises(ValueError, match=r"^layout must be one of 'cells', 'native', got 'planes'$"):
        hog(torch.zeros(1, 1, 8, 8), "paper", layout="planes")  # type: ignore[call-overload]


ODD_IMAGES = {
    "0…255": (torch.full((1, 1, 16, 16), 255.0), "uoctti", "divide those in 0…255 by 255, or pass uint8"),
    "0…255 as an array": (np.full((16, 16), 255.0), "uoctti", "divide those in 0…255 by 255"),
    "standardised": (torch.linspace(2.6, -2.1, 768).reshape(1, 3, 16, 16), "paper", "far beyond 0…1"),
    "halves": (torch.full((1, 1, 16, 16), 255.0, dtype=torch.half), "uoctti", "divide those in 0…255 by 255"),
    "RGBA": (torch.zeros(1, 4, 16, 16), "uoctti", r"images have 4 channels, .* write images\[:, :3\]"),
    "colours": (torch.zeros(1, 3, 24, 24), "skimage", r"write presets\.skimage\(channel_axis=-1\)"),
}


@pytest.mark.parametrize("case", ODD_IMAGES)
def test_images_that_are_seldom_meant_are_asked_about(case: str) -> None:
    images, spec, words = ODD_IMAGES[case]
    with pytest.warns(UserWarning, match=words) as warned:
        hog(images, spec)
    assert [warning.filename for warning in warned] == [__file__]


@pytest.mark.parametrize("channels", [1, 2, 3, 5])
@pytest.mark.parametrize("spec", ["paper", "uoctti", "opencv", presets.skimage(channel_axis=-1)])
def test_others_are_not(channels: int, spec: Any) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        images = torch.rand(1, channels, 64, 64)
        hog(images, spec)
        hog(2 * images - 0.5, spec)  # a filter may overshoot
        hog((255 * images).byte(), spec)


def test_a_line_is_warned_of_once() -> None:
    """After the first call, which may compile: changes of Python's filters, as of libraries that load, begin anew."""
    program = """import torch, nablahog
for white in (1, 255, 255, 255):
    nablahog.hog(torch.full((1, 1, 8, 8), float(white)), "paper")"""
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120)
    assert ended.returncode == 0, ended.stderr
    assert ended.stderr.count("far beyond 0…1") == 1
