"""What ``hog`` refuses."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from nablahog.hog import hog, presets


def assert_one_sentence(message: str) -> None:
    assert "\n" not in message
    assert 20 < len(message) < 160


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
    "dtype", [torch.float16, torch.bfloat16, torch.int8, torch.int16, torch.int64, torch.bool, torch.complex64]
)
def test_hog_refuses_other_dtypes(dtype: torch.dtype) -> None:
    with pytest.raises(TypeError, match=r"^images must be float32 or float64 in 0…1, or uint8 in 0…255, got ") as error:
        hog(torch.zeros(1, 1, 8, 8, dtype=dtype), presets.paper())
    assert str(dtype) in str(error.value)
    assert_one_sentence(str(error.value))


@pytest.mark.parametrize("shape", [(7, 8), (8, 7), (0, 8), (8, 0), (1, 1)])
def test_hog_refuses_images_smaller_than_a_cell(shape: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match=r"^the image must hold at least one cell of 8x8 pixels") as error:
        hog(torch.zeros(1, 1, *shape), presets.paper())
    assert "{}x{}".format(*shape) in str(error.value)
    assert_one_sentence(str(error.value))
