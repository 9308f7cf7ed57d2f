"""HOGgles: codes are optimal, images are what the published rule makes of them, learning lowers the objective, and what
is saved comes back."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator
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
from nablahog.invert.baselines.hoggles import (
    EXACTNESS,
    Learning,
    PairedDictionary,
    hog_windows,
    lasso,
    unit,
)
from nablahog.invert.baselines.hoggles_learning import PATIENCE, Learner, learn_hoggles
from nablahog.metrics import cross_correlation

from ..photographs import photograph

SPEC = presets.uoctti(4)
NAMES = ("camera", "coins", "clock")


def _images(*names: str) -> dict[str, Tensor]:
    return {name: photograph(64, name)[0, 0] for name in names or NAMES}


@cache
def _learned() -> PairedDictionary:
    return learn_hoggles(_images(), SPEC, atoms=40, iterations=8)


@cache
def _fast(spec: HOGSpec = SPEC, atoms: int = 60) -> PairedDictionary:
    return learn_hoggles(_images(), spec, atoms=atoms, fast=True)


@pytest.fixture
def two_threads() -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    yield
    torch.set_num_threads(before)


# --- codes


def _problem(atoms: int = 50, windows: int = 300, size: int = 20) -> tuple[Tensor, Tensor]:
    """Atoms that are much alike, as those of windows are, and windows."""
    common = torch.randn(size)
    dictionary = torch.randn(atoms, size) + common
    return dictionary / dictionary.norm(dim=1, keepdim=True), unit(torch.randn(windows, size) + common)


def test_codes_meet_the_conditions_of_the_optimum() -> None:
    dictionary, windows = _problem()
    for sparsity in (0.02, 0.3):
        codes = lasso(dictionary @ dictionary.T, windows @ dictionary.T, sparsity)
        ascent = (windows - codes @ dictionary) @ dictionary.T - sparsity
        assert codes.min() >= 0
        assert 0.02 < float((codes > 0).float().mean()) < 0.5
        assert ascent[codes > 0].abs().max() <= 1.1 * EXACTNESS * sparsity
        assert ascent[codes == 0].max() <= 1.1 * EXACTNESS * sparsity


def test_codes_are_those_of_another_solver() -> None:
    """Completing the square makes a positive lasso a non-negative least squares problem, where DᵀD has an inverse."""
    dictionary, windows = _problem(atoms=15, windows=10)
    codes = lasso(dictionary @ dictionary.T, windows @ dictionary.T, 0.05)
    root = torch.linalg.cholesky(dictionary.double() @ dictionary.double().T)
    target = torch.linalg.solve_triangular(root, (windows @ dictionary.T - 0.05).double().T, upper=False).T
    expected = np.stack([nnls(root.mT.numpy(), each.numpy())[0] for each in target])
    np.testing.assert_allclose(codes.numpy(), expected, atol=5e-3)


def test_codes_of_one_atom() -> None:
    windows = torch.tensor([[3.0, 0.0], [0.1, 5.0], [-3.0, 0.0]])
    atom = torch.tensor([[2.0, 0.0]])
    found = lasso(atom @ atom.T, windows @ atom.T, 0.5)
    torch.testing.assert_close(found, torch.tensor([[(6 - 0.5) / 4], [0.0], [0.0]]))


def test_codes_of_equal_and_of_empty_atoms() -> None:
    dictionary, windows = _problem()
    alone = lasso(dictionary @ dictionary.T, windows @ dictionary.T, 0.02)
    twice = torch.cat([dictionary, dictionary, torch.zeros(2, dictionary.shape[1])])
    found = lasso(twice @ twice.T, windows @ twice.T, 0.02)
    assert not found[:, -2:].any()
    torch.testing.assert_close(found @ twice, alone @ dictionary, atol=2e-3, rtol=0)


def test_codes_do_not_depend_on_threads(two_threads: None) -> None:
    dictionary, windows = _problem()
    problem = (dictionary @ dictionary.T, windows @ dictionary.T, 0.02)
    at_once = lasso(*problem)
    torch.set_num_threads(1)
    assert torch.equal(lasso(*problem), at_once)


def test_windows_of_mean_0_and_length_1() -> None:
    windows = unit(torch.cat([torch.rand(4, 800), torch.full((1, 800), 0.7), torch.zeros(1, 800)]))
    torch.testing.assert_close(windows[:4].norm(dim=1), torch.ones(4))
    assert windows.mean(1).abs().max() < 1e-7
    assert windows[4:].abs().max() < 1e-6


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
    ("spec", "size"),
    [(SPEC, (24, 32)), (presets.uoctti((4, 6)), (27, 28)), (presets.paper(4), (31, 25))],
)
def test_the_published_rule(spec: HOGSpec, size: tuple[int, int]) -> None:
    pair = learn_hoggles(_images(), spec, atoms=25, fast=True, sparsity=0.05)
    descriptor = hog(photograph(64, "coffee")[..., : size[0], : size[1]], spec)
    found = pair.reconstruct(descriptor, spec, size)
    assert found.image.shape == (1, 1, *size)
    np.testing.assert_allclose(found.image[0, 0], _reference(pair, descriptor[0].numpy(), size), atol=5e-3)


def test_images_learned_from_come_back() -> None:
    for name, image in _images().items():
        pair = learn_hoggles({name: image}, SPEC, atoms=100, fast=True)
        found = pair.reconstruct(hog(image[None, None], SPEC), SPEC)
        assert cross_correlation(found.image[0, 0], image) > 0.65


def test_images_not_learned_from_are_recognised() -> None:
    image = photograph(64, "coffee")
    found = _learned().reconstruct(hog(image, SPEC), SPEC)
    assert cross_correlation(found.image[0, 0], image[0, 0]) > 0.4


def test_a_batch_is_its_images(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("nablahog.invert.baselines.hoggles.TOGETHER", 2 * (16 + 6) ** 2)
    descriptors = hog(torch.cat([photograph(64, name) for name in NAMES]), SPEC)
    seen: list[tuple[int, int]] = []
    together = _fast().reconstruct(descriptors, SPEC, progress=lambda *at: seen.append(at))
    assert seen == [(0, 3), (2, 3), (3, 3)]
    for k in range(3):
        alone = _fast().reconstruct(descriptors[k : k + 1], SPEC)
        torch.testing.assert_close(together.image[k : k + 1], alone.image, atol=1e-4, rtol=0)
        torch.testing.assert_close(together.distance[k : k + 1], alone.distance, atol=1e-4, rtol=0)
    assert together.history.shape == (0, 3)
    assert together.evaluations.tolist() == [0, 0, 0]
    assert len(together.stop_reason) == 3
    assert together.image.min() >= 0
    assert together.image.max() <= 1


def test_the_distance_is_that_of_the_image() -> None:
    descriptor = hog(photograph(64), SPEC)
    found = _learned().reconstruct(descriptor.double(), SPEC, (64, 64))
    assert found.image.dtype == found.distance.dtype == torch.float64
    expected = (hog(found.image, SPEC) - descriptor).norm() / descriptor.norm()
    assert float(found.distance[0]) == pytest.approx(float(expected), rel=1e-5)
    assert 0.1 < float(found.distance[0]) < 1


def test_contrast_does_not_matter() -> None:
    descriptor = hog(photograph(64), SPEC)
    whole, half = (_learned().reconstruct(c * descriptor, SPEC).image for c in (1, 0.5))
    torch.testing.assert_close(half, whole, atol=1e-4, rtol=0)


def test_nothing_to_invert() -> None:
    found = _learned().reconstruct(torch.zeros(1, 6, 8, 31), SPEC)
    assert torch.equal(found.image, torch.full((1, 1, 24, 32), 0.5))


def test_what_does_not_fit() -> None:
    descriptor = hog(photograph(64), SPEC)
    pair = _learned()
    with pytest.raises(ValueError, match=r"learned for another spec: its cell_size is \(4, 4\), the uoctti"):
        pair.reconstruct(descriptor, presets.uoctti(8))
    renamed = dataclasses.replace(SPEC, name="mine")
    assert torch.equal(pair.reconstruct(descriptor, renamed).image, pair.reconstruct(descriptor, SPEC).image)
    with pytest.raises(ValueError, match="must have shape"):
        pair.reconstruct(descriptor, SPEC, (64, 72))
    with pytest.raises(ValueError, match="must be finite"):
        pair.reconstruct(descriptor * torch.nan, SPEC)
    with pytest.raises(TypeError, match="must be a float32 or float64 tensor, got ndarray"):
        pair.reconstruct(descriptor.numpy(), SPEC)  # type: ignore[arg-type]


# --- learning


def test_atoms_are_updated_one_after_the_other() -> None:
    """Blocks of them give what a plain loop gives, and the objective that they approximate falls."""
    data = unit(torch.rand(500, 30))
    learner = Learner(data[:150], 0.02, np.random.default_rng(0))
    codes = lasso(learner.atoms @ learner.atoms.T, data @ learner.atoms.T, 0.02).double()
    expected, products, target = learner.atoms.double(), codes.T @ codes / 500, codes.T @ data.double() / 500
    before = ((data - codes @ expected) ** 2).sum()
    for k in range(150):
        if products[k, k] > 1e-6:
            atom = expected[k] + (target[k] - products[k] @ expected) / products[k, k]
            expected[k] = atom / max(1.0, float(atom.norm()))
    learner.learn(data)
    torch.testing.assert_close(learner.atoms.double(), expected, atol=1e-4, rtol=0)
    assert ((data - codes @ learner.atoms.double()) ** 2).sum() < before
    assert learner.atoms.norm(dim=1).max() < 1 + 1e-5


def test_learning_lowers_the_objective_of_other_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    fast = learn_hoggles(_images(), SPEC, atoms=40, fast=True)
    others = unit(hog_windows(hog(photograph(64, "coffee"), SPEC)).flatten(3).flatten(0, 2))

    def objective(pair: PairedDictionary) -> float:
        atoms = pair.hog.flatten(1)
        atoms = atoms / atoms.norm(dim=1, keepdim=True)
        codes = lasso(atoms @ atoms.T, others @ atoms.T, 0.02)
        return float((others - codes @ atoms).square().sum() / 2 + 0.02 * codes.sum()) / len(others)

    assert objective(_learned()) < 0.95 * objective(fast)
    monkeypatch.setattr("nablahog.invert.baselines.hoggles_learning.REPORTED", 5)
    of_batches = learn_hoggles(_images(), SPEC, atoms=40, iterations=12).learning.objective
    assert len(of_batches) == 3
    assert of_batches[2] < of_batches[1] < of_batches[0]


def test_atoms_that_are_not_used_give_way() -> None:
    windows = unit(torch.rand(50, 6))
    learner = Learner(torch.cat([windows[:5], torch.zeros(1, 6)]), 0.02, np.random.default_rng(0))
    for _ in range(PATIENCE):
        assert not learner.atoms[5].any()
        learner.learn(windows)
    assert any(torch.allclose(learner.atoms[5], window) for window in windows)


def test_fast_atoms_are_windows_with_their_patches() -> None:
    pair = _fast()
    patches, windows = [], []
    for image in _images().values():
        patches.append(image.unfold(0, 28, 4).unfold(1, 28, 4).reshape(-1, 28 * 28))
        inner = hog(image[None, None], SPEC)[:, 1:-1, 1:-1]
        windows.append(hog_windows(inner).flatten(3).flatten(0, 2))
    pool = torch.cat([unit(torch.cat(patches)), unit(torch.cat(windows))], dim=1)
    for atom in torch.cat([pair.gray.flatten(1), pair.hog.flatten(1)], dim=1):
        assert (pool - atom).abs().amax(dim=1).min() < 1e-5
    assert pair.learning.iterations == 0
    assert pair.learning.objective == ()
    assert pair.learning.windows == len(pool)


def test_the_seed_decides() -> None:
    images = _images()
    first = _learned()
    torch.rand(1)  # the global generator does not
    second = learn_hoggles(dict(reversed(images.items())), SPEC, atoms=40, iterations=8)
    assert torch.equal(first.gray, second.gray)
    assert torch.equal(first.hog, second.hog)
    assert first.learning == second.learning
    assert first.learning.images == tuple(sorted(NAMES))
    for changed in ({"seed": 1}, {"windows": 200}):
        assert not torch.equal(learn_hoggles(images, SPEC, atoms=40, iterations=8, **changed).hog, first.hog)
    other = learn_hoggles({**images, "clock": images["coins"]}, SPEC, atoms=40, fast=True)
    assert other.learning.sha256 != first.learning.sha256


def test_threads_make_no_difference_but_rounding(two_threads: None) -> None:
    found = learn_hoggles(_images(), SPEC, atoms=40, iterations=2)
    image = found.reconstruct(hog(photograph(64), SPEC), SPEC).image
    torch.set_num_threads(1)
    alone = learn_hoggles(_images(), SPEC, atoms=40, iterations=2)
    torch.testing.assert_close(found.hog, alone.hog, atol=1e-3, rtol=0)
    torch.testing.assert_close(image, alone.reconstruct(hog(photograph(64), SPEC), SPEC).image, atol=1e-2, rtol=0)


def test_progress() -> None:
    seen: list[tuple[int, int]] = []
    learn_hoggles(
        _images(), SPEC, atoms=10, iterations=2, progress=lambda done, total, what: seen.append((done, total))
    )
    assert seen == [(0, 2), (0, 2), (1, 2), (2, 2)]


def test_images_of_several_sizes() -> None:
    camera = photograph(64)[0, 0]
    images = {"a": camera[:28, :28], "b": camera[:39, :50], "c": camera}
    pair = learn_hoggles(images, SPEC, atoms=20, fast=True)
    assert pair.learning.windows == 1 + 3 * 6 + 10 * 10


def test_what_cannot_be_learned_from() -> None:
    camera = photograph(64)[0, 0]
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"images": {}}, "expected images to learn from, got none"),
        ({"images": {"a": camera[:27]}}, "a: expected at least 28x28 pixels, got 27x64"),
        ({"images": {"a": camera[:0]}}, "a: expected at least 28x28 pixels, got 0x64"),
        ({"images": {"a": camera * 255}}, "a: expected an image"),
        ({"images": {"a": camera.double()}}, "a: expected an image"),
        ({"images": {"a": camera * torch.nan}}, "a: expected an image"),
        ({"images": {"a": camera[None]}}, "a: expected an image"),
        ({"images": {"a": camera[:28, :28]}}, "at least 5 windows of 5x5 cells, got 1, 1 of them not flat"),
        ({"images": {"a": torch.full((64, 64), 0.5)}}, "at least 5 windows of 5x5 cells, got 100, 0 of them not flat"),
        ({"atoms": 0}, "atoms must be at least 1, got 0"),
        ({"iterations": 0}, "iterations must be at least 1, got 0"),
        ({"windows": 0}, "windows must be at least 1, got 0"),
        ({"sparsity": 0.0}, "sparsity must be a finite number above 0, got 0"),
        ({"sparsity": float("nan")}, "sparsity must be a finite number above 0, got nan"),
    ]
    for changed, message in wrong:
        with pytest.raises(ValueError, match=message):
            learn_hoggles(**{"images": {"a": camera}, "spec": SPEC, "atoms": 5, **changed})


# --- files


def test_round_trip(tmp_path: Path) -> None:
    pair = _learned()
    pair.save(tmp_path / "p")
    assert os.listdir(tmp_path) == ["p"]
    stored = PairedDictionary.load(tmp_path / "p")
    assert torch.equal(stored.gray, pair.gray)
    assert torch.equal(stored.hog, pair.hog)
    assert (stored.spec, stored.sparsity, stored.learning) == (pair.spec, pair.sparsity, pair.learning)
    descriptor = hog(photograph(64), SPEC)
    assert torch.equal(stored.reconstruct(descriptor, SPEC).image, pair.reconstruct(descriptor, SPEC).image)


ATOMS = 2
LEARNING = Learning(("a", "b"), "00", 9, 8, 400, 3, (1.5, 0.1 + 0.2))


def _atoms(*shape: int, value: float = 0.0) -> NDArray[np.float32]:
    return np.full((ATOMS, *shape), value, np.float32)


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "NaN": ({"gray": _atoms(28, 28, value=np.nan)}, "gray must lie within ±1, got NaN"),
    "too large": ({"hog": _atoms(5, 5, 31, value=1.1)}, "hog must lie within ±1, got NaN, Inf or more"),
    "other patches": ({"gray": _atoms(28, 27)}, r"gray must be float32 of shape \(2, 28, 28\), got torch.float32 of"),
    "fewer atoms": ({"hog": _atoms(5, 5, 31)[:1]}, r"hog must be float32 of shape \(2, 5, 5, 31\)"),
    "no atoms": ({"gray": _atoms(28, 28)[:0], "hog": _atoms(5, 5, 31)[:0]}, r"gray must be float32 of shape \(0, "),
    "one number": ({"gray": np.array(1, np.float32)}, "gray must be float32 of shape"),
    "another type": ({"gray": _atoms(28, 28).astype(np.float16)}, "gray must be float32, got float16"),
    "another spec": ({"spec": np.array(presets.uoctti(8).to_json())}, r"gray must be float32 of shape \(2, 56, 56\)"),
    "no spec": ({"spec": np.array("{}")}, "not the JSON of a HOGSpec"),
    "no sparsity": ({"sparsity": np.array(0.0)}, "sparsity must be a finite number above 0, got 0.0"),
    "sparsity of another type": ({"sparsity": np.array("x")}, "sparsity must be one float64"),
    "no account of the learning": ({"learning": np.array("{}")}, "its account of the learning cannot be read"),
    "a later format": ({"format": np.array(2)}, "dictionary pairs of format 1, got 2"),
    "no patches": ({"gray": None}, "expected a dictionary pair, but the archive lacks gray"),
    "pickled": ({"learning": np.array([{}], dtype=object)}, "pickled objects, which are never loaded"),
}


@pytest.mark.parametrize("what", WRONG)
def test_wrong_contents(tmp_path: Path, what: str) -> None:
    changed, message = WRONG[what]
    path = tmp_path / "p.npz"
    zeros = torch.from_numpy(_atoms(28, 28)), torch.from_numpy(_atoms(5, 5, 31))
    PairedDictionary(SPEC, *zeros, 0.02, LEARNING).save(path)
    with np.load(path, allow_pickle=False) as archive:
        arrays = {**archive, **changed}
    np.savez(path, **{name: value for name, value in arrays.items() if value is not None})
    with pytest.raises(ValueError, match=message) as caught:
        PairedDictionary.load(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_damaged_files(tmp_path: Path) -> None:
    path = tmp_path / "p.npz"
    with pytest.raises(FileNotFoundError, match="no such file"):
        PairedDictionary.load(path)
    _learned().save(path)
    whole = path.read_bytes()
    middle = len(whole) // 2
    turned = whole[:middle] + bytes([whole[middle] ^ 0xFF]) + whole[middle + 1 :]
    for damaged in (b"", b"hello", whole[:100], whole[:middle], whole[:-1], turned):
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match=r"expected a dictionary pair|damaged"):
            PairedDictionary.load(path)
