"""Σ⁻¹ by Fourier transform is the inverse of the block-Toeplitz Σ, away from the border."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from nablahog import native
from nablahog.hog import presets
from nablahog.pose import whitener as of_whitener
from nablahog.pose.whitener import Whitener
from nablahog.pose.whitening import Background

SPEC = presets.aubry(8, orientations=2)  # two channels
CHANNELS = 2
ORDER = 7
LAMBDA = 0.05


def background(correlation: float, order: int = ORDER, *, turn: float = 0.6) -> Background:
    """Cells whose correlation falls by ``correlation`` from one to the next, and more across than down.

    The channels depend on each other, and differently to the left than to the right if ``turn`` is not 0.
    """
    dy = torch.arange(order + 1, dtype=torch.float64)[:, None]
    dx = torch.arange(-order, order + 1, dtype=torch.float64)
    covariance = (correlation**dy * (correlation / 2) ** dx.abs())[:, :, None, None] * torch.eye(2, dtype=torch.float64)
    # of a small moving average more: the second channel repeats a part of the first's left neighbour
    cross = torch.zeros_like(covariance)
    cross[0, order + 1, 1, 0] = cross[0, order - 1, 0, 1] = 0.2 * turn
    mean = torch.tensor([0.1, 0.3], dtype=torch.float64)
    return Background(SPEC, mean, covariance + cross, ("made up",), LAMBDA)


def windowed(of: Background) -> Background:
    """With the window that the filter puts on the autocovariance."""
    fade = 1 - torch.arange(-of.order, of.order + 1, dtype=torch.float64).abs() / (of.order + 1)
    window = (fade[of.order :, None] * fade)[:, :, None, None]
    return Background(of.spec, of.mean, of.covariance * window, of.images, of.regularization)


def matrix(whitener: Whitener) -> Tensor:
    """(rows · cols · C, rows · cols · C), flattened as templates are."""
    rows, cols = whitener.rows, whitener.cols
    basis = torch.eye(rows * cols * CHANNELS).view(-1, rows, cols, CHANNELS).permute(0, 3, 1, 2)
    return whitener(basis).permute(0, 2, 3, 1).flatten(1)


@pytest.mark.parametrize("correlation", [0.2, 0.5])
def test_inside_it_is_the_exact_inverse(correlation: float) -> None:
    size = ORDER + 1
    of = background(correlation)
    covariance = windowed(of).template_covariance(size, size)
    exact = torch.linalg.inv(covariance + LAMBDA * torch.eye(len(covariance), dtype=torch.float64))
    result = matrix(Whitener(of, size, size)).double()
    # rows of the matrices for the middle cells; columns for all cells but the outermost two rings
    inside = torch.zeros(size, size, CHANNELS, dtype=torch.bool)
    inside[2:-2, 2:-2] = True
    middle = torch.zeros_like(inside)
    middle[3:-3, 3:-3] = True
    error = (result - exact)[middle.flatten()][:, inside.flatten()]
    assert error.norm() < 0.02 * exact[middle.flatten()][:, inside.flatten()].norm()


@pytest.mark.parametrize(("rows", "cols"), [(5, 9), (1, 1), (12, 3)])
def test_it_is_symmetric_and_positive_definite(rows: int, cols: int) -> None:
    result = matrix(Whitener(background(0.6), rows, cols)).double()
    assert_close(result, result.mT, rtol=0, atol=1e-4)
    values = torch.linalg.eigvalsh((result + result.mT) / 2)
    assert values[0] > 0
    assert values[-1] <= 1 / LAMBDA * (1 + 1e-4)


def test_it_remains_so_where_the_autocovariance_is_none() -> None:
    """One that no process has: neighbours that correlate by more than 1."""
    of = background(0.3, 2)
    of.covariance[0, 3] = of.covariance[0, 1] = 2 * torch.eye(2, dtype=torch.float64)
    values = torch.linalg.eigvalsh(matrix(Whitener(of, 6, 6)).double())
    assert values[0] > 0
    assert values[-1] <= 1 / LAMBDA * (1 + 1e-4)


def test_of_white_noise_it_is_a_division() -> None:
    white = background(0.0, turn=0)
    descriptors = torch.randn(3, CHANNELS, 6, 10)
    assert_close(Whitener(white, 6, 10)(descriptors), descriptors / (1 + LAMBDA))
    assert_close(Whitener(white, 6, 10, 3.0)(descriptors), descriptors / 4)


def test_opposite_borders_know_nothing_of_each_other() -> None:
    whitener = Whitener(background(0.2, 2), 16, 16)
    alone = torch.zeros(1, CHANNELS, 16, 16)
    alone[0, :, 0, 0] = 1
    result = whitener(alone)
    assert result[0, :, -1].abs().max() < 1e-2 * result.abs().max()
    assert result[0, :, :, -1].abs().max() < 1e-2 * result.abs().max()


def test_what_is_centred_has_the_mean_of_photographs_at_0() -> None:
    of = background(0.3)
    whitener = Whitener(of, 4, 5)
    mean = of.mean.float()[:, None, None].expand(1, -1, 4, 5)
    assert not whitener.centred(mean).any()
    assert_close(whitener.centred(mean + 0.5), torch.full_like(mean, 0.5))


@pytest.mark.parametrize(("rows", "cols"), [(8, 8), (5, 12), (16, 11), (1, 1)])
def test_energies_are_products_with_the_whitened(rows: int, cols: int) -> None:
    whitener = Whitener(background(0.5), rows, cols)
    q = torch.rand(3, CHANNELS, rows, cols)
    assert_close(whitener.energies(q), (q * whitener(q)).sum((1, 2, 3)), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize(("rows", "cols", "batch"), [(8, 8, 1), (5, 12, 3), (16, 11, 2), (1, 1, 4)])
def test_compiled_loops_are_the_plain_sums(rows: int, cols: int, batch: int, monkeypatch: pytest.MonkeyPatch) -> None:
    whitener = Whitener(background(0.5), rows, cols)
    q = torch.randn(batch, CHANNELS, rows, cols)
    results = whitener(q), whitener.energies(q)
    monkeypatch.setattr(native, "available", lambda: False)
    for result, plain in zip(results, (whitener(q), whitener.energies(q)), strict=True):
        assert_close(result, plain, rtol=1e-5, atol=1e-5)


def test_on_large_windows_it_is_that_of_smaller_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    """The inverse decays over cells, so that frequencies of a large window need not be inverted one by one."""
    of, rows, cols = background(0.6), 60, 70
    quick = Whitener(of, rows, cols)
    monkeypatch.setattr(of_whitener, "_REACH", 1000)
    exact = Whitener(of, rows, cols)
    descriptors = torch.rand(2, CHANNELS, rows, cols, generator=torch.Generator().manual_seed(0))
    assert_close(quick(descriptors), exact(descriptors), atol=0.01, rtol=0)
    assert_close(quick.energies(descriptors), exact.energies(descriptors), atol=0, rtol=1e-3)
