"""HOGgles: images are those of the published rule, codes those of another solver, and learning lowers the objective."""

from __future__ import annotations

import dataclasses
import sys
import time
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.optimize import nnls
from torch import Tensor

from nablahog import hog, presets
from nablahog.hog import HOGSpec
from nablahog.paper.baselines import hoggles_learning as learning
from nablahog.paper.baselines.hoggles import PairedDictionary, hog_windows, positive_lasso, unit
from nablahog.paper.baselines.hoggles_learning import learn_hoggles

from ...interruption import Interruption
from ...invert.photographs import photograph
from ...io import tiny_models
from ...io.archives import check_refused

SPEC = presets.uoctti(4)
NAMES = ("camera", "coins", "clock")


def _images(*names: str) -> dict[str, Tensor]:
    return {name: photograph(64, name)[0, 0] for name in names or NAMES}


@cache
def _learned() -> PairedDictionary:
    return learn_hoggles(_images(), SPEC, atoms=40, iterations=4)


# --- codes


@pytest.mark.slow
def test_codes_are_those_of_another_solver() -> None:
    """Completing the square makes a positive lasso a non-negative least squares problem, where DᵀD has an inverse."""
    common = torch.randn(20)
    dictionary = torch.nn.functional.normalize(torch.randn(15, 20) + common)
    windows = unit(torch.randn(10, 20) + common)
    windows[3] = 0
    codes = positive_lasso(dictionary, windows, 0.05)
    root = torch.linalg.cholesky(dictionary.double() @ dictionary.double().T)
    target = torch.linalg.solve_triangular(root, (windows @ dictionary.T - 0.05).double().T, upper=False).T
    expected = np.stack([nnls(root.mT.numpy(), each.numpy())[0] for each in target])
    np.testing.assert_allclose(codes.numpy(), expected, atol=5e-3)
    assert not codes[3].any()


def test_needs_scikit_learn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "sklearn.linear_model", None)
    with pytest.raises(ValueError, match=r"sklearn.*pip install scikit-learn"):
        positive_lasso(torch.eye(2), torch.eye(2), 0.02)


# --- inversion


def _reference(pair: PairedDictionary, descriptor: NDArray[Any], size: tuple[int, int]) -> NDArray[Any]:
    """The published rule, window by window, in double precision."""
    height, width = pair.spec.cell_size
    bordered = np.pad(descriptor.astype(np.float64), ((5, 5), (5, 5), (0, 0)))
    rows, cols = bordered.shape[:2]
    atoms = pair.hog.flatten(1).double().numpy()
    root = np.linalg.cholesky(atoms @ atoms.T + 1e-12 * np.eye(len(atoms)))
    y, x = (np.arange(7 * side) - (7 * side - 1) / 2 for side in (height, width))
    weights = np.exp(-((y[:, None] / (9 / 8 * height)) ** 2 + (x / (9 / 8 * width)) ** 2) / 2)
    total, count = (np.zeros(((rows + 2) * height, (cols + 2) * width)) for _ in range(2))
    for row in range(rows - 4):
        for col in range(cols - 4):
            window = bordered[row : row + 5, col : col + 5].ravel()
            window = window - window.mean()
            window = window / np.sqrt((window**2).sum() + np.finfo(np.float64).eps)
            code, _ = nnls(root.T, np.linalg.solve(root, atoms @ window - pair.sparsity))
            place = np.s_[row * height : (row + 7) * height, col * width : (col + 7) * width]
            total[place] += weights / weights.sum() * np.tensordot(code, pair.gray.double().numpy(), 1)
            count[place] += 1
    image = total / count
    image = (image - image.min()) / (image.max() - image.min())
    return image[6 * height : 6 * height + size[0], 6 * width : 6 * width + size[1]]


@pytest.mark.parametrize(
    ("spec", "size"), [(SPEC, (24, 32)), (presets.uoctti((4, 6)), (27, 28)), (presets.paper(4), (31, 25))]
)
def test_the_published_rule(spec: HOGSpec, size: tuple[int, int]) -> None:
    pair = learn_hoggles(_images(), spec, atoms=25, fast=True, sparsity=0.05)
    descriptor = hog(photograph(64, "coffee")[..., : size[0], : size[1]], spec)
    result = pair.reconstruct(descriptor, spec, size)
    np.testing.assert_allclose(result.image[0, 0], _reference(pair, descriptor[0].numpy(), size), atol=5e-3)
    residual = (hog(result.image, spec) - descriptor).norm() / descriptor.norm()
    assert float(result.distance[0]) == pytest.approx(float(residual), rel=1e-4)


@pytest.mark.slow
def test_a_batch_is_its_images(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("nablahog.paper.baselines.hoggles.WINDOW_BATCH", 2 * 22 * 22)
    descriptors = hog(torch.cat([photograph(64, name) for name in ("camera", "coffee", "astronaut")]), SPEC)
    together = _learned().reconstruct(descriptors, SPEC, (64, 63))
    assert together.image.shape == (3, 1, 64, 63)
    assert together.history.shape == (0, 3)
    for k in range(3):
        alone = _learned().reconstruct(descriptors[k : k + 1], SPEC, (64, 63))
        torch.testing.assert_close(together.image[k : k + 1], alone.image, atol=1e-4, rtol=0)


def test_nothing_to_invert() -> None:
    pair, began = _learned(), time.perf_counter()
    result = pair.reconstruct(torch.zeros(1, 6, 8, 31), SPEC)
    assert 0 < result.seconds < time.perf_counter() - began
    assert torch.equal(result.image, torch.full((1, 1, 24, 32), 0.5))


def test_what_does_not_fit() -> None:
    descriptor = hog(photograph(64), SPEC)
    with pytest.raises(ValueError, match=r"the dictionary was learned for another spec: its cell_size is \(4, 4\)"):
        _learned().reconstruct(descriptor, presets.uoctti(8))
    renamed = dataclasses.replace(SPEC, name="mine")
    assert torch.equal(
        _learned().reconstruct(descriptor, renamed).image, _learned().reconstruct(descriptor, SPEC).image
    )
    for wrong, size in ((descriptor, (64, 80)), (descriptor * torch.nan, None)):
        with pytest.raises(ValueError, match="must"):
            _learned().reconstruct(wrong, SPEC, size)


# --- files


def test_wrong_contents(tmp_path: Path) -> None:
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"gray": np.full((2, 28, 28), np.nan, np.float32)}, "gray must lie within ±1, got NaN"),
        ({"gray": np.zeros((2, 28, 27), np.float32)}, r"gray must be float32 of shape \(2, 28, 28\)"),
        ({"hog": np.zeros((1, 5, 5, 31), np.float32)}, r"hog must be float32 of shape \(2, 5, 5, 31\)"),
        ({"sparsity": np.array(0.0)}, "sparsity must be a finite number above 0, got 0.0"),
    ]
    for changed, message in wrong:
        check_refused(tiny_models.hoggles(), tmp_path / "p.npz", changed, message)


# --- learning


@pytest.mark.slow
def test_learning_lowers_the_objective_of_other_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    windows_alone = learn_hoggles(_images(), SPEC, atoms=40, fast=True)
    others = unit(hog_windows(hog(photograph(64, "coffee"), SPEC)).flatten(3).flatten(0, 2))

    def objective(pair: PairedDictionary) -> float:
        atoms = torch.nn.functional.normalize(pair.hog.flatten(1))
        codes = positive_lasso(atoms, others, 0.02)
        return float((others - codes @ atoms).square().sum() / 2 + 0.02 * codes.sum()) / len(others)

    assert objective(_learned()) < 0.95 * objective(windows_alone)
    monkeypatch.setattr("nablahog.paper.baselines.hoggles_learning.REPORTED", 5)
    of_batches = learn_hoggles(_images(), SPEC, atoms=40, iterations=12).learning.objective
    assert len(of_batches) == 3
    assert of_batches[2] < of_batches[1] < of_batches[0]


def test_fast_atoms_are_windows_with_their_patches() -> None:
    pair = learn_hoggles(_images(), SPEC, atoms=60, fast=True)
    patches, windows = [], []
    for image in _images().values():
        patches.append(image.unfold(0, 28, 4).unfold(1, 28, 4).reshape(-1, 28 * 28))
        inner = hog(image[None, None], SPEC)[:, 1:-1, 1:-1]
        windows.append(hog_windows(inner).flatten(3).flatten(0, 2))
    pool = torch.cat([unit(torch.cat(patches)), unit(torch.cat(windows))], dim=1)
    for atom in torch.cat([pair.gray.flatten(1), pair.hog.flatten(1)], dim=1):
        assert (pool - atom).abs().amax(dim=1).min() < 1e-5
    assert (pair.learning.iterations, pair.learning.objective, pair.learning.windows) == (0, (), len(pool))


@pytest.mark.slow
def test_the_seed_decides() -> None:
    first = _learned()
    second = learn_hoggles(dict(reversed(_images().items())), SPEC, atoms=40, iterations=4)
    assert torch.equal(first.gray, second.gray)
    assert torch.equal(first.hog, second.hog)
    assert first.learning == second.learning
    assert not torch.equal(learn_hoggles(_images(), SPEC, atoms=40, iterations=4, seed=1).hog, first.hog)


def test_an_interrupted_learning_is_resumed_with_the_same_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Batches are small, so that many atoms are not used and are drawn at random again."""
    monkeypatch.setattr("nablahog.paper.baselines.hoggles_learning.STEP_WINDOWS", 20)
    monkeypatch.setattr("nablahog.paper.baselines.hoggles_learning.SAVED", 2)
    monkeypatch.setattr("nablahog.paper.baselines.hoggles_learning.REPORTED", 3)
    path, options = tmp_path / "kept", {"spec": SPEC, "atoms": 100, "sparsity": 0.5, "iterations": 6}
    undisturbed = learn_hoggles(_images(), **options)
    with pytest.raises(KeyboardInterrupt):
        learn_hoggles(_images(), **options, checkpoint=path, progress=Interruption(5))
    for name, value in {
        "images": _images("brick", "coins", "clock"),
        "spec": presets.uoctti(4, vote="hard"),
        "atoms": 99,
        "sparsity": 0.4,
        "iterations": 7,
        "seed": 1,
    }.items():
        with pytest.raises(ValueError, match=rf"checkpoint of another training \(with other {name}\)"):
            learn_hoggles(**{"images": _images(), **options, name: value}, checkpoint=path)
    resumed = Interruption()
    result = learn_hoggles(_images(), **options, checkpoint=path, progress=resumed)
    assert resumed.steps == [0, 4, 5, 6]
    assert torch.equal(result.gray, undisturbed.gray)
    assert torch.equal(result.hog, undisturbed.hog)
    assert result.learning == undisturbed.learning


def test_the_published_numbers() -> None:
    """Of the authors' `learnpairdict`."""
    assert (learning.ATOMS, learning.SPARSITY, learning.LEARNING_STEPS) == (1024, 0.02, 1000)
    assert (learning.STEP_WINDOWS, learning.TRAINING_WINDOWS) == (400, 1_000_000)


def test_what_cannot_be_learned_from() -> None:
    camera, margin = photograph(64)[0, 0], torch.zeros(28, 28)
    margin[0, 0] = 1  # seen by the patch alone
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"images": {"a": camera[:27]}}, "a must have at least 28x28 pixels, got 27x64"),
        ({"images": {"a": torch.full((64, 64), 0.5)}}, "at least 5 windows of 5x5 cells .* got 0 of 100"),
        ({"images": {"a": margin}, "atoms": 1}, "at least 1 windows of 5x5 cells .* got 0 of 1"),
        ({"atoms": 0}, "atoms must be at least 1, got 0"),
        ({"sparsity": float("nan")}, "sparsity must be a finite number above 0, got nan"),
        ({"spec": presets.dpm()}, "one entry for each cell: dpm has blocks"),
    ]
    for changed, message in wrong:
        with pytest.raises(ValueError, match=message):
            learn_hoggles(**{"images": {"a": camera}, "spec": SPEC, "atoms": 5, **changed})
