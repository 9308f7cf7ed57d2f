"""The compiled steps and their derivatives are those of the reference steps, at kinks and in any number of threads."""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from nablahog.compat.opencv import HOGDescriptor
from nablahog.hog import BlockCells, BlockNorm, FourBlockNorm, HOGSpec, hog
from nablahog.hog.descriptor import Backend, histograms, normalize
from nablahog.hog.engine import REFERENCE
from nablahog.hog.kernels.loops import NATIVE_ENGINE, find_loops, supports
from nablahog.hog.steps import histograms_reference, normalize_reference

from ..zoo import SPECS, bytes_of, integers, noise, spec, threads, waves

BACKENDS: tuple[Backend, ...] = ("auto", "torch")
DTYPES = [torch.float32, torch.float64]
dtypes = pytest.mark.parametrize("dtype", DTYPES, ids=["float32", "float64"])
COMPILED = [name for name, s in SPECS.items() if supports(s)]
specs = pytest.mark.parametrize("name", COMPILED)


def channels(s: HOGSpec) -> int:
    """Of images that show what is special about the dialect."""
    return 1 if s.colour == "gray" else 3


def with_derivatives(step: Any, x: Tensor, s: HOGSpec) -> tuple[Tensor, Tensor, Tensor]:
    """A step's result, its vjp and its jvp, with a fixed cotangent and tangent."""
    x = x.detach().requires_grad_()
    result = step(x, s)
    (derivative,) = torch.autograd.grad(result, x, waves(result))
    changed = torch.func.jvp(lambda of: step(of, s), (x.detach(),), (waves(x.detach(), 30),))[1]
    return result.detach(), derivative, changed


def assert_same(compiled_step: Any, reference_step: Any, x: Tensor, s: HOGSpec) -> None:
    """Up to rounding, relative to the largest entry; the reference in float64, where diagonals are exact.

    Unless the dialect's angle is float32 whatever the image.
    """
    exact_input = x.double() if s.angle == "exact" else x
    for got, exact in zip(
        with_derivatives(compiled_step, x, s), with_derivatives(reference_step, exact_input, s), strict=True
    ):
        assert got.shape == exact.shape
        assert got.dtype == x.dtype
        size = float(exact.abs().max()) or 1.0
        # of the float32 arctangent, and of a difference of nearly equal gray values in float32
        tolerance = 2e-5 if x.dtype == torch.float32 else 1e-11 if s.angle == "exact" else 1e-6
        assert_close(got.double() / size, exact.double() / size, rtol=0, atol=tolerance)


@dtypes
@specs
def test_histograms_are_those_of_the_reference(name: str, dtype: torch.dtype) -> None:
    s = SPECS[name]
    assert_same(histograms, histograms_reference, noise(3, channels(s), 17, 14, dtype=dtype), s)


@dtypes
@specs
def test_on_kinks_too(name: str, dtype: torch.dtype) -> None:
    """Few gray levels: gradients of zero, on bin centres, and on the diagonals, with the derivatives agreed upon."""
    s = SPECS[name]
    if dtype == torch.float32 and (s.gamma == "sqrt" or s.mask == "sobel"):
        pytest.skip("roots and sums are not exact: whether two components are equal depends on the last digit")
    assert_same(histograms, histograms_reference, integers(3, 1, 17, 14, levels=3, dtype=dtype), s)


@specs
def test_of_bytes_every_vote_is_the_same(name: str) -> None:
    """Colour ties and bins of hard votes are decided alike."""
    s, x = SPECS[name], bytes_of(30, 29)
    plain = histograms_reference(x, s)
    assert_close(histograms(x, s), plain, rtol=0, atol=2e-6 * float(plain.max()))


@dtypes
@pytest.mark.parametrize("bins", [8, 16])
def test_diagonals_that_are_bin_centres(bins: int, dtype: torch.dtype) -> None:
    s = spec(signed=True, bins=bins, bin_offset=0.0)
    assert_same(histograms, histograms_reference, integers(2, 1, 16, 16, levels=2, dtype=dtype), s)


@dtypes
@pytest.mark.parametrize("directions", ["float32", "four-decimals"])
@pytest.mark.parametrize("orientations", [4, 5, 6, 7, 8, 9, 12])
def test_hard_votes_on_diagonals(orientations: int, directions: str, dtype: torch.dtype) -> None:
    """Which lie exactly between two bins if there are six, ten, fourteen …"""
    s = spec(vote="hard", directions=directions, bin_offset=0.0, bins=2 * orientations, signed=True, value_range=255.0)
    x = integers(2, 1, 40, 40, levels=16, dtype=dtype)
    plain = histograms_reference(x, s)
    assert_close(histograms(x, s), plain, rtol=0, atol=1e-5 * float(plain.max()))


@specs
def test_a_batch_is_its_images(name: str) -> None:
    s, x = SPECS[name], noise(5, 3, 24, 31, dtype=torch.float32)
    together = hog(x, s)
    for image, descriptor in zip(x, together, strict=True):
        assert torch.equal(hog(image[None], s)[0], descriptor)


def test_an_empty_batch() -> None:
    x = torch.zeros(0, 1, 16, 16, requires_grad=True)
    descriptors = hog(x, SPECS["uoctti"])
    assert descriptors.shape == (0, 4, 4, 31)
    assert torch.autograd.grad(descriptors.sum(), x)[0].shape == x.shape


@dtypes
@specs
def test_normalisers_are_those_of_the_reference(name: str, dtype: torch.dtype) -> None:
    s = SPECS[name]
    x = noise(2, s.colours * s.bins, 5, 6, dtype=dtype)
    x[0, :, 0] = 0  # empty cells
    x[1, :, 2] *= 1e-3
    assert_same(normalize, normalize_reference, x, s)


def test_an_entry_exactly_at_the_clip() -> None:
    """2 / √(4 · (2² + 2²) + 4) is; its derivative is the mean of those on both sides."""
    x = torch.tensor([2.0, 2.0, 0.0, 0.0], dtype=torch.float64).view(1, 4, 1, 1)
    s = spec(signed=True, bins=4, normalizer=FourBlockNorm(epsilon=4.0, clip=1 / 3))
    assert_same(normalize, normalize_reference, x, s)
    at, below, above = (
        with_derivatives(normalize, x, replace(s, normalizer=FourBlockNorm(epsilon=4.0, clip=clip)))[1:]
        for clip in (1 / 3, 0.33, 0.34)
    )
    for middle, first, second in zip(at, below, above, strict=True):
        assert float((first - second).abs().max()) > 0.01
        assert_close(middle, (first + second) / 2)


@specs
def test_any_strides(name: str) -> None:
    """Channels last, a window of a larger image, and one turned and expanded: without a copy, or with."""
    s, x = SPECS[name], noise(2, 3, 18, 21)
    expected = with_derivatives(hog, x, s)
    turned = x.transpose(2, 3).contiguous().transpose(2, 3)
    window = torch.nn.functional.pad(x, (2, 3, 1, 4))[:, :, 1:19, 2:23]
    for same in (x.contiguous(memory_format=torch.channels_last), turned, window):
        assert not same.is_contiguous()
        assert torch.equal(hog(same, s), expected[0])
        assert_close(with_derivatives(hog, same, s)[1], expected[1], rtol=0, atol=1e-12)
    gray = noise(1, 1, 18, 21).expand(2, 3, 18, 21)
    assert torch.equal(hog(gray, s), hog(gray.contiguous(), s))


def test_which_dialects_have_loops() -> None:
    assert [name for name, s in SPECS.items() if not supports(s)] == ["sobel", "sobel-separate"]
    assert find_loops(SPECS["sobel"]) is REFERENCE
    assert find_loops(SPECS["uoctti"]) is NATIVE_ENGINE


@pytest.mark.slow
@pytest.mark.parametrize("signed", [False, True])
def test_right_angles_are_kinks_of_any_number_of_bins(signed: bool) -> None:
    """Bin centres at 0° and 90°, where a derivative is the mean of both sides."""
    stripes = torch.arange(12.0, dtype=torch.float64).square() / 144
    images = torch.stack([stripes.expand(12, 12), stripes.expand(12, 12).T, stripes.flip(0).expand(12, 12)])[:, None]
    for bins in range(3, 41):
        s = spec(bins=bins, signed=signed, bin_offset=0.0, cell_size=(4, 4))
        assert_same(histograms, histograms_reference, images, s)


def test_huge_gradients_of_empty_bins_cancel_nowhere() -> None:
    """1/√v of a bin with v = 1e-285 votes is not part of a derivative of other bins, and leaves them their digits."""
    for seed in range(20):
        s = spec(
            mask="sobel",
            cell_size=(4, 4),
            normalizer=BlockNorm((2, 2), (2, 2), "L1-sqrt"),
            pooling=BlockCells((8, 8), (4, 4), 0.1),
        )
        x = noise(1, 1, 12, 13, seed=seed)
        results = [with_derivatives(lambda z, of, by=backend: hog(z, of, backend=by), x, s) for backend in BACKENDS]
        for got, expected in zip(*results, strict=True):
            assert_close(got, expected, rtol=1e-9, atol=1e-12 * float(expected.abs().max()))


_UNWRITTEN = """
import torch
from nablahog import hog, presets
from tests.hog.zoo import noise
for s, size in [(presets.vlfeat(cell_size=3), (30, 2)), (presets.dpm(4), (12, 12)), (presets.skimage(), (30, 29))]:
    x, grads = noise(1, 1, *size), []
    for backend in ("auto", "torch"):
        z = x.clone().requires_grad_()
        hog(z, s, backend=backend).sum().backward()
        grads.append(z.grad)
    torch.testing.assert_close(*grads)
"""


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only glibc fills fresh memory")
def test_no_unwritten_memory_is_read() -> None:
    """Where no column votes, too: fresh memory is filled with 1e306."""
    environment = {**os.environ, "MALLOC_PERTURB_": "128"}
    subprocess.run([sys.executable, "-c", _UNWRITTEN], check=True, env=environment, timeout=300)


@pytest.mark.parametrize("name", ["paper", "uoctti", "opencv", "skimage", "maskfeat"])
def test_threads_change_nothing(name: str) -> None:
    """Neither in a batch nor in one large image: every sum is made in the same order."""
    s = SPECS[name]
    for x in (noise(5, 3, 40, 40, dtype=torch.float32), noise(1, 3, 300, 310, dtype=torch.float32)):
        cotangent, results = noise(*hog(x, s).shape, dtype=torch.float32), []
        x.requires_grad_()
        for count in (1, 2, 3):
            with threads(count):
                descriptor = hog(x, s)
                results.append((descriptor, *torch.autograd.grad(descriptor, x, cotangent)))
        for one, other in zip(results[0] * 2, results[1] + results[2], strict=True):
            assert torch.equal(one, other)


@pytest.mark.usefixtures("two_threads")
def test_nan_in_the_rows_of_one_thread_reaches_all() -> None:
    s, x = SPECS["uoctti"], noise(1, 3, 300, 310, dtype=torch.float32)
    x[0, 2, -1, 0] = torch.nan
    x.requires_grad_()
    descriptor = hog(x, s)
    (grad,) = torch.autograd.grad(descriptor.sum(), x)
    assert descriptor.isnan().all()
    assert grad.isnan().all()


def test_in_threads_of_the_callers_own() -> None:
    s, images = SPECS["uoctti"], [noise(1, 3, 40, 40, seed=k) for k in range(8)]
    with ThreadPoolExecutor(4) as pool:
        for image, descriptor in zip(images, pool.map(lambda x: hog(x, s), images), strict=True):
            assert torch.equal(descriptor, hog(image, s))


def _in_a_fork(queue: Any) -> None:
    hog(noise(1, 3, 400, 600), SPECS["uoctti"])  # of a new size, whose tables PyTorch computes
    torch.set_num_threads(2)
    queue.put(hog(noise(4, 1, 40, 40), SPECS["uoctti"]).numpy())


@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")  # which threads in general may not survive
def test_in_forked_workers() -> None:
    with threads(2):
        noise(1, 1, 2000, 2000).sqrt()  # OpenMP's threads do not come along, nor do ours
        expected = hog(noise(4, 1, 40, 40), SPECS["uoctti"])
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    worker = context.Process(target=_in_a_fork, args=(queue,))
    worker.start()
    descriptor = torch.from_numpy(queue.get(timeout=60))
    worker.join(timeout=60)
    assert worker.exitcode == 0
    assert torch.equal(descriptor, expected)


@dataclass(frozen=True)
class HalfBlocks(BlockNorm):
    """One of a user's own that begins with one that has a loop."""

    kind: ClassVar[str] = "half-blocks"

    def normalize(self, histograms: Tensor, signed: bool) -> Tensor:
        return super().normalize(histograms, signed) / 2


def test_a_normaliser_of_a_kind_that_is_not_compiled_runs_as_it_is() -> None:
    blocks = spec(normalizer=BlockNorm((2, 2), epsilon=0.1))
    image = noise(2, 1, 20, 17).requires_grad_()
    halves = hog(image, replace(blocks, normalizer=HalfBlocks((2, 2), epsilon=0.1)))
    assert_close(halves, hog(image, blocks) / 2, rtol=0, atol=1e-12)
    halves.sum().backward()


def test_cells_are_freed_after_the_backward_pass() -> None:
    descriptor = hog(noise(1, 1, 24, 24).requires_grad_(), SPECS["uoctti"])
    node: Any = descriptor.grad_fn
    while node.name() != "_RunSimplyBackward":
        node = node.next_functions[0][0]
    descriptor.sum().backward(retain_graph=True)
    assert len(node.saved_tensors) == 2
    descriptor.sum().backward()
    assert not [value for value in vars(node).values() if isinstance(value, Tensor)]
    with pytest.raises(RuntimeError, match="freed"):
        _ = node.saved_tensors


@specs
def test_without_a_graph_the_result_is_the_same(name: str) -> None:
    """Cells are then not kept."""
    s = SPECS[name]
    for x in (noise(2, 3, 24, 31), noise(1, 3, 300, 310)):
        with_graph = hog(x.clone().requires_grad_(), s).detach()
        assert torch.equal(hog(x, s), with_graph)


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="reads its memory in /proc")
def test_many_calls_take_no_more_memory_than_a_few() -> None:
    x, image = noise(1, 1, 512, 512).requires_grad_(), np.zeros((256, 256), np.uint8)
    opencv = HOGDescriptor()

    def memory_after_calls() -> int:
        """Bytes that the process has."""
        for _ in range(60):
            hog(x, "uoctti").sum().backward()
            opencv.computeGradient(image, None, None)
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    with threads(2):
        before = memory_after_calls()
        assert memory_after_calls() < before + 2**22
