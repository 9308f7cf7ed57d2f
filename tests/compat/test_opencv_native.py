"""The native loops of ``compat.opencv`` beside the plain steps, which run where there is no native library."""

from __future__ import annotations

import ctypes
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from skimage import data

from nablahog import native
from nablahog.compat.opencv import HOGDescriptor
from nablahog.compat.opencv.multi_scale import resized
from nablahog.compat.opencv.windows import Constants, Padded

pytestmark = pytest.mark.skipif(not native.available(), reason="no native library")

# cells of a block across and down, rows of blocks that overlap, bins and gamma differ
DESCRIPTORS = {
    "default": (),
    "small": ((16, 24), (8, 8), (4, 8), (4, 4), 6),
    "3x1 cells, gaps": ((40, 20), (12, 6), (14, 7), (4, 6), 18, 1, 2.0, 0, 0.1, True, 64, True),
    "2x5 cells, dense": ((12, 17), (6, 15), (2, 1), (3, 3), 7, 1, -1, 0, 0.3, False, 64, True),
}


def image(channels: int, height: int = 150, width: int = 90) -> np.ndarray:
    """Of few levels, so that channels tie."""
    return np.ascontiguousarray(data.astronaut()[30 : 30 + height, 200 : 200 + width, :channels]) // 16 * 16


def with_and_without(monkeypatch: pytest.MonkeyPatch, call: Any) -> tuple[Any, Any]:
    loops = call()
    monkeypatch.setattr(native, "available", lambda: False)
    return loops, call()


@pytest.mark.parametrize("arguments", DESCRIPTORS.values(), ids=DESCRIPTORS)
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("options", [{}, {"winStride": (5, 3), "padding": (40, 8)}, {"locations": [(0, 3), (17, 11)]}])
def test_descriptors(
    arguments: tuple[Any, ...], channels: int, options: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    loops, plain = with_and_without(monkeypatch, lambda: HOGDescriptor(*arguments).compute(image(channels), **options))
    assert loops.any()
    assert_allclose(loops, plain, rtol=0, atol=2e-6)


@pytest.mark.parametrize("arguments", DESCRIPTORS.values(), ids=DESCRIPTORS)
def test_scores(arguments: tuple[Any, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    descriptor = HOGDescriptor(*arguments)
    descriptor.setSVMDetector(np.random.default_rng(0).standard_normal(descriptor.getDescriptorSize() + 1))
    options = {"hitThreshold": -1e6, "winStride": (3, 5), "padding": (6, 6)}
    (places, loops), (_, plain) = with_and_without(monkeypatch, lambda: descriptor.detect(image(3), **options))
    assert len(places) > 4
    assert_allclose(loops, plain, rtol=0, atol=2e-5)


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("size", [(37, 43), (1, 6), (2, 1)])
def test_gradients(channels: int, size: tuple[int, int], monkeypatch: pytest.MonkeyPatch) -> None:
    (loops, bins), (plain, plain_bins) = with_and_without(
        monkeypatch, lambda: HOGDescriptor().computeGradient(image(channels, *size), None, None, (3, 9), (5, 0))
    )
    assert_allclose(loops, plain, rtol=0, atol=1e-5)
    assert_array_equal(bins, plain_bins)


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("size", [(71, 133), (90, 149), (1, 1), (200, 3)])
def test_smaller_images(channels: int, size: tuple[int, int], monkeypatch: pytest.MonkeyPatch) -> None:
    assert_array_equal(*with_and_without(monkeypatch, lambda: resized(image(channels), size)))


@pytest.mark.parametrize(("struct", "name"), [(Padded, "PaddedImage"), (Constants, "Scheme")])
def test_structs_have_the_same_fields_on_both_sides(struct: type[ctypes.Structure], name: str) -> None:
    header = (Path(__file__).parents[2] / "src/nablahog/native/opencv_votes.h").read_text()
    (body,) = re.findall(rf"struct {name} {{(.*?)}};", header, re.DOTALL)
    types = {"int64_t": ctypes.c_int64, "float": ctypes.c_float, "const uint8_t*": ctypes.c_void_p}
    fields: list[tuple[str, Any]] = []
    for kind, names in re.findall(r"^  (int64_t|float|const uint8_t\*) ([\w, \[\]]+);", body, re.MULTILINE):
        for field, count in re.findall(r"(\w+)(?:\[(\d+)\])?", names):
            fields.append((field, types[kind] * int(count) if count else types[kind]))
    assert struct._fields_ == fields
