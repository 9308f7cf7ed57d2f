"""HOGgles: images are those of the published rule, and files that contradict themselves are refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.optimize import nnls

from nablahog import hog, presets
from nablahog.hog import HOGSpec
from nablahog.metrics import cross_correlation
from nablahog.paper.baselines.hoggles import PairedDictionary, unit
from nablahog.paper.baselines.hoggles_learning import learn_hoggles

from ...invert.photographs import photograph
from ...io import tiny_models
from ...io.archives import check_refused
from .hoggles_pairs import SPEC, images, learned


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
    result = pair.reconstruct(descriptor, spec, size)
    assert result.image.shape == (1, 1, *size)
    np.testing.assert_allclose(result.image[0, 0], _reference(pair, descriptor[0].numpy(), size), atol=5e-3)


def test_images_learned_from_come_back() -> None:
    for name, image in images().items():
        pair = learn_hoggles({name: image}, SPEC, atoms=100, fast=True)
        result = pair.reconstruct(hog(image[None, None], SPEC), SPEC)
        assert cross_correlation(result.image[0, 0], image) > 0.65


def test_images_not_learned_from_are_recognised() -> None:
    image = photograph(64, "coffee")
    result = learned().reconstruct(hog(image, SPEC), SPEC)
    assert cross_correlation(result.image[0, 0], image[0, 0]) > 0.4


def test_contrast_does_not_matter() -> None:
    descriptor = hog(photograph(64), SPEC)
    whole, half = (learned().reconstruct(c * descriptor, SPEC).image for c in (1, 0.5))
    torch.testing.assert_close(half, whole, atol=1e-4, rtol=0)


def test_nothing_to_invert() -> None:
    result = learned().reconstruct(torch.zeros(1, 6, 8, 31), SPEC)
    assert torch.equal(result.image, torch.full((1, 1, 24, 32), 0.5))


# --- files


ATOMS = 2


def _atoms(*shape: int, value: float = 0.0) -> NDArray[np.float32]:
    return np.full((ATOMS, *shape), value, np.float32)


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "NaN": ({"gray": _atoms(28, 28, value=np.nan)}, "gray must lie within ±1, got NaN"),
    "too large": ({"hog": _atoms(5, 5, 31, value=1.1)}, "hog must lie within ±1, got NaN, Inf or more"),
    "other patches": ({"gray": _atoms(28, 27)}, r"gray must be float32 of shape \(2, 28, 28\), got float32 of"),
    "fewer atoms": ({"hog": _atoms(5, 5, 31)[:1]}, r"hog must be float32 of shape \(2, 5, 5, 31\)"),
    "no atoms": ({"gray": _atoms(28, 28)[:0], "hog": _atoms(5, 5, 31)[:0]}, r"gray must be float32 of shape \(0, "),
    "one number": ({"gray": np.array(1, np.float32)}, "gray must be float32 of shape"),
    "another type": ({"gray": _atoms(28, 28).astype(np.float16)}, "gray must be float32, got float16"),
    "another spec": ({"spec": np.array(presets.uoctti(8).to_json())}, r"gray must be float32 of shape \(2, 56, 56\)"),
    "no sparsity": ({"sparsity": np.array(0.0)}, "sparsity must be a finite number above 0, got 0.0"),
    "sparsity of another type": ({"sparsity": np.array("x")}, "sparsity must be one float64"),
}


@pytest.mark.parametrize("what", WRONG)
def test_wrong_contents(tmp_path: Path, what: str) -> None:
    check_refused(tiny_models.hoggles(), tmp_path / "p.npz", *WRONG[what])
