"""The operator against the slow reference, over every option and awkward sizes."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from torch import Tensor

from nablahog.hog import HOGSpec, hog, presets
from nablahog.hog.descriptor import histograms
from nablahog.hog.orientation import votes
from nablahog.hog.steps import pooling_axes

from ..fuzz.specs import shapes, specs
from . import reference
from .zoo import DOUBLE, SPECS, fits, integers, noise, rounding, spec


def assert_equals_reference(images: Tensor, spec: HOGSpec) -> None:
    expected = np.stack([reference.hog(image.numpy(), spec) for image in images])
    actual = hog(images, spec)
    assert actual.dtype == images.dtype
    np.testing.assert_allclose(actual.numpy(), expected, rtol=rounding(spec), atol=rounding(spec))


@pytest.mark.parametrize(
    ("name", "channels"),
    [(name, c) for name, c in itertools.product(SPECS, (1, 2, 3, 4)) if fits(SPECS[name], c, 14, 11)],
)
def test_equals_reference(name: str, channels: int) -> None:
    assert_equals_reference(noise(1, channels, 14, 11), SPECS[name])


@pytest.mark.parametrize("name", SPECS)
def test_histograms_equal_reference(name: str) -> None:
    """In votes: a constant factor in the pooling would cancel in most normalisers."""
    images = noise(2, 3, 14, 11)
    expected = np.stack([reference.histograms(image.numpy(), SPECS[name]) for image in images])
    actual = histograms(images, SPECS[name]).permute(0, 2, 3, 1)
    tolerance = rounding(SPECS[name])
    np.testing.assert_allclose(actual.numpy(), expected, rtol=tolerance, atol=tolerance * expected.max())


@pytest.mark.parametrize("name", SPECS)
def test_equals_reference_on_bytes(name: str) -> None:
    """Few grey levels: flat areas, ties between channels, gradients on the boundaries of hard bins."""
    assert_equals_reference(integers(1, 3, 12, 12, levels=4), SPECS[name])


@pytest.mark.slow
@given(data=st.data())
@settings(max_examples=150)
def test_any_dialect_equals_reference(data: st.DataObject) -> None:
    """Any borders, remainders of cells, blocks and steps, and images of few rows."""
    s = data.draw(specs())
    _, *shape = data.draw(shapes(s, 12))
    if shape[1] * shape[2] > 500:  # takes long
        return
    image, tolerance = noise(1, *shape), 1e-10 if s.angle == "exact" else 1e-5
    votes = reference.histograms(image[0].numpy(), s)  # a constant factor would cancel in most normalisers
    actual = histograms(image, s)[0].permute(1, 2, 0).numpy()
    np.testing.assert_allclose(actual, votes, rtol=0, atol=max(tolerance * votes.max(), 1e-9))
    if votes.max() > 1e-9:  # which VLFeat votes where there is no gradient
        expected = reference.hog(image[0].numpy(), s)
        np.testing.assert_allclose(hog(image, s)[0].numpy(), expected, rtol=0, atol=tolerance * expected.max())


@pytest.mark.parametrize("ties", ["first", "opencv", "dlib"])
@pytest.mark.parametrize("width", [4, 7, 8, 9, 10, 17, 18, 19, 26])
def test_colour_ties_in_any_column(ties: str, width: int) -> None:
    """Two levels: most pixels tie.  Hard votes: which channel counts decides the bin."""
    for border, rule in (("reflect", "floor"), ("ignore", "round")):
        s = spec(
            colour="largest", colour_ties=ties, vote="hard", bins=8, signed=True, border=border, partial_cells=rule
        )
        assert_equals_reference(integers(1, 3, 5, width, levels=2), s)


def votes_of(gx: Tensor, gy: Tensor, s: HOGSpec) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What the operator and the reference vote for gradients (n,), both (n, bins)."""
    actual = votes(gx.view(1, 1, -1), gy.view(1, 1, -1), s)[0, :, 0].T
    return actual.numpy(), np.stack([reference.vote(x, y, s) for x, y in zip(gx.tolist(), gy.tolist(), strict=True)])


def whole_degrees() -> tuple[Tensor, Tensor]:
    angles = torch.deg2rad(torch.arange(-180, 181, dtype=DOUBLE))
    return 1.7 * angles.cos(), 1.7 * angles.sin()


def whole_numbers() -> tuple[Tensor, Tensor]:
    g = torch.arange(-6, 7, dtype=DOUBLE)
    return g.repeat_interleave(len(g)), g.repeat(len(g))


@pytest.mark.parametrize("bins", [3, 4, 9, 11])
@pytest.mark.parametrize("signed", [False, True])
@pytest.mark.parametrize("bin_offset", [0.0, 0.3, 0.5, 2.75])
@pytest.mark.parametrize("counterclockwise", [False, True])
def test_linear_votes_of_any_direction(bins: int, signed: bool, bin_offset: float, counterclockwise: bool) -> None:
    """Every whole degree: bin centres, half-way points and the wrap at ±180° among them."""
    s = spec(bins=bins, signed=signed, bin_offset=bin_offset, counterclockwise=counterclockwise)
    np.testing.assert_allclose(*votes_of(*whole_degrees(), s), rtol=0, atol=1e-13)


@pytest.mark.parametrize("gradients", [whole_degrees, whole_numbers])
@pytest.mark.parametrize("bins", [8, 18])
@pytest.mark.parametrize("signed", [False, True])
@pytest.mark.parametrize("angle", ["opencv", "vlfeat"])
def test_angles_of_libraries(
    gradients: Callable[[], tuple[Tensor, Tensor]], bins: int, signed: bool, angle: str
) -> None:
    s = spec(angle=angle, bins=bins, signed=signed, bin_offset=0.0)
    np.testing.assert_allclose(*votes_of(*gradients(), s), rtol=0, atol=1e-4)  # 1.7 or 8, times a float32's rounding


@pytest.mark.parametrize("orientations", [4, 6, 9])
@pytest.mark.parametrize("signed", [False, True])
@pytest.mark.parametrize("directions", ["float32", "four-decimals"])
@pytest.mark.parametrize("counterclockwise", [False, True])
def test_hard_votes_on_bin_boundaries(orientations: int, signed: bool, directions: str, counterclockwise: bool) -> None:
    """Integer gradients: with 9 orientations, vertical ones tie between two bins and the first must win."""
    s = spec(
        vote="hard",
        signed=signed,
        bins=2 * orientations if signed else orientations,
        bin_offset=0.0,
        directions=directions,
        counterclockwise=counterclockwise,
    )
    np.testing.assert_allclose(*votes_of(*whole_numbers(), s), rtol=1e-15, atol=0)


@pytest.mark.parametrize(
    ("bins", "signed"),
    [*((n, False) for n in (3, 4, 6, 7, 8, 9, 12, 14, 18)), *((n, True) for n in (4, 6, 8, 12, 14, 18))],
)
@pytest.mark.parametrize("bin_offset", [0.0, 0.5, 1.25])
@pytest.mark.parametrize("counterclockwise", [False, True])
def test_upper_bins_on_bin_boundaries(bins: int, signed: bool, bin_offset: float, counterclockwise: bool) -> None:
    """Multiples of 45°, the only boundaries that whole numbers can be on."""
    s = spec(
        vote="hard",
        boundary="upper",
        bins=bins,
        signed=signed,
        bin_offset=bin_offset,
        counterclockwise=counterclockwise,
    )
    np.testing.assert_allclose(*votes_of(*whole_numbers(), s), rtol=1e-15, atol=0)


IN_SINGLE, IN_DOUBLE = torch.empty(0), torch.empty(0, dtype=torch.float64)


def by_row(cell: int, cells: int, like: Tensor) -> Tensor:
    along = pooling_axes(presets.paper((cell, 8)), cell * cells, 8, like)[0]
    return along.spread(torch.eye(along.cells).to(like), -1)


@pytest.mark.parametrize("like", [IN_SINGLE, IN_DOUBLE])
@pytest.mark.parametrize("cell", [1, 2, 3, 5, 6, 7, 8, 11])
def test_weights_are_alike_wherever_the_cell_is(cell: int, like: Tensor) -> None:
    matrix = by_row(cell, 2000, like)
    near, far = (matrix[k, (k - 1) * cell : (k + 2) * cell] for k in (1, 1998))
    assert torch.equal(near, far)
    assert (matrix.sum(dim=1)[1:-1] - cell).abs().max() < 1e-5 * cell


@pytest.mark.parametrize("cell", [3, 5, 7])
def test_far_from_the_origin_no_digit_is_lost(cell: int) -> None:
    assert torch.equal(by_row(cell, 2000, IN_SINGLE), by_row(cell, 2000, IN_DOUBLE).float())


@pytest.mark.parametrize("cell", [3, 5, 7, 11])
def test_a_pixel_at_a_centre_votes_into_its_cell_alone(cell: int) -> None:
    assert torch.equal(by_row(cell, 2000, IN_SINGLE)[:, cell // 2 :: cell], torch.eye(2000))
