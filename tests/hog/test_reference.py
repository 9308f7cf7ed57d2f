"""The operator against the slow reference, over every option and awkward sizes."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import get_args

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

from nablahog.hog import BilinearCells, BlockCells, BlockNorm, BoxCells, HOGSpec, hog, presets
from nablahog.hog.descriptor import histograms
from nablahog.hog.orientation import votes
from nablahog.hog.spec import Border
from nablahog.hog.steps import pooling_axes

from . import reference
from .zoo import DOUBLE, SPECS, fits, integers, noise, rounding, spec

BORDERS = get_args(Border)


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


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize("partial_cells", ["floor", "round", "ceil"])
@pytest.mark.parametrize("cell_size", [(3, 5), (4, 2), (1, 1)])
def test_borders_and_partial_cells(border: str, partial_cells: str, cell_size: tuple[int, int]) -> None:
    assert_equals_reference(noise(1, 1, 10, 12), spec(border=border, partial_cells=partial_cells, cell_size=cell_size))


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (2, 2), (2, 7), (3, 1)])
def test_images_of_few_rows(border: str, shape: tuple[int, int]) -> None:
    assert_equals_reference(noise(2, 2, *shape), spec(border=border, cell_size=(1, 1)))
    assert_equals_reference(noise(2, 2, *shape), spec(border=border, cell_size=(1, 4), partial_cells="ceil"))


POOLINGS = {
    "vote": BilinearCells("vote", 0.5),
    "drop": BilinearCells("drop"),
    "repeat": BilinearCells("repeat", 8 / 7),
    "box": BoxCells(),
    "box-window": BoxCells(mean=True, window=2),
    "box-wide-window": BoxCells(window=7),
}


@pytest.mark.parametrize("pooling", POOLINGS)
@pytest.mark.parametrize("partial_cells", ["floor", "round", "ceil"])
@pytest.mark.parametrize("border", ["reflect", "ignore"])
def test_poolings_at_any_remainder(pooling: str, partial_cells: str, border: str) -> None:
    """In votes: a constant factor in the pooling would cancel in most normalisers."""
    for size, cell_size in itertools.product([(5, 9), (6, 10), (7, 11)], [(4, 3), (1, 2), (5, 5)]):
        s = spec(pooling=POOLINGS[pooling], border=border, partial_cells=partial_cells, cell_size=cell_size)
        image = noise(1, 1, *size)
        expected = reference.histograms(image[0].numpy(), s)
        np.testing.assert_allclose(histograms(image, s)[0].permute(1, 2, 0).numpy(), expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize("border", ["reflect", "ignore"])
@pytest.mark.parametrize(("block", "step"), [((2, 2), (2, 2)), ((4, 3), (1, 2)), ((6, 9), (5, 1)), ((2, 6), (3, 4))])
def test_blocks_at_any_step(border: str, block: tuple[int, int], step: tuple[int, int]) -> None:
    cells = block[0] // 2, block[1] // (1 if block[1] % 3 else 3)
    s = spec(
        cell_size=(2, block[1] // cells[1]),
        border=border,
        normalizer=BlockNorm(cells, cells, epsilon=0.1),
        pooling=BlockCells(block, step, 1.7),
    )
    for size in ((6, 9), (9, 10), (11, 13)):
        assert_equals_reference(noise(1, 1, *size), s)


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
