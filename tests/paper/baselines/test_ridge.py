"""Ridge regression: the weights are those of another solver, images are what these make of them, and files that
contradict themselves are refused."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

from nablahog import hog, presets
from nablahog.hog import HOGSpec
from nablahog.metrics import cross_correlation
from nablahog.paper.baselines.ridge import CELLS, RidgeRegression, learn_ridge
from nablahog.paper.baselines.windows import Pairs, patch_size, stretched

from ...invert.photographs import photograph
from ...io import tiny_models
from ...io.archives import check_refused

SPEC = presets.uoctti((4, 3), orientations=3)
SIZE = (47, 50)  # of no whole cells
NAMES = ("camera", "coins", "clock")


def _images() -> dict[str, Tensor]:
    height, width = SIZE
    return {name: photograph(64, name)[0, 0, :height, :width].contiguous() for name in NAMES}


@cache
def _learned() -> RidgeRegression:
    return learn_ridge(_images(), SPEC)


@cache
def _descriptors() -> Tensor:
    names = ("camera", "coffee", "astronaut")
    return hog(torch.cat([photograph(64, name)[..., : SIZE[0], : SIZE[1]] for name in names]), SPEC)


# --- learning


def _pairs() -> tuple[NDArray[Any], NDArray[Any]]:
    """All windows and their patches, in double precision."""
    images = _images()
    every = Pairs([images[name] for name in sorted(images)], SPEC, CELLS, 10**6, np.random.default_rng(0))
    windows, patches = (torch.cat(parts).double().numpy() for parts in zip(*every, strict=True))
    return windows, patches


@pytest.mark.parametrize("penalty", [0.01, 3.0])
def test_weights_are_those_of_another_solver(penalty: float) -> None:
    """A penalty is as many more rows, which want each weight to be 0."""
    windows, patches = _pairs()
    entries = windows.shape[1]
    root = np.sqrt(penalty * (windows**2).sum(0).mean())
    rows = np.block([[windows, np.ones((len(windows), 1))], [root * np.eye(entries), np.zeros((entries, 1))]])
    targets = np.concatenate([patches, np.zeros((entries, patches.shape[1]))])
    expected = np.linalg.lstsq(rows, targets, rcond=None)[0]
    result = learn_ridge(_images(), SPEC, penalty=penalty)
    np.testing.assert_allclose(result.weights, expected, atol=5e-4)
    assert result.learning.penalty == penalty
    assert result.learning.windows == len(windows)


def test_the_largest_penalty_leaves_the_mean_patch() -> None:
    weights = learn_ridge(_images(), SPEC, penalty=1e9).weights
    assert weights[:-1].abs().max() < 1e-6
    np.testing.assert_allclose(weights[-1], _pairs()[1].mean(0), atol=1e-5)


def test_the_least_penalty() -> None:
    assert learn_ridge(_images(), SPEC, penalty=1e-6).weights.isfinite().all()


def test_nothing_but_images_and_numbers_decides() -> None:
    images, few = _images(), {"windows": 200}
    first = learn_ridge(images, SPEC, **few)
    torch.rand(1)  # the global generator does not
    second = learn_ridge(dict(reversed(images.items())), SPEC, **few)
    assert torch.equal(first.weights, second.weights)
    assert first.learning == second.learning
    assert first.learning.images == tuple(sorted(NAMES))
    assert (first.learning.windows, first.learning.seed) == (200, 0)
    assert not torch.equal(learn_ridge(images, SPEC, seed=1, **few).weights, first.weights)
    other = learn_ridge({**images, "clock": images["coins"]}, SPEC)
    assert other.learning.sha256 != first.learning.sha256


def test_progress() -> None:
    seen: list[tuple[int, int, str]] = []
    learn_ridge(_images(), SPEC, progress=lambda *at: seen.append(at))
    names = [(k, 3, name) for k, name in enumerate(sorted(NAMES))]
    assert seen == [*names, (3, 3, "solving for the weights")]


def test_images_of_several_sizes() -> None:
    camera = photograph(64)[0, 0]
    images = {"a": camera[:2, :2], "b": camera[:9, :30], "c": camera}
    assert learn_ridge(images, SPEC).learning.windows == 1 * 1 + 2 * 10 + 16 * 21


def test_what_cannot_be_learned_from() -> None:
    camera = photograph(64)[0, 0]
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"images": {}}, "expected images to learn from, got none"),
        ({"images": {"a": camera[:1]}}, "a: the image must hold at least one cell of 4x3 pixels"),
        ({"images": {"a": camera * torch.nan}}, "a: expected an image"),
        ({"images": {"a": camera.double()}}, "a: expected an image"),
        ({"windows": 0}, "windows must be at least 1, got 0"),
        ({"penalty": 0.0}, "penalty must be a finite number above 0, got 0"),
        ({"penalty": float("inf")}, "penalty must be a finite number above 0, got inf"),
        ({"penalty": float("nan")}, "penalty must be a finite number above 0, got nan"),
        ({"seed": -1}, "non-negative"),
    ]
    for changed, message in wrong:
        with pytest.raises(ValueError, match=message):
            learn_ridge(**{"images": {"a": camera}, "spec": SPEC, **changed})


# --- inversion


def _reference(ridge: RidgeRegression, descriptor: NDArray[Any], size: tuple[int, int]) -> NDArray[Any]:
    """Window by window, in double precision."""
    height, width = ridge.spec.cell_size
    rows, cols = descriptor.shape[:2]
    around = CELLS // 2
    bordered = np.pad(descriptor.astype(np.float64), ((around, around), (around, around), (0, 0)))
    weights = ridge.weights.double().numpy()
    total, count = (np.zeros(((rows + 2 * around) * height, (cols + 2 * around) * width)) for _ in range(2))
    for row in range(rows):
        for col in range(cols):
            window = bordered[row : row + CELLS, col : col + CELLS].ravel()
            place = np.s_[row * height : (row + CELLS) * height, col * width : (col + CELLS) * width]
            total[place] += (window @ weights[:-1] + weights[-1]).reshape(patch_size(ridge.spec, CELLS))
            count[place] += 1
    image = (total / count)[around * height :, around * width :][: size[0], : size[1]]
    return (image - image.min()) / (image.max() - image.min())


@pytest.mark.parametrize(
    ("spec", "size"), [(SPEC, SIZE), (SPEC, (48, 51)), (presets.paper((3, 5)), (31, 44)), (SPEC, (2, 3))]
)
def test_images_are_means_of_patches(spec: HOGSpec, size: tuple[int, int]) -> None:
    ridge = learn_ridge(_images(), spec)
    descriptor = hog(photograph(64, "coffee")[..., : size[0], : size[1]], spec)
    result = ridge.reconstruct(descriptor, spec, size)
    assert result.image.shape == (1, 1, *size)
    np.testing.assert_allclose(result.image[0, 0], _reference(ridge, descriptor[0].numpy(), size), atol=1e-4)


def test_images_not_learned_from_are_recognised() -> None:
    spec = presets.uoctti(4)
    ridge = learn_ridge({name: photograph(64, name)[0, 0] for name in ("coins", "coffee", "rocket", "chelsea")}, spec)
    image = photograph(64)
    assert cross_correlation(ridge.reconstruct(hog(image, spec), spec).image[0, 0], image[0, 0]) > 0.5


def test_nothing_to_invert() -> None:
    """The constants alone are left, in each cell the same mean of those of all cells of a patch."""
    descriptor = hog(torch.full((1, 1, 64, 48), 0.7), SPEC)
    assert not descriptor.any()
    cell = _learned().weights[-1].view(1, 1, CELLS, 4, CELLS, 3).mean((2, 4))
    middle = _learned().reconstruct(descriptor, SPEC).image[..., 24:28, 24:27]
    torch.testing.assert_close(stretched(middle), stretched(cell), atol=1e-3, rtol=0)


@pytest.mark.parametrize("gray", [0.5, 0.3])
def test_images_without_contrast(gray: float) -> None:
    ridge = learn_ridge({"flat": torch.full((30, 30), gray)}, SPEC)
    result = ridge.reconstruct(hog(torch.full((1, 1, 24, 24), 0.7), SPEC), SPEC)
    assert torch.equal(result.image, torch.full((1, 1, 24, 24), 0.5))
    assert result.distance.isfinite().all()


# --- files


SHAPE = (491, 49)


def _weights(value: float = 0.0) -> NDArray[np.float32]:
    return np.full(SHAPE, value, np.float32)


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "NaN": ({"weights": _weights(np.nan)}, "the weights must lie within ±1e.06, got NaN, Inf or more"),
    "Inf": ({"weights": _weights(-np.inf)}, "the weights must lie within"),
    "too large": ({"weights": _weights(2e6)}, "the weights must lie within"),
    "no constant": (
        {"weights": _weights()[:-1]},
        r"the weights must be float32 of shape \(491, 49\), got",
    ),
    "one number": ({"weights": np.array(1, np.float32)}, r"must be float32 of shape \(491, 49\), got .* of \(\)"),
    "doubles": ({"weights": _weights().astype(float)}, "the weights must be float32, got float64"),
    "bytes in another order": ({"weights": _weights().astype(">f4")}, "the weights must be float32, got >f4"),
    "another spec": ({"spec": np.array(SPEC.to_json())}, r"the weights must be float32 of shape \(638, 588\)"),
}


@pytest.mark.parametrize("what", WRONG)
def test_wrong_contents(tmp_path: Path, what: str) -> None:
    check_refused(tiny_models.ridge(), tmp_path / "r.npz", *WRONG[what])
