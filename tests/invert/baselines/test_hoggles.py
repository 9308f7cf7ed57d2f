"""HOGgles: codes are optimal, images are what the published rule makes of them, and what is saved comes back."""

from __future__ import annotations

import dataclasses
import os
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
    lasso,
    unit,
)
from nablahog.invert.baselines.hoggles_learning import learn_hoggles
from nablahog.metrics import cross_correlation

from ..photographs import photograph
from .hoggles_pairs import NAMES, SPEC, fast, images, learned

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
    pair = learn_hoggles(images(), spec, atoms=25, fast=True, sparsity=0.05)
    descriptor = hog(photograph(64, "coffee")[..., : size[0], : size[1]], spec)
    found = pair.reconstruct(descriptor, spec, size)
    assert found.image.shape == (1, 1, *size)
    np.testing.assert_allclose(found.image[0, 0], _reference(pair, descriptor[0].numpy(), size), atol=5e-3)


def test_images_learned_from_come_back() -> None:
    for name, image in images().items():
        pair = learn_hoggles({name: image}, SPEC, atoms=100, fast=True)
        found = pair.reconstruct(hog(image[None, None], SPEC), SPEC)
        assert cross_correlation(found.image[0, 0], image) > 0.65


def test_images_not_learned_from_are_recognised() -> None:
    image = photograph(64, "coffee")
    found = learned().reconstruct(hog(image, SPEC), SPEC)
    assert cross_correlation(found.image[0, 0], image[0, 0]) > 0.4


def test_a_batch_is_its_images(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("nablahog.invert.baselines.hoggles.TOGETHER", 2 * (16 + 6) ** 2)
    descriptors = hog(torch.cat([photograph(64, name) for name in NAMES]), SPEC)
    seen: list[tuple[int, int]] = []
    together = fast().reconstruct(descriptors, SPEC, progress=lambda *at: seen.append(at))
    assert seen == [(0, 3), (2, 3), (3, 3)]
    for k in range(3):
        alone = fast().reconstruct(descriptors[k : k + 1], SPEC)
        torch.testing.assert_close(together.image[k : k + 1], alone.image, atol=1e-4, rtol=0)
        torch.testing.assert_close(together.distance[k : k + 1], alone.distance, atol=1e-4, rtol=0)
    assert together.history.shape == (0, 3)
    assert together.evaluations.tolist() == [0, 0, 0]
    assert len(together.stop_reason) == 3
    assert together.image.min() >= 0
    assert together.image.max() <= 1


def test_the_distance_is_that_of_the_image() -> None:
    descriptor = hog(photograph(64), SPEC)
    found = learned().reconstruct(descriptor.double(), SPEC, (64, 64))
    assert found.image.dtype == found.distance.dtype == torch.float64
    expected = (hog(found.image, SPEC) - descriptor).norm() / descriptor.norm()
    assert float(found.distance[0]) == pytest.approx(float(expected), rel=1e-5)
    assert 0.1 < float(found.distance[0]) < 1


def test_contrast_does_not_matter() -> None:
    descriptor = hog(photograph(64), SPEC)
    whole, half = (learned().reconstruct(c * descriptor, SPEC).image for c in (1, 0.5))
    torch.testing.assert_close(half, whole, atol=1e-4, rtol=0)


def test_nothing_to_invert() -> None:
    found = learned().reconstruct(torch.zeros(1, 6, 8, 31), SPEC)
    assert torch.equal(found.image, torch.full((1, 1, 24, 32), 0.5))


def test_what_does_not_fit() -> None:
    descriptor = hog(photograph(64), SPEC)
    pair = learned()
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


# --- files


def test_round_trip(tmp_path: Path) -> None:
    pair = learned()
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
    learned().save(path)
    whole = path.read_bytes()
    middle = len(whole) // 2
    turned = whole[:middle] + bytes([whole[middle] ^ 0xFF]) + whole[middle + 1 :]
    for damaged in (b"", b"hello", whole[:100], whole[:middle], whole[:-1], turned):
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match=r"expected a dictionary pair|damaged"):
            PairedDictionary.load(path)
