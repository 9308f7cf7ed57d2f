"""Strips of a descriptor are those of the whole image's, bit by bit."""

from __future__ import annotations

import re
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor
from torch.testing import assert_close

from nablahog.hog import HOGSpec, hog, presets, stream
from nablahog.hog.kernels.loops import supports

from .zoo import SPECS, fits, threads

LEAST = 1  # byte: a row of the descriptor at a time
dtypes = st.sampled_from([np.uint8, np.float32, np.float64])


def picture(height: int, width: int, channels: int, dtype: Any, seed: int = 0) -> npt.NDArray[Any]:
    """(H, W, C) of few levels, so that there are ties."""
    levels = np.random.default_rng(seed).integers(0, 24, (height, width, channels)) * 11
    return levels.astype(np.uint8) if dtype == np.uint8 else (levels / 255).astype(dtype)


def whole(image: npt.NDArray[Any], s: HOGSpec) -> Tensor:
    return hog(torch.from_numpy(image.reshape(*image.shape[:2], -1)).permute(2, 0, 1)[None], s)[0]


def joined(image: Any, s: HOGSpec, memory: int = LEAST) -> tuple[Tensor, int]:
    """All strips as one, once it is known that they are side by side, and how many there are."""
    strips = list(stream(image, s, memory=memory))
    ends = [0, *(strip.rows.stop for strip in strips)]
    assert [strip.rows.start for strip in strips] == ends[:-1]
    assert [len(strip.descriptor) for strip in strips] == [strip.rows.stop - strip.rows.start for strip in strips]
    return torch.from_numpy(np.concatenate([strip.descriptor for strip in strips])), len(strips)


def same(got: Tensor, expected: Tensor) -> bool:
    """Bit by bit."""
    kinds = (got.dtype, got.shape), (expected.dtype, expected.shape)
    return kinds[0] == kinds[1] and got.numpy().tobytes() == expected.numpy().tobytes()


def assert_streams(image: npt.NDArray[Any], s: HOGSpec, memory: int = LEAST) -> int:
    got, count = joined(image, s, memory)
    expected = whole(image, s)
    if supports(s):
        assert same(got, expected)
    else:  # matrix products of other sizes are rounded otherwise
        assert_close(got, expected, rtol=1e-6, atol=1e-6)
    return count


@pytest.mark.slow
@pytest.mark.parametrize("name", SPECS)
@given(
    height=st.integers(1, 120),
    width=st.integers(1, 30),
    channels=st.integers(1, 4),
    dtype=dtypes,
    seed=st.integers(0, 99),
    memory=st.sampled_from([LEAST, 10_000, 50_000]),
)
@settings(max_examples=5)
def test_every_dialect(name: str, height: int, width: int, channels: int, dtype: Any, seed: int, memory: int) -> None:
    s = SPECS[name]
    channels = channels if s.colour != "separate" else 2 * (channels % 2) + 1
    if fits(s, channels, height, width):
        assert_streams(picture(height, width, channels, dtype, seed), s, memory)


@pytest.mark.parametrize("name", SPECS)
def test_there_are_strips(name: str) -> None:
    """Of so few bytes a row at a time, or two if no image begins anew at every row."""
    s = SPECS[name]
    rows = s.grid(220, 21)[0]
    assert rows / 2 <= assert_streams(picture(220, 21, 3, np.float32), s) <= rows


@pytest.mark.parametrize("name", ["paper", "uoctti", "opencv"])
def test_of_large_images_in_several_threads(name: str) -> None:
    image, s = picture(700, 400, 3, np.uint8), SPECS[name]
    expected = whole(image, s)
    with threads(2):
        assert same(joined(image, s, 2**20)[0], expected)
        assert same(whole(image, s), expected)


def test_bytes_follow_the_default_dtype() -> None:
    image = picture(40, 24, 3, np.uint8)
    torch.set_default_dtype(torch.float64)
    try:
        for s in (presets.paper(4), presets.uoctti(4)):
            assert joined(image, s)[0].dtype == torch.float64
            assert_streams(image, s)
    finally:
        torch.set_default_dtype(torch.float32)


@pytest.mark.parametrize("order", ["=", ">", "<"])
def test_a_mapped_file(tmp_path: Path, order: str) -> None:
    image, path = picture(90, 40, 3, np.float32), tmp_path / "image.npy"
    np.save(path, image.astype(np.dtype(np.float32).newbyteorder(order)))  # type: ignore[arg-type]
    mapped = np.load(path, mmap_mode="r")
    assert same(joined(mapped, presets.dlib())[0], whole(image, presets.dlib()))
    assert same(joined(mapped[3:, ::2], presets.dlib())[0], whole(image[3:, ::2].copy(), presets.dlib()))
    assert np.array_equal(mapped, image)


class Recorded:
    """An image that tells which rows were asked for."""

    def __init__(self, image: npt.NDArray[Any], gives: Any = None) -> None:
        self.shape, self.dtype, self.image = image.shape, image.dtype, image
        self.asked: list[tuple[int, int]] = []
        self.gives = gives

    def __getitem__(self, rows: slice) -> Any:
        assert rows.step is None
        self.asked.append((rows.start, rows.stop))
        return self.image[rows] if self.gives is None else self.gives


@pytest.mark.parametrize(("make", "times"), [(presets.uoctti, 1), (presets.skimage, 1), (presets.paper, 2)])
def test_rows_are_read_when_they_are_needed(make: Any, times: int) -> None:
    image = Recorded(picture(4000, 32, 1, np.uint8))
    strips = stream(image, make(), memory=2**17)
    assert image.asked == []
    count = 1 + sum(1 for _ in strips)
    assert len(image.asked) == times * (count - 1)
    one = image.asked[: count - 1]
    assert one == sorted(one)
    assert (one[0][0], one[-1][1]) == (0, 4000)
    assert all(0 < below[0] <= above[1] for above, below in pairwise(one))
    longest = max(stop - start for start, stop in one)
    assert longest < 1000
    assert sum(stop - start for start, stop in one) < 1.5 * 4000


def test_descriptors_and_the_default_dtype_count_as_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    image, memory, lengths = Recorded(picture(4000, 32, 1, np.uint8)), 2**18, []
    for dtype in (torch.float32, torch.float64):
        monkeypatch.setattr(torch, "get_default_dtype", lambda dtype=dtype: dtype)
        strip = next(stream(image, presets.skimage(), memory=memory))
        assert 2 * strip.descriptor.nbytes < memory  # it is nine times as large as its histograms
        lengths.append(image.asked[-1][1])
    assert lengths[1] < 0.6 * lengths[0]


@pytest.mark.parametrize("shape", [(8,), (8, 8, 0), (3, 8)])
def test_refused_at_once(shape: tuple[int, ...]) -> None:
    """Before the first strip."""
    with pytest.raises(ValueError, match=rf"got (an image of 3x8|{re.escape(str(shape))})$"):
        stream(np.zeros(shape, np.uint8), presets.uoctti())
    with pytest.raises(ValueError, match=r"^memory must be "):
        stream(np.zeros((16, 16), np.uint8), presets.uoctti(), memory=0)


@pytest.mark.parametrize("gives", [np.zeros((3, 8), np.uint8), np.zeros((16, 8)), np.zeros((16, 8, 1), np.uint8)])
def test_rows_that_are_others_than_announced(gives: Any) -> None:
    image = Recorded(np.zeros((16, 8), np.uint8), gives)
    with pytest.raises(ValueError, match=r"^rows 0 … 15 of an image of shape \(16, 8\) and dtype uint8 came with"):
        list(stream(image, presets.uoctti()))


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="no peak of memory to read")
@pytest.mark.parametrize("name", ["uoctti", "paper"])
def test_the_peak_of_memory(name: str, tmp_path: Path) -> None:
    """Of an image that takes 24 MB, and its descriptor five times that, in strips of 4 MB."""
    path = tmp_path / "image.npy"
    np.lib.format.open_memmap(path, mode="w+", dtype=np.uint8, shape=(24_000, 1_000))
    program = f"""
import numpy as np, torch
from nablahog.hog import presets, stream
torch.set_num_threads(1)
def peak():
    return int(next(line for line in open("/proc/self/status") if line.startswith("VmHWM")).split()[1]) * 1024
spec = presets.{name}()
for _ in stream(np.zeros((300, 1000), np.uint8), spec, memory=2**22): pass
before = peak()
for _ in stream(np.load({str(path)!r}, mmap_mode="r"), spec, memory=2**22): pass
print(peak() - before)"""
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=300)
    assert ended.returncode == 0, ended.stderr
    assert int(ended.stdout) < 12e6
