"""The kernels in Triton: the same values and derivatives as the reference steps, in all dialects."""

from __future__ import annotations

import math
from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import pytest
import torch
import triton
import triton.language as tl
from packaging.version import Version
from torch import Tensor
from torch.testing import assert_close

from nablahog.hog import GlobalNorm, HOGSpec, hog
from nablahog.hog.descriptor import Backend, histograms
from nablahog.hog.engine import make_step
from nablahog.hog.steps import histograms_reference
from nablahog.hog.triton import steps
from nablahog.hog.triton.votes import _arccosine as arccosine

from ...golden import PEERS, Case, cases
from ..zoo import PRESETS, SPECS, bytes_of, integers, noise, spec, waves
from .conftest import DEVICE

DTYPES = [torch.float32, torch.float64]
# reciprocal roots of a GPU are not the nearest numbers; the interpreter of Triton 3.8 rounds a · b in a · b + c
SINGLE = 1e-6 if DEVICE.type == "cpu" and Version(triton.__version__) >= Version("3.9") else 2e-6
# one of each rule that votes, borders and kinks are decided by
KINKS = [
    "replicate",
    "zero-largest",
    "uoctti",
    "uoctti-hard",
    "skimage",
    "opencv-signed",
    "counterclockwise",
    "derivative",
]


def computed(x: Tensor, s: HOGSpec, backend: Backend = "triton") -> tuple[Tensor, Tensor]:
    """Cells (B, rows, cols, colours · bins) and their vjp."""
    x = x.detach().to(DEVICE if backend == "triton" else "cpu").requires_grad_()
    result = histograms(x, s, backend=backend).permute(0, 2, 3, 1)
    return result.detach().cpu(), torch.autograd.grad(result, x, waves(result))[0].cpu()


def assert_same(x: Tensor, s: HOGSpec) -> None:
    """As the reference in float64, or in float32 if the angle is VLFeat's, relative to the largest entry."""
    of_float = s.angle == "vlfeat"  # an arccosine of a float32 whatever the image
    tolerance = SINGLE if x.dtype == torch.float32 or of_float else 1e-11
    for got, of_reference in zip(computed(x, s), computed(x if of_float else x.double(), s, "torch"), strict=True):
        assert got.shape == of_reference.shape
        assert got.dtype == x.dtype
        of_reference = of_reference.to(x.dtype)
        size = float(of_reference.abs().max()) or 1.0
        assert_close(got / size, of_reference / size, rtol=0, atol=tolerance)


def channels(s: HOGSpec) -> int:
    """Of images that show what is special about the dialect."""
    return 1 if s.colour == "gray" and s != SPECS["paper"] else 3


def cells_of(s: HOGSpec) -> HOGSpec:
    """The dialect up to its cells: they alone are computed by kernels."""
    return replace(s, name="", normalizer=s.normalizer if s.pooling.has_blocks else GlobalNorm(), layout="cells")


DIALECTS = {cells_of(s): name for name, s in reversed(SPECS.items())}.values()


def rules_of(s: HOGSpec) -> tuple[str, ...]:
    return s.colour, s.vote, s.angle, s.boundary, s.directions, s.derivative


# of presets, in float32, too: one for each rule; the others take long in the interpreter
RULES = {rules_of(SPECS[name]): name for name in PRESETS}.values()
IN_FLOAT64 = [
    pytest.param(name, torch.float64, marks=[pytest.mark.xslow] * (name in ("maskfeat-plain", "maskfeat-window")))
    for name in DIALECTS
]
IN_FLOAT32 = [pytest.param(name, torch.float32, marks=[pytest.mark.xslow] * (name not in RULES)) for name in PRESETS]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "dtype"), [*IN_FLOAT64, *IN_FLOAT32], ids=str)
def test_cells_and_derivatives_are_those_of_the_reference(name: str, dtype: torch.dtype) -> None:
    """In 14 rows, which one program of the vjp takes."""
    assert_same(noise(1, channels(SPECS[name]), 14, 13, dtype=dtype), SPECS[name])


@pytest.mark.slow
@pytest.mark.parametrize("name", KINKS)
def test_on_kinks_too(name: str) -> None:
    """Few gray levels: gradients of zero, on bin centres, and on the diagonals, with the derivatives agreed upon."""
    assert_same(integers(1, channels(SPECS[name]), 14, 13, levels=3), SPECS[name])


@pytest.mark.slow
@pytest.mark.parametrize("bins", [8, 16])
def test_diagonals_that_are_bin_centres(bins: int) -> None:
    """The reference finds them in float64 only."""
    s = spec(signed=True, bins=bins, bin_offset=0.0)
    for dtype in DTYPES:
        x = integers(1, 1, 12, 12, levels=2, dtype=dtype)
        assert_same(x, s)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["paper", "uoctti-hard", "dpm", "dlib", "skimage-colour", "opencv", "ties-opencv", "maskfeat"]
)
def test_of_bytes_every_vote_is_the_same(name: str) -> None:
    """Colour ties and bins of hard votes are decided alike."""
    s, x = SPECS[name], bytes_of(20, 19)
    plain = histograms_reference(x, s).permute(0, 2, 3, 1)
    got = histograms(x.to(DEVICE), s, backend="triton").permute(0, 2, 3, 1).cpu()
    assert_close(got, plain, rtol=0, atol=1e-6 * float(plain.max()))


@pytest.mark.xslow
@pytest.mark.parametrize("case", [case for peer in PEERS for case in cases(peer)], ids=str)
def test_stored_outputs_of_other_programs(case: Case) -> None:
    """As near as the reference is, whose distance from them ``tests/hog/test_golden.py`` tests."""
    s, dtype = case.spec, case.dtype
    image = case.image.to(dtype) / 255
    plain = hog(image, s, layout="native", backend="torch")[0]
    got = hog(image.to(DEVICE), s, layout="native", backend="triton")[0].cpu()
    assert got.shape == case.stored.shape
    assert_close(got, plain, rtol=0, atol=1e-6 * max(float(plain.abs().max()), 1.0))


@pytest.mark.slow
@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16])
def test_halves_are_read_as_they_are(dtype: torch.dtype) -> None:
    x = noise(1, 3, 9, 10).to(dtype)
    for name in ("paper", "uoctti"):
        s = SPECS[name]
        (cells, grad), (wide, grad_wide) = computed(x, s), computed(x.float(), s)
        assert torch.equal(cells, wide)
        assert grad.dtype == dtype
        assert_close(grad, grad_wide.to(dtype))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["uoctti", "cells-separate"])
def test_any_strides(name: str) -> None:
    """Channels last, a window of a larger image, one turned, and one expanded: without a copy."""
    s, x = SPECS[name], noise(1, 3, 9, 10).to(DEVICE)
    turned = x.transpose(2, 3).contiguous().transpose(2, 3)
    window = torch.nn.functional.pad(x, (2, 3, 1, 4))[:, :, 1:10, 2:12]
    plain = hog(x, s, backend="triton")
    for same in (x.contiguous(memory_format=torch.channels_last), turned, window):
        assert not same.is_contiguous()
        assert torch.equal(hog(same, s, backend="triton"), plain)
    gray = noise(1, 1, 9, 10).to(DEVICE).expand(1, 3, 9, 10)
    assert torch.equal(hog(gray, s, backend="triton"), hog(gray.contiguous(), s, backend="triton"))


@pytest.mark.slow
@pytest.mark.parametrize("shape", [(1, 1, 4, 4), (1, 1, 5, 70), (1, 2, 37, 4), (1, 5, 9, 8)])
def test_odd_sizes(shape: tuple[int, ...]) -> None:
    """One cell, several programs a row or column, and numbers of channels that are no colours."""
    for name in ("replicate", "zero-largest", *["sobel"] * (shape[1] == 2)):
        assert_same(noise(*shape), SPECS[name])


@pytest.mark.slow
@pytest.mark.parametrize("size", [(20, 18), (19, 1), (1, 19)])
def test_cells_wider_than_what_a_lane_reads_at_once(size: tuple[int, int]) -> None:
    s = spec(cell_size=size, vote="hard", partial_cells="ceil")
    x = noise(1, 1, size[0] + 3, size[1] + 2)
    result, plain = computed(x, s)[0], histograms_reference(x, s).permute(0, 2, 3, 1)
    assert_close(result, plain, rtol=0, atol=1e-12 * float(plain.max()))


@pytest.mark.slow
def test_planes_that_are_far_apart() -> None:
    """More than 2³¹ numbers from the first channel to the last: places take 64 bits.  Most of it is never touched."""
    apart, s = 1_100_000_000, SPECS["uoctti"]
    memory = torch.empty(2 * apart + 64, dtype=torch.uint8, device=DEVICE)
    near = torch.randint(256, (1, 3, 8, 8), dtype=torch.uint8).to(DEVICE)
    far = memory.as_strided((1, 3, 8, 8), (64, apart, 8, 1)).copy_(near)
    results, saved = zip(*(steps.flagged_cells(x, s) for x in (near, far)), strict=True)
    assert torch.equal(*results)
    assert torch.equal(*(steps.flagged_cells_vjp(x, saved[0], results[0], s) for x in (near, far)))


def test_an_empty_batch() -> None:
    for name in ("uoctti", "paper", "opencv", "cells-separate"):
        x = torch.zeros(0, 3, 16, 16, requires_grad=True, device=DEVICE)
        descriptors = hog(x, SPECS[name], backend="triton")
        assert descriptors.shape == hog(torch.zeros(0, 3, 16, 16), SPECS[name]).shape
        assert torch.autograd.grad(descriptors.sum(), x)[0].shape == x.shape


@pytest.mark.parametrize("rows", [2047, 2048])
def test_the_largest_histograms_of_an_image(rows: int) -> None:
    """Their places take 31 bits.  Nothing is computed of an empty batch."""
    s = spec(cell_size=(1, 1), bins=512)
    with nullcontext() if rows == 2047 else pytest.raises(ValueError, match="fewer than 2³¹ cells · bins an image"):
        hog(torch.zeros(0, 1, rows, 2048, device=DEVICE), s, backend="triton")


@pytest.mark.slow
def test_a_batch_is_its_images_and_every_run_is_the_same() -> None:
    s, x = SPECS["uoctti"], noise(2, 3, 9, 13, dtype=torch.float32).to(DEVICE)
    together = hog(x, s, backend="triton")
    assert torch.equal(hog(x, s, backend="triton"), together)
    for image, descriptor in zip(x, together, strict=True):
        assert torch.equal(hog(image[None], s, backend="triton")[0], descriptor)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "value"),
    [("paper", math.inf), *((name, math.nan) for name in ("uoctti", "skimage", "cells-separate"))],
)
def test_a_pixel_that_is_not_finite_makes_its_image_nan(name: str, value: float) -> None:
    """In a part of the image that no cell sees, too; and no other image."""
    s, x = SPECS[name], noise(2, 3, 11, 11)
    x[1, 2, 10, 10] = value
    for each in (hog(x.to(DEVICE), s, backend="triton").cpu(), *computed(x, s)):
        assert each[1].isnan().all()
        assert torch.isfinite(each[0]).all()


@pytest.mark.slow
def test_transforms_and_second_derivatives() -> None:
    s, x = SPECS["uoctti"], noise(2, 1, 8, 8).to(DEVICE)

    def describe(images: Tensor, backend: Any = "triton") -> Tensor:
        return hog(images, s, backend=backend)

    mapped = torch.func.vmap(lambda image: describe(image[None])[0])(x)
    assert_close(mapped, describe(x))
    grads = [torch.func.grad(lambda z, by=by: describe(z, by).square().sum())(x) for by in ("triton", "torch")]
    assert_close(*grads, rtol=0, atol=1e-12)

    def product(by: Any) -> Tensor:  # of the Hessian and a vector
        z = x.clone().requires_grad_()
        (grad,) = torch.autograd.grad(describe(z, by).square().sum(), z, create_graph=True)
        return torch.autograd.grad((grad * waves(x, 30)).sum(), z)[0]

    assert_close(product("triton"), product("torch"), rtol=0, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper", "uoctti"])
def test_the_step_of_graphs_that_were_exported_on_a_cpu(name: str) -> None:
    s, x = SPECS[name], noise(2, 3, 9, 13).to(DEVICE)
    x[1, 0, 8, 12] = math.nan
    step = make_step(steps.TritonDescribe, s, x.shape[1:], x.dtype, x.dtype)
    descriptors, saved = step.run(x)
    z = x.clone().requires_grad_()
    plain = hog(z, s, backend="torch")
    assert_close(descriptors, plain, rtol=0, atol=1e-11, equal_nan=True)
    grad = torch.autograd.grad(plain, z, waves(plain))[0]
    assert_close(step.vjp(x, saved, waves(plain)), grad, rtol=0, atol=1e-9, equal_nan=True)


@triton.jit
def _arccosines(cosines: Any, angles: Any, count: tl.constexpr) -> None:
    at = tl.arange(0, count)
    tl.store(angles + at, arccosine(tl.load(cosines + at)))


def test_the_arccosine_is_exact_to_rounding() -> None:
    cosines = torch.linspace(0.86, 1, 256, device=DEVICE)
    angles = torch.empty_like(cosines)
    _arccosines[1,](cosines, angles, 256)
    assert_close(angles, torch.acos(cosines.double()).float(), rtol=1e-6, atol=0)
