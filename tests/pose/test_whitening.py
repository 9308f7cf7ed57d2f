"""The background model: exactly the averages it should be, whitening that whitens, and Σ⁻¹ by Fourier transform."""

from __future__ import annotations

import dataclasses
import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from nablahog import native
from nablahog.hog import HOGSpec, hog, presets
from nablahog.hog.gradient import gray
from nablahog.io.images import SAMPLE_NAMES, limit_size, sample_photograph
from nablahog.pose import whitening
from nablahog.pose.background import default_background, learn_background, pose_spec
from nablahog.pose.whitening import Background, Whitener

from ..interruption import Interruption
from ..io.archives import check_refused

SPEC = presets.aubry(4, orientations=3)
ORDER = 2


def images(count: int = 3) -> dict[str, Tensor]:
    generator = torch.Generator().manual_seed(0)
    sizes = itertools.cycle([(40, 32), (21, 50), (20, 20)])
    return {str(k): torch.rand(next(sizes), generator=generator) for k in range(count)}


@pytest.fixture(scope="module")
def background() -> Background:
    return learn_background(images(), SPEC, order=ORDER)


def test_an_interrupted_learning_is_resumed_with_the_same_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, background: Background
) -> None:
    monkeypatch.setattr("nablahog.pose.background.SAVED", 2)
    path, resumed = tmp_path / "kept", Interruption()
    with pytest.raises(KeyboardInterrupt):
        learn_background(images(), SPEC, order=ORDER, checkpoint=path, progress=Interruption(3))
    learning: dict[str, Any] = {"images": images(), "spec": SPEC, "order": ORDER, "checkpoint": path}
    for name, field, value in (
        ("images", "images", images() | {"0": images()["1"]}),
        ("names", "images", dict(reversed(images().items()))),
        ("spec", "spec", presets.aubry(4, orientations=3, colour="gray")),
        ("order", "order", ORDER - 1),
    ):
        with pytest.raises(ValueError, match=rf"checkpoint of another training \(with other {name}\)"):
            learn_background(**learning | {field: value})
    result = learn_background(images(), SPEC, order=ORDER, checkpoint=path, progress=resumed)
    assert resumed.steps == [2, 3]
    assert torch.equal(result.mean, background.mean)
    assert torch.equal(result.covariance, background.covariance)


@pytest.fixture(scope="module")
def photographs() -> Background:
    """Of real ones, whose cells correlate far more."""
    return default_background(presets.aubry(8), 5)


def inner_cells(of: dict[str, Tensor], spec: HOGSpec, order: int) -> list[Tensor]:
    """(rows, cols, C) of each image at each scale, float64."""
    result = []
    for image in of.values():
        for k in range(100):
            small = limit_size(image[None], round(max(image.shape) * 2 ** (-k / 2))) if k else image[None]
            rows, cols = (n // c - 2 for n, c in zip(small.shape[1:], spec.cell_size, strict=True))
            if min(rows, cols) < order + 1:
                break
            result.append(hog(small[None], spec)[0, 1:-1, 1:-1].double())
    return result


@pytest.mark.slow
@pytest.mark.parametrize("cell_size", [4, 8])
def test_the_backgrounds_of_the_package_are_of_the_sample_photographs(cell_size: int) -> None:
    shipped = default_background(pose_spec(cell_size))
    samples = {name: gray(sample_photograph(name)[None])[0, 0] for name in SAMPLE_NAMES}
    learned = learn_background(samples, pose_spec(cell_size))
    assert shipped.images == learned.images
    assert_close(shipped.mean, learned.mean, atol=1e-9, rtol=0)
    assert_close(shipped.covariance, learned.covariance, atol=1e-9, rtol=0)


# --- what is learned --------------------------------------------------------------------------------------------------


def test_mean_and_covariance_are_the_averages_over_all_cells_and_pairs(background: Background) -> None:
    cells = inner_cells(images(), SPEC, ORDER)
    assert len(cells) > 3  # several scales
    mean = torch.cat([each.flatten(0, 1) for each in cells]).mean(0)
    assert_close(background.mean, mean, rtol=0, atol=1e-6)  # compiled steps in float32
    for dy, dx in itertools.product(range(ORDER + 1), range(-ORDER, ORDER + 1)):
        products = [
            torch.outer(each[y, x] - mean, each[y + dy, x + dx] - mean)
            for each in cells
            for y in range(each.shape[0] - dy)
            for x in range(max(0, -dx), each.shape[1] - max(0, dx))
        ]
        expected = torch.stack(products).mean(0)
        assert_close(background.covariance[dy, ORDER + dx], expected, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"images": {}}, "expected images to learn from, got none"),
        ({"order": -1}, "order must be an integer of at least 0, got -1"),
        ({"spec": presets.paper(4)}, "a locally normalised descriptor"),
        ({"images": {"low": torch.zeros(19, 50)}}, "low must have at least 20x20 pixels, got 19x50"),
        ({"images": {"nan": torch.full((30, 30), torch.nan)}}, "nan must have gray values in 0…1"),
    ],
)
def test_what_cannot_be_learned_from(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        learn_background(**{"images": images(), "spec": SPEC, "order": ORDER} | changes)


# --- templates --------------------------------------------------------------------------------------------------------


def test_covariance_of_a_template_has_that_of_each_pair_of_its_entries(background: Background) -> None:
    rows, cols, channels = 3, 2, SPEC.channels
    sigma = background.template_covariance(rows, cols).view(rows, cols, channels, rows, cols, channels)
    for y, x, v, u in itertools.product(range(rows), range(cols), range(rows), range(cols)):
        dy, dx = v - y, u - x
        expected = background.covariance[abs(dy), ORDER + (dx if dy >= 0 else -dx)]
        assert torch.equal(sigma[y, x, :, v, u], expected if dy >= 0 else expected.T)


@pytest.mark.parametrize("size", [(1, 1), (2, 5), (6, 6)])
def test_positive_definite(photographs: Background, size: tuple[int, int]) -> None:
    factor = photographs.factor(*size)
    sigma = photographs.template_covariance(*size) + 0.01 * torch.eye(len(factor), dtype=torch.float64)
    assert_close(factor @ factor.T, sigma, rtol=0, atol=1e-12)
    assert torch.linalg.eigvalsh(sigma)[0] >= 0.01 - 1e-12  # averages over the same images at all offsets
    assert photographs.factor(*size) is factor


@pytest.mark.parametrize(("least", "raised"), [(-0.005, 0.01), (-0.015, 0.02), (-0.025, 0.03)])
def test_regularization_is_raised_until_it_is_positive_definite(least: float, raised: float) -> None:
    covariance = torch.zeros(2, 3, 3, 3, dtype=torch.float64)
    covariance[0, 1] = torch.diag(torch.tensor([0.5, least, 0.1], dtype=torch.float64))
    background = Background(SPEC, torch.zeros(3, dtype=torch.float64), covariance, ())
    factor = background.factor(1, 1)
    assert_close(factor @ factor.T, covariance[0, 1] + raised * torch.eye(3, dtype=torch.float64))


def test_whitening_solves_for_sigma(photographs: Background) -> None:
    q = torch.rand(5, 3, 4, 9, dtype=torch.float64)
    sigma = photographs.template_covariance(3, 4) + 0.01 * torch.eye(108, dtype=torch.float64)
    centred = (q - photographs.mean).flatten(1)
    weights = photographs.whiten(q)
    assert weights.shape == q.shape
    assert_close(weights.flatten(1) @ sigma, centred)
    mahalanobis = (weights.flatten(1) * centred).sum(1).sqrt()
    assert_close(photographs.discriminability(q), mahalanobis)
    assert_close(photographs.deviation(weights), mahalanobis)  # wᵀΣw = (q − μ)ᵀΣ⁻¹(q − μ)
    assert not photographs.whiten(photographs.template_mean(3, 4)[None]).any()


@pytest.mark.parametrize("size", [(0, 1), (1, 7)])
def test_templates_it_knows_nothing_of(photographs: Background, size: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match=r"must have 1…6 rows and columns of cells here, got \dx\d"):
        photographs.template_covariance(*size)


@pytest.mark.parametrize("templates", [torch.rand(1, 3, 3, 8), torch.zeros(1, 3, 3, 9).long()])
def test_no_templates(photographs: Background, templates: Tensor) -> None:
    with pytest.raises(ValueError, match=r"templates must be floating-point tensors \(N, rows, cols, 9\), got "):
        photographs.whiten(templates)


# --- the model itself -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"spec": presets.paper(4)}, "a locally normalised descriptor"),
        ({"mean": torch.full((3,), torch.nan, dtype=torch.float64)}, r"mean must lie within ±1e\+06, got NaN"),
        ({"covariance": torch.zeros(3, 4, 3, 3, dtype=torch.float64)}, r"covariance must be float64 of shape \(3, 5,"),
        ({"covariance": torch.full((1, 1, 3, 3), torch.inf, dtype=torch.float64)}, "got NaN, Inf or more"),
        ({"covariance": torch.rand(1, 3, 3, 3, dtype=torch.float64)[:, :1]}, "must not depend on which of them"),
        ({"regularization": 0.0}, "regularization must be"),
    ],
)
def test_refuses(background: Background, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(background, **changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"spec": np.array(presets.aubry(4).to_json())}, "mean must be float64 of shape"),
        ({"covariance": np.zeros(3)}, "covariance must be float64 of shape"),
        ({"images": np.array("{")}, "Expecting property name"),
        ({"regularization": np.array(-1.0)}, "regularization must be"),
    ],
)
def test_what_is_no_background(tmp_path: Path, background: Background, changes: dict[str, Any], message: str) -> None:
    check_refused(background, tmp_path / "b.npz", changes, message)


# --- by Fourier transform ---------------------------------------------------------------------------------------------


def correlated(correlation: float, order: int = 7, *, turn: float = 0.6) -> Background:
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
    return Background(presets.aubry(8, orientations=2), mean, covariance + cross, ("made up",), 0.05)


def windowed(of: Background) -> Background:
    """With the window that the filter puts on the autocovariance."""
    fade = 1 - torch.arange(-of.order, of.order + 1, dtype=torch.float64).abs() / (of.order + 1)
    window = (fade[of.order :, None] * fade)[:, :, None, None]
    return Background(of.spec, of.mean, of.covariance * window, of.images, of.regularization)


def matrix(whitener: Whitener) -> Tensor:
    """(rows · cols · C, rows · cols · C), flattened as templates are."""
    rows, cols = whitener.rows, whitener.cols
    basis = torch.eye(rows * cols * 2).view(-1, rows, cols, 2).permute(0, 3, 1, 2)
    return whitener(basis).permute(0, 2, 3, 1).flatten(1)


@pytest.mark.parametrize("correlation", [0.2, 0.5])
def test_inside_it_is_the_exact_inverse(correlation: float) -> None:
    size = 8
    of = correlated(correlation)
    covariance = windowed(of).template_covariance(size, size)
    exact = torch.linalg.inv(covariance + 0.05 * torch.eye(len(covariance), dtype=torch.float64))
    result = matrix(Whitener(of, size, size)).double()
    # rows of the matrices for the middle cells; columns for all cells but the outermost two rings
    inside = torch.zeros(size, size, 2, dtype=torch.bool)
    inside[2:-2, 2:-2] = True
    middle = torch.zeros_like(inside)
    middle[3:-3, 3:-3] = True
    error = (result - exact)[middle.flatten()][:, inside.flatten()]
    assert error.norm() < 0.02 * exact[middle.flatten()][:, inside.flatten()].norm()


@pytest.mark.parametrize(("rows", "cols"), [(5, 9), (1, 1)])
def test_it_is_symmetric_and_positive_definite(rows: int, cols: int) -> None:
    result = matrix(Whitener(correlated(0.6), rows, cols)).double()
    assert_close(result, result.mT, rtol=0, atol=1e-4)
    values = torch.linalg.eigvalsh((result + result.mT) / 2)
    assert values[0] > 0
    assert values[-1] <= 1 / 0.05 * (1 + 1e-4)


def test_of_white_noise_it_is_a_division() -> None:
    white = correlated(0.0, turn=0)
    descriptors = torch.randn(3, 2, 6, 10)
    assert_close(Whitener(white, 6, 10)(descriptors), descriptors / (1 + 0.05))
    assert_close(Whitener(white, 6, 10, 3.0)(descriptors), descriptors / 4)


def test_the_mean_is_subtracted() -> None:
    background = dataclasses.replace(correlated(0.5), mean=torch.tensor([0.25, -0.5], dtype=torch.float64))
    whitener = Whitener(background, 3, 4)
    descriptors = torch.tensor([0.25, -0.5])[None, :, None, None].expand(2, 2, 3, 4)
    assert not whitener.subtract_mean(descriptors).any()


@pytest.mark.parametrize(("rows", "cols"), [(5, 12), (1, 1)])
def test_energies_are_products_with_the_whitened(rows: int, cols: int) -> None:
    whitener = Whitener(correlated(0.5), rows, cols)
    q = torch.rand(3, 2, rows, cols)
    assert_close(whitener.energies(q), (q * whitener(q)).sum((1, 2, 3)), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize(("rows", "cols", "batch"), [(5, 12, 3), (1, 1, 4)])
def test_compiled_loops_are_the_plain_sums(rows: int, cols: int, batch: int, monkeypatch: pytest.MonkeyPatch) -> None:
    whitener = Whitener(correlated(0.5), rows, cols)
    q = torch.randn(batch, 2, rows, cols)
    results = whitener(q), whitener.energies(q)
    monkeypatch.setattr(native, "available", lambda: False)
    for result, plain in zip(results, (whitener(q), whitener.energies(q)), strict=True):
        assert_close(result, plain, rtol=1e-5, atol=1e-5)


def test_on_large_windows_it_is_that_of_smaller_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    """The inverse decays over cells, so that frequencies of a large window need not be inverted one by one."""
    of, rows, cols = correlated(0.6), 60, 70
    quick = Whitener(of, rows, cols)
    monkeypatch.setattr(whitening, "_DECAY", 1000)
    exact = Whitener(of, rows, cols)
    descriptors = torch.rand(2, 2, rows, cols, generator=torch.Generator().manual_seed(0))
    assert_close(quick(descriptors), exact(descriptors), atol=0.01, rtol=0)
    assert_close(quick.energies(descriptors), exact.energies(descriptors), atol=0, rtol=1e-3)
