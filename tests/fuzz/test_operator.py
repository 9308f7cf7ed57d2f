"""The compiled operator beside the plain steps: any dialect, size, strides, dtype and values.

Faults are: a descriptor, vjp or jvp that differs from that of the plain steps in the same dtype; a finite one where a
pixel is not finite; one that is not finite where pixels and plain steps are.
"""

from __future__ import annotations

import math
from functools import partial
from typing import NamedTuple

import pytest
import torch
from hypothesis import strategies as st
from torch import Tensor

from nablahog.hog import HOGSpec, hog
from nablahog.hog.descriptor import histograms

from .corpus import stored_cases
from .harness import examine, parts
from .specs import Shape, shapes, specs

pytestmark = pytest.mark.filterwarnings("ignore:images of floats have values far beyond")  # the huge ones
DTYPES = {"float64": torch.float64, "float32": torch.float32, "uint8": torch.uint8}
STRIDES = ("contiguous", "channels last", "every second pixel", "transposed", "expanded")
VALUES = ("noise", "noise", "noise", "few levels", "constant", "one pixel", "not finite", "huge", "denormal")
VALUE_TOLERANCE = {"float64": 1e-9, "float32": 2e-4, "uint8": 2e-4}  # of the largest entry
ROOT_TOLERANCE = 3e-3  # of the root of a rounding error where there should be nothing
DERIVATIVE_TOLERANCE = {"float64": 1e-6, "float32": 2e-2}
INEXACT_TOLERANCE = 1e-4  # of an angle in float32


class Case(NamedTuple):
    """Images of a shape in a dialect: how they are stored, and what they hold."""

    spec: HOGSpec
    shape: Shape
    dtype: str
    strides: str
    values: str
    seed: int


@st.composite
def cases(draw: st.DrawFn) -> Case:
    spec = draw(specs())
    choices = (draw(st.sampled_from(each)) for each in (sorted(DTYPES), STRIDES, VALUES))
    return Case(spec, draw(shapes(spec)), *choices, draw(st.integers(0, 2**31)))


def images_of(case: Case) -> Tensor:
    """Its images, contiguous."""
    random, shape = torch.Generator().manual_seed(case.seed), case.shape
    noise = torch.rand(shape, generator=random, dtype=torch.float64)
    images = {
        "few levels": (noise * 4).floor() / 4,
        "constant": torch.full(shape, 0.3, dtype=torch.float64),
        "one pixel": (torch.arange(noise.numel()) == case.seed % noise.numel()).double().reshape(shape),
        "huge": noise * 10.0 ** (3 + case.seed % 300),
        "denormal": noise * 10.0 ** -(3 + case.seed % 320),
    }.get(case.values, noise)
    if case.dtype == "uint8":
        return (images.clamp(0, 1) * 255).byte()
    images = images.to(DTYPES[case.dtype])
    if case.values == "not finite":
        images.view(-1)[case.seed % images.numel()] = (math.nan, math.inf, -math.inf)[case.seed % 3]
    return images


def strided(images: Tensor, how: str) -> Tensor:
    """The same values in another order of memory; what lies between them is NaN."""
    if how == "channels last":
        return images.contiguous(memory_format=torch.channels_last)
    if how == "every second pixel":
        between = math.nan if images.is_floating_point() else 255
        around = images.new_full((*images.shape[:2], 2 * images.shape[2] + 3, 2 * images.shape[3] + 5), between)
        return around[:, :, 1 : 1 + 2 * images.shape[2] : 2, 2 : 2 + 2 * images.shape[3] : 2].copy_(images)
    if how == "transposed":
        return images.transpose(-1, -2).contiguous().transpose(-1, -2)
    return images[:1].contiguous().expand(images.shape) if how == "expanded" else images


def largest(x: Tensor) -> float:
    return float(x.abs().max()) if x.numel() else 0.0


def compare(what: str, got: Tensor, expected: Tensor, tolerance: float, rounding: float = 0.0) -> None:
    """Equal within ``tolerance`` of the largest entry, or within ``rounding``."""
    assert (got.shape, got.dtype) == (expected.shape, expected.dtype), what
    if expected.isfinite().all():
        assert got.isfinite().all(), f"{what}: not finite, where the plain steps are"
        error, scale = largest(got - expected), largest(expected)
        assert error <= max(tolerance * scale, rounding), f"{what}: off by {error:.1e} of {scale:.1e}"


def rounding_of(spec: HOGSpec, images: Tensor, descriptor: Tensor, weights: float) -> float:
    """Rounding errors of a derivative that is a sum of terms which may cancel.

    A term is at most an entry of the descriptor by the length of its cell's histogram.
    """
    lengths = histograms(images, spec, backend="torch").square().sum(1).sqrt()
    shortest = float(lengths[lengths > 0].min()) if (lengths > 0).any() else 1.0
    return 1e3 * torch.finfo(images.dtype).eps * weights * largest(descriptor) * spec.value_range / shortest


def rounding_decides(case: Case) -> bool:
    """Whether derivatives are not compared.

    1/√v of votes v near 0; magnitudes near the ends of the dtype; directions that are bin centres up to rounding.
    There the derivative jumps, and the mean of both sides is taken only at the centre as it is rounded.
    """
    spec, ties = case.spec, case.values not in ("noise", "not finite")
    linear = "linear" in (spec.vote, spec.derivative)
    moved = spec.bin_offset not in (0, 0.5)  # the centres of bins, by perhaps less than a rounding
    roots = spec.gamma == "sqrt" and case.values == "few levels"  # of quarters: tangents such as √3, of 60°, and √2 - 1
    inexact = case.dtype == "float32" or (linear and (spec.angle != "exact" or moved or roots))
    if case.values in ("huge", "denormal"):
        return True
    if getattr(spec.normalizer, "form", "") == "L1-sqrt":
        return inexact or ties
    return inexact and ties and linear


def check(case: Case) -> str:
    """Compares both backends in value, vjp and jvp."""
    spec, mine = case.spec, strided(images_of(case), case.strides)
    images = mine.clone(memory_format=torch.contiguous_format)
    plain, compiled = (partial(hog, spec=spec, backend=backend) for backend in ("torch", "auto"))
    root = getattr(spec.normalizer, "form", "") == "L1-sqrt" and case.dtype != "float64"
    tolerance = ROOT_TOLERANCE if root else VALUE_TOLERANCE[case.dtype]
    if case.dtype == "uint8":
        compare("descriptor", compiled(mine), plain(images), tolerance)
        return "bytes"
    random = torch.Generator().manual_seed(case.seed + 1)
    descriptor, vjp = torch.func.vjp(compiled, mine)
    expected, expected_vjp = torch.func.vjp(plain, images)
    weights = torch.rand(descriptor.shape, generator=random, dtype=images.dtype)
    tangent = torch.rand(images.shape, generator=random, dtype=images.dtype) - 0.5
    dual = images if case.strides == "expanded" else mine  # no other memory does in PyTorch's forward mode
    pairs = {
        "descriptor": (descriptor, expected),
        "vjp": (vjp(weights)[0], expected_vjp(weights)[0]),
        "jvp": tuple(torch.func.jvp(f, (x,), (tangent,))[1] for f, x in ((compiled, dual), (plain, images))),
    }
    finite = images.isfinite().flatten(1).all(1)
    inexact = INEXACT_TOLERANCE if spec.vote == "linear" and spec.angle != "exact" else 0.0
    for what, (got, other) in pairs.items():
        assert case.values in ("huge", "denormal") or other[finite].isfinite().all(), f"{what}: plain steps"
        for each in (got, other):
            assert each[~finite].isnan().all(), f"{what}: a number where a pixel is not finite"
        rounding = 0.0
        if what != "descriptor":
            tolerance = DERIVATIVE_TOLERANCE[case.dtype]
            rounding = rounding_of(spec, images[finite], expected[finite], images.shape[1] * largest(weights))
        if what == "descriptor" or not rounding_decides(case):
            compare(what, got[finite], other[finite], max(tolerance, inexact), rounding)
    return "compared"


@pytest.mark.slow
@pytest.mark.parametrize("case", stored_cases("operator", Case))
def test_cases_that_once_failed(case: Case) -> None:
    check(case)


@pytest.mark.slow
@parts
def test_random_cases(part: int) -> None:
    examine(check, cases(), 120, part)
