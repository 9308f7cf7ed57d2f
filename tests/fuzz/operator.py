"""The compiled operator beside the plain steps: any dialect, size, strides, dtype and values.

Wrong is: a descriptor, vjp or jvp that is not that of the plain steps in the same dtype; anything finite where a pixel
is not; anything that is not where pixels and plain steps are.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import torch
from hypothesis import strategies as st
from torch import Tensor

from nablahog.hog import HOGSpec, hog
from nablahog.hog.descriptor import histograms
from nablahog.hog.kernels import supports

from .harness import Fault
from .specs import Shape, shapes, specs

DTYPES = {"float64": torch.float64, "float32": torch.float32, "uint8": torch.uint8}
STRIDES = ("contiguous", "channels last", "every second pixel", "transposed", "expanded")
VALUES = ("noise", "noise", "noise", "few levels", "constant", "one pixel", "not finite", "huge", "denormal")
VALUE_TOLERANCE = {"float64": 1e-9, "float32": 2e-4, "uint8": 2e-4}  # of the largest entry
ROOT_TOLERANCE = 3e-3
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
def _cases(draw: st.DrawFn) -> Case:
    spec = draw(specs())
    return Case(
        spec,
        draw(shapes(spec)),
        draw(st.sampled_from(sorted(DTYPES))),
        draw(st.sampled_from(STRIDES)),
        draw(st.sampled_from(VALUES)),
        draw(st.integers(0, 2**31)),
    )


cases = _cases()


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
        around = images.new_full((*images.shape[:2], 2 * images.shape[2] + 3, 2 * images.shape[3] + 5), 255)
        if images.is_floating_point():
            around.fill_(math.nan)
        inside = around[:, :, 1 : 1 + 2 * images.shape[2] : 2, 2 : 2 + 2 * images.shape[3] : 2]
        return inside.copy_(images)
    if how == "transposed":
        return images.transpose(-1, -2).contiguous().transpose(-1, -2)
    if how == "expanded":
        return images[:1].contiguous().expand(images.shape)
    return images


def _largest(x: Tensor) -> float:
    return float(x.abs().max()) if x.numel() else 0.0


def _compare(
    what: str, got: Tensor, expected: Tensor, tolerance: float, rounding: Callable[[], float] = lambda: 0.0
) -> None:
    """Raises Fault unless equal within ``tolerance`` of the largest entry, or within ``rounding``."""
    if got.shape != expected.shape or got.dtype != expected.dtype:
        raise Fault("wrong", f"{what}: {got.dtype} {tuple(got.shape)}, not {expected.dtype} {tuple(expected.shape)}")
    if not expected.isfinite().all():
        return
    if not got.isfinite().all():
        raise Fault("wrong", f"{what}: not finite, where the plain steps are")
    error, scale = _largest(got - expected), _largest(expected)
    if error > tolerance * scale and error > rounding():
        raise Fault("wrong", f"{what}: off by {error:.1e} of {scale:.1e}")


def _rounding(spec: HOGSpec, images: Tensor, descriptor: Tensor, weights: float) -> float:
    """Rounding errors of a derivative that is a sum of terms which may cancel.

    A term is at most an entry of the descriptor by the length of its cell's histogram.
    """
    lengths = histograms(images, spec, backend="torch").square().sum(1).sqrt()
    shortest = float(lengths[lengths > 0].min()) if (lengths > 0).any() else 1.0
    return 1e3 * torch.finfo(images.dtype).eps * weights * _largest(descriptor) * spec.value_range / shortest


def _value_tolerance(case: Case) -> float:
    root = getattr(case.spec.normalizer, "form", "") == "L1-sqrt"  # of a rounding error where there should be nothing
    return ROOT_TOLERANCE if root and case.dtype != "float64" else VALUE_TOLERANCE[case.dtype]


def _rounding_decides(case: Case) -> bool:
    """Whether derivatives are not compared.

    1/√v of votes v near 0; magnitudes near the ends of the dtype; diagonals that are bin centres up to rounding.
    """
    spec, ties = case.spec, case.values not in ("noise", "not finite")
    inexact = case.dtype == "float32" or (spec.vote == "linear" and spec.angle != "exact")
    if case.values in ("huge", "denormal"):
        return True
    if getattr(spec.normalizer, "form", "") == "L1-sqrt":
        return inexact or ties
    return inexact and ties and "linear" in (spec.vote, spec.derivative)


def check(case: Case) -> str:
    """Compares both backends in value, vjp and jvp."""
    spec, images = case.spec, images_of(case)
    mine = strided(images, case.strides)
    images = mine.clone(memory_format=torch.contiguous_format)
    plain, compiled = (lambda x, of=backend: hog(x, spec, backend=of) for backend in ("torch", "auto"))
    inexact = spec.vote == "linear" and spec.angle != "exact"
    if case.dtype == "uint8":
        _compare("descriptor", compiled(mine), plain(images), _value_tolerance(case))
        return "bytes"
    random = torch.Generator().manual_seed(case.seed + 1)
    descriptor, vjp = torch.func.vjp(compiled, mine)
    expected, expected_vjp = torch.func.vjp(plain, images)
    weights = torch.rand(descriptor.shape, generator=random, dtype=images.dtype)
    tangent = torch.rand(images.shape, generator=random, dtype=images.dtype) - 0.5
    dual = images if case.strides == "expanded" else mine  # no other memory does in PyTorch's forward mode
    results = descriptor, vjp(weights)[0], torch.func.jvp(compiled, (dual,), (tangent,))[1]
    expectations = expected, expected_vjp(weights)[0], torch.func.jvp(plain, (images,), (tangent,))[1]
    finite = images.isfinite().flatten(1).all(1)
    if case.values not in ("huge", "denormal") and not all(each[finite].isfinite().all() for each in expectations):
        raise Fault("wrong", "the plain steps are not finite for a finite image")
    for what, got, other in zip(("descriptor", "vjp", "jvp"), results, expectations, strict=True):
        if not (got[~finite].isnan().all() and other[~finite].isnan().all()):
            raise Fault("wrong", f"{what}: a number where a pixel is not finite")
    for what, got, other in zip(("descriptor", "vjp", "jvp"), results, expectations, strict=True):
        tolerance = _value_tolerance(case) if what == "descriptor" else DERIVATIVE_TOLERANCE[case.dtype]
        if what != "descriptor" and _rounding_decides(case):
            continue
        tolerance = max(tolerance, INEXACT_TOLERANCE) if inexact else tolerance
        rounding = partial(_rounding, spec, images[finite], expected[finite], images.shape[1] * _largest(weights))
        _compare(what, got[finite], other[finite], tolerance, rounding)
    return "compared" if supports(spec) else "plain steps alone"
