"""The compiled steps return what the plain ones return, and their derivatives, also where those are conventions."""

from __future__ import annotations

import math
from typing import Any

import numba
import pytest
import torch
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from torch import Tensor
from torch.testing import assert_close

from nablahog.compile import compiled
from nablahog.hog import BilinearCells, BlockNorm, BoxCells, CellNorm, FourBlockNorm, hog, presets
from nablahog.hog.descriptor import histograms
from nablahog.hog.kernels import blocks, cells, steps
from nablahog.hog.normalize import four_block_norm, normalize
from nablahog.hog.normalizers import PARTS
from nablahog.hog.poolings import Pooling

from .zoo import SPECS, integers, noise, spec

DTYPES = [torch.float32, torch.float64]
dtypes = pytest.mark.parametrize("dtype", DTYPES, ids=["float32", "float64"])
FUSED_CELLS = [name for name, s in SPECS.items() if cells.supports(s)]
FUSED_NORMS = [name for name, s in SPECS.items() if blocks.supports(s) and s.colour != "separate"]
specs = pytest.mark.parametrize("name", FUSED_CELLS)


def with_derivative(step: object, x: Tensor, s: object) -> tuple[Tensor, Tensor]:
    """A step's result, and the gradient of its product with some fixed numbers."""
    assert callable(step)
    x = x.detach().requires_grad_()
    result = step(x, s)
    weights = torch.linspace(0, 40, result.numel(), dtype=x.dtype).cos().view(result.shape)
    (derivative,) = torch.autograd.grad((result * weights).sum(), x)
    return result.detach(), derivative


def assert_same(compiled_step: object, plain: object, x: Tensor, s: object) -> None:
    """Up to rounding, relative to the largest entry; the plain steps in float64, where diagonals are exact."""
    for got, exact in zip(with_derivative(compiled_step, x, s), with_derivative(plain, x.double(), s), strict=True):
        assert got.shape == exact.shape
        assert got.dtype == x.dtype
        size = float(exact.abs().max()) or 1.0
        # of the float32 arctangent, and of a difference of nearly equal gray values in float32
        assert_close(got.double() / size, exact / size, rtol=0, atol=2e-5 if x.dtype == torch.float32 else 1e-11)


@dtypes
@specs
def test_histograms_are_those_of_the_plain_steps(name: str, dtype: torch.dtype) -> None:
    assert_same(cells.histograms, histograms, noise(3, 1, 17, 14, dtype=dtype), SPECS[name])


@dtypes
@specs
def test_on_kinks_too(name: str, dtype: torch.dtype) -> None:
    """Few gray levels: gradients of zero, on bin centres, and on the diagonals, with the derivatives agreed upon."""
    assert_same(cells.histograms, histograms, integers(3, 1, 17, 14, levels=3, dtype=dtype), SPECS[name])


@dtypes
@pytest.mark.parametrize("bins", [8, 16])
def test_diagonals_that_are_bin_centres(bins: int, dtype: torch.dtype) -> None:
    x = integers(2, 1, 16, 16, levels=2, dtype=dtype)
    assert_same(cells.histograms, histograms, x, spec(signed=True, bins=bins, bin_offset=0.0))


@pytest.mark.xfail(strict=True, reason="gradients are scaled after the difference, the plain steps' before")
@pytest.mark.parametrize("bins", [8, 16])
def test_diagonals_of_bytes_that_are_bin_centres(bins: int) -> None:
    """Whole numbers in units of the spec: equal components are equal to the last bit."""
    s = spec(signed=True, bins=bins, bin_offset=0.0, value_range=255.0)
    assert_same(cells.histograms, histograms, integers(2, 1, 16, 16, levels=16), s)


@dtypes
@pytest.mark.parametrize("directions", ["float32", "four-decimals"])
@pytest.mark.parametrize("orientations", [4, 5, 7, 8, 9, 12])
def test_hard_votes_on_diagonals(orientations: int, directions: str, dtype: torch.dtype) -> None:
    """Which lie exactly between two bins if there are six, ten, fourteen …: those are left to the plain steps."""
    assert not cells.supports(spec(vote="hard", bin_offset=0.0, bins=12, signed=True))
    s = spec(vote="hard", directions=directions, bin_offset=0.0, bins=2 * orientations, signed=True, value_range=255.0)
    x = integers(2, 1, 40, 40, levels=16, dtype=dtype)
    plain = histograms(x, s)
    assert_close(cells.histograms(x, s), plain, rtol=0, atol=1e-5 * float(plain.max()))


@specs
def test_batches_that_no_cache_holds(name: str) -> None:
    """A few images at a time, the last time fewer; most of their pixels without a gradient."""
    x = noise(5, 1, 120, 130, dtype=torch.float32)
    x[:, :, 10:] = 0.5
    x[2:] *= 0.3
    together = with_derivative(cells.histograms, x, SPECS[name])[0]
    for image, found in zip(x, together, strict=True):
        assert torch.equal(cells.histograms(image[None], SPECS[name])[0], found)
    assert_same(cells.histograms, histograms, x, SPECS[name])


def test_an_empty_batch() -> None:
    assert cells.histograms(torch.zeros(0, 1, 16, 16), SPECS["uoctti"]).shape == (0, 18, 4, 4)


@settings(max_examples=60)
@given(
    height=st.integers(1, 40),
    width=st.integers(1, 40),
    cell=st.tuples(st.integers(1, 9), st.integers(1, 9)),
    bins=st.integers(3, 20),
    offset=st.floats(0, 0.99),
    border=st.sampled_from(["reflect", "replicate", "zero", "ignore"]),
    partial=st.sampled_from(["round", "ceil", "floor"]),
    pooling=st.sampled_from([BilinearCells(), BilinearCells("drop", 1.5), BilinearCells("repeat"), BoxCells(window=3)]),
    signed=st.booleans(),
    seed=st.integers(0, 99),
)
def test_any_size(
    height: int,
    width: int,
    cell: tuple[int, int],
    bins: int,
    offset: float,
    border: str,
    partial: str,
    pooling: Pooling,
    signed: bool,
    seed: int,
) -> None:
    s = spec(
        cell_size=cell,
        bins=bins,
        bin_offset=offset,
        border=border,
        partial_cells=partial,
        pooling=pooling,
        signed=signed,
        value_range=9.0,
    )
    try:
        s.grid(height, width)
    except ValueError:
        assume(False)  # no cell in it
    assert_same(cells.histograms, histograms, noise(2, 1, height, width, seed=seed), s)


@dtypes
@pytest.mark.parametrize(("rows", "cols"), [(1, 1), (1, 5), (4, 1), (6, 7)])
def test_four_blocks(rows: int, cols: int, dtype: torch.dtype) -> None:
    x = noise(3, 12, rows, cols, dtype=dtype)
    x[:, :, 0] = 0
    for parts in (PARTS[:3], PARTS[:1], PARTS[1:2], PARTS[:2], PARTS[1:3], PARTS[:3:2]):
        for scheme in (FourBlockNorm(parts=parts), FourBlockNorm(epsilon=0.5, clip=0.1, parts=parts)):
            assert_same(blocks.four_block_norm, four_block_norm, x, scheme)


@dtypes
@pytest.mark.parametrize("name", FUSED_NORMS)
def test_normalisers_are_those_of_the_plain_steps(name: str, dtype: torch.dtype) -> None:
    assert_same(blocks.normalize, normalize, noise(2, SPECS[name].bins, 4, 3, dtype=dtype), SPECS[name])


def test_parts_are_some_of_all_channels() -> None:
    x = noise(2, 12, 4, 5)
    directed, undirected, texture = four_block_norm(x, FourBlockNorm()).split([12, 6, 4], dim=1)
    assert torch.equal(four_block_norm(x, FourBlockNorm(parts=("undirected",))), undirected)
    both = four_block_norm(x, FourBlockNorm(parts=("directed", "texture")))
    assert torch.equal(both, torch.cat([directed, texture], dim=1))


def test_an_entry_exactly_at_the_clip() -> None:
    scheme = FourBlockNorm(epsilon=1.0, clip=1.0)
    x = torch.tensor([math.sqrt(1 / 3)] * 2 + [0.0] * 2, dtype=torch.float64).view(1, 4, 1, 1)
    exact = FourBlockNorm(epsilon=1.0, clip=float((x[0, 0] / torch.sqrt(8 * x[0, 0] ** 2 / 2 + 1)).item()))
    for s in (scheme, exact):
        assert_same(blocks.four_block_norm, four_block_norm, x, s)


@specs
def test_constant_images_have_no_derivative(name: str) -> None:
    x = torch.full((1, 1, 12, 12), 0.3)
    assert_same(cells.histograms, histograms, x, SPECS[name])
    if SPECS[name].border != "zero":  # which sees an edge around any image
        assert not with_derivative(cells.histograms, x, SPECS[name])[1].any()


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e30])
@dtypes
@specs
def test_what_is_no_number_stays_none_and_harms_no_memory(name: str, dtype: torch.dtype, value: float) -> None:
    x = noise(1, 1, 16, 16, dtype=dtype)
    x[0, 0, 7, 7] = value
    found = cells.histograms(x, SPECS[name])
    if not math.isfinite(float(torch.tensor(value, dtype=dtype).square())):
        assert not torch.isfinite(found).all()
    if name in FUSED_NORMS:
        descriptor = blocks.normalize(torch.full_like(found, math.nan), SPECS[name])
        assert descriptor.isnan().all()


def test_not_contiguous() -> None:
    s = SPECS["uoctti"]
    x = noise(2, 1, 12, 16).mT.flip(0)
    assert_same(cells.histograms, histograms, x, s)
    h = noise(2, 5, 4, 18).permute(0, 3, 1, 2)
    assert_same(blocks.normalize, normalize, h, s)


def test_derivatives_of_derivatives_are_refused() -> None:
    x = noise(1, 1, 8, 8).requires_grad_()
    squares = cells.histograms(x, SPECS["paper"]).square().sum()
    (derivative,) = torch.autograd.grad(squares, x, create_graph=True)
    with pytest.raises(RuntimeError, match="once_differentiable"):
        derivative.sum().backward()


def test_compiled_steps_are_for_cpus() -> None:
    for s in (presets.paper(), presets.uoctti(), presets.aubry()):
        assert steps(torch.device("cpu"), s) == (cells.histograms, blocks.normalize)
        assert steps(torch.device("cuda"), s) == (histograms, normalize)


@pytest.mark.parametrize("name", SPECS)
def test_the_steps_of_any_dialect_are_those_of_its_descriptor(name: str) -> None:
    """Compiled where they can do what the dialect asks for, plain where not."""
    s, image = SPECS[name], integers(2, 1, 14, 17, levels=3)
    of_cells, norm = steps(torch.device("cpu"), s)
    assert of_cells == (cells.histograms if name in FUSED_CELLS else histograms)
    assert norm == (blocks.normalize if name in FUSED_NORMS else normalize)
    assert_close(norm(of_cells(image, s), s).permute(0, 2, 3, 1), hog(image, s), rtol=0, atol=1e-11)


@pytest.mark.parametrize(
    ("changes", "of_cells", "norm"),
    [
        ({"pooling": BoxCells()}, True, True),
        ({"pooling": BilinearCells("repeat", 2.0)}, True, True),
        ({"layout": "planes", "colour_ties": "dlib"}, True, True),
        ({"vote": "hard", "directions": "four-decimals"}, True, True),
        ({"vote": "hard", "boundary": "upper"}, False, True),
        ({"vote": "hard", "derivative": "linear"}, False, True),
        *(({"border": border}, False, True) for border in ("extrapolate", "gray")),
        ({"colour": "separate"}, False, False),
        ({"gamma": "sqrt"}, False, True),
        ({"mask": "sobel"}, False, True),
        ({"counterclockwise": True}, False, True),
        ({"angle": "opencv"}, False, True),
        ({"normalizer": CellNorm()}, True, False),
        ({"normalizer": BlockNorm((1, 1))}, True, False),
        ({"normalizer": FourBlockNorm(parts=("undirected",))}, True, False),
        *(
            ({"signed": True, "bins": 8, "normalizer": FourBlockNorm(**fields)}, True, False)
            for fields in ({"texture": "dpm"}, {"outside": "drop"}, {"outside": "missing"}, {"floor": True})
        ),
        ({"signed": True, "bins": 8, "normalizer": FourBlockNorm(parts=("directed", "zero"))}, True, False),
    ],
)
def test_what_the_compiled_steps_can_do(changes: dict[str, Any], of_cells: bool, norm: bool) -> None:
    s = spec(**changes)
    assert (cells.supports(s), blocks.supports(s)) == (of_cells, norm)


def test_without_a_folder_to_keep_machine_code_in(monkeypatch: pytest.MonkeyPatch) -> None:
    compile_in_memory = numba.njit

    def njit(**options: Any) -> object:
        if options.pop("cache", False):
            raise RuntimeError("cannot cache function: no locator available")
        return compile_in_memory(**options)

    monkeypatch.setattr(numba, "njit", njit)

    @compiled
    def doubled(x: float) -> float:
        return 2 * x

    assert doubled(1.5) == 3.0


def test_pooling_weights_of_one_spec_are_not_those_of_another() -> None:
    x = noise(1, 1, 12, 12)
    for s in (spec(cell_size=(4, 4)), spec(cell_size=(3, 3)), spec(cell_size=(4, 4), border="ignore")):
        assert_same(cells.histograms, histograms, x, s)
