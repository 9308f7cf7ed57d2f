"""Pre-images of any descriptor of any dialect: an image in 0…1, or a refusal in one sentence.

Faults are: an image of another shape, with NaN or outside 0…1, or a distance that is not the image's.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import pytest
import torch
from hypothesis import strategies as st
from torch import Tensor
from torch.testing import assert_close

from nablahog.hog import HOGSpec, from_layout, hog, to_layout
from nablahog.invert import Search, reconstruct
from nablahog.invert.reconstruction import relative_distance
from nablahog.optimize import MINIMISERS

from .corpus import stored_cases
from .harness import check_sentence, examine, parts
from .specs import Shape, shapes, specs

ENTRIES = ("image", "image", "image", "noise", "gaussian", "constant", "zero", "not finite", "huge", "tiny")
EVERY_MINIMISER = ("lbfgs", *MINIMISERS)  # L-BFGS more often
LARGEST = 24  # pixels a side
LONGEST = 30.0  # seconds


class Case(NamedTuple):
    """A descriptor in a dialect, of images of a shape: what its entries are, and how it is inverted."""

    spec: HOGSpec
    shape: Shape
    entries: str
    dtype: str
    minimiser: str
    native: bool
    seed: int


@st.composite
def cases(draw: st.DrawFn) -> Case:
    spec = draw(specs())
    choices = (draw(st.sampled_from(each)) for each in (ENTRIES, ("float32", "float64"), EVERY_MINIMISER))
    return Case(spec, draw(shapes(spec, LARGEST)), *choices, draw(st.booleans()), draw(st.integers(0, 2**31)))


def descriptor_of(case: Case) -> Tensor:
    """(B, rows, cols, channels)"""
    random, (batch, channels, height, width) = torch.Generator().manual_seed(case.seed), case.shape
    dtype = torch.float64 if case.dtype == "float64" else torch.float32
    shape = batch, *case.spec.grid(height, width), case.spec.channels
    if case.entries == "image":
        return hog(torch.rand(batch, channels, height, width, generator=random, dtype=dtype), case.spec)
    noise = torch.rand(shape, generator=random, dtype=dtype)
    if case.entries == "not finite":
        noise.view(-1)[case.seed % noise.numel()] = (math.nan, math.inf, -math.inf)[case.seed % 3]
    power = case.seed % (38 if case.dtype == "float32" else 308)
    return {
        "gaussian": noise * 2 - 1,
        "constant": torch.full(shape, 0.3, dtype=dtype),
        "zero": torch.zeros(shape, dtype=dtype),
        "huge": noise * 10.0**power,
        "tiny": noise * 10.0**-power,
    }.get(case.entries, noise)


def check(case: Case) -> str:
    """Inverts it within few evaluations."""
    descriptor, size = descriptor_of(case), (case.shape[2], case.shape[3])
    if case.native:
        back = from_layout(to_layout(descriptor, case.spec), case.spec, size)
        assert torch.equal(back.nan_to_num(7), descriptor.nan_to_num(7))
    search = Search(minimiser=case.minimiser, max_evaluations=30)  # type: ignore[arg-type]
    try:
        result = reconstruct(descriptor, case.spec, size, search=search)
    except ValueError as error:
        check_sentence(str(error))
        return "refused"
    assert case.entries != "not finite"
    image = result.image
    assert image.shape == (len(descriptor), 1, *size)
    assert image.isfinite().all()
    assert 0 <= image.min() <= image.max() <= 1
    assert result.seconds <= LONGEST
    assert_close(result.distance, relative_distance(image, descriptor, case.spec), rtol=1e-3, atol=1e-6)
    return "inverted"


@pytest.mark.slow
@pytest.mark.parametrize("case", stored_cases("inversions", Case))
def test_cases_that_once_failed(case: Case) -> None:
    check(case)


@pytest.mark.slow
@parts
def test_random_cases(part: int) -> None:
    examine(check, cases(), 20, part)
