"""Nearest neighbours: they are those of a plain search, an image of the database is reproduced, and files that
contradict themselves are refused."""

from __future__ import annotations

import dataclasses
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from nablahog import hog, presets
from nablahog.paper.baselines.nearest import CELLS, NEIGHBOURS, NearestWindows, learn_nearest
from nablahog.paper.baselines.windows import Pairs, average_patches, crop, stretched, windows_at_cells

from ...invert.photographs import photograph
from ...io import tiny_models
from ...io.archives import check_refused

SPEC = presets.uoctti((4, 3), orientations=3)
SIZE = (47, 50)  # of no whole cells
NAMES = ("camera", "coins", "clock")
GRID = (12, 17)


def _images() -> dict[str, Tensor]:
    height, width = SIZE
    return {name: photograph(64, name)[0, 0, :height, :width].contiguous() for name in NAMES}


@cache
def _database(neighbours: int = NEIGHBOURS) -> NearestWindows:
    return dataclasses.replace(learn_nearest(_images(), SPEC), neighbours=neighbours)


def _descriptor(*names: str) -> Tensor:
    return hog(torch.cat([photograph(64, name)[..., : SIZE[0], : SIZE[1]] for name in names]), SPEC)


# --- the database


def test_images_are_stored_in_256_levels() -> None:
    images = {"b": torch.rand(20, 20), "a": torch.full((9, 31), 0.3)}
    database = learn_nearest(images, SPEC, windows=7, seed=5)
    assert database.learning.images == ("a", "b")
    assert (database.learning.windows, database.learning.seed) == (7, 5)
    for stored, name in zip(database.images, "ab", strict=True):
        np.testing.assert_array_equal(stored, np.rint(images[name].numpy() * 255).astype(np.uint8))


def test_nothing_but_images_and_numbers_decides() -> None:
    descriptor, images = _descriptor("coffee"), _images()

    def result(seed: int) -> Tensor:
        torch.rand(1)  # the global generator does not
        database = learn_nearest(dict(reversed(images.items())), SPEC, windows=100, seed=seed)
        return database.reconstruct(descriptor, SPEC, SIZE).image

    assert torch.equal(result(0), result(0))
    assert not torch.equal(result(0), result(1))
    changed = learn_nearest({**images, "clock": images["coins"]}, SPEC)
    assert changed.learning.sha256 != _database().learning.sha256


def test_progress() -> None:
    seen: list[tuple[int, int, str]] = []
    learn_nearest(_images(), SPEC, progress=lambda *at: seen.append(at))
    assert seen == [(0, 3, "storing the images"), (3, 3, "")]


def test_what_cannot_be_learned_from() -> None:
    camera = photograph(64)[0, 0]
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"images": {}}, "expected images to learn from, got none"),
        ({"images": {"a": camera[:1]}}, "a: the image must hold at least one cell of 4x3 pixels"),
        ({"images": {"a": camera * torch.nan}}, "a: expected an image"),
        ({"images": {"a": camera.double()}}, "a: expected an image"),
        ({"windows": 0}, "windows must be at least 1, got 0"),
    ]
    for changed, message in wrong:
        with pytest.raises(ValueError, match=message):
            learn_nearest(**{"images": {"a": camera}, "spec": SPEC, **changed})


def test_seeds_below_0() -> None:
    with pytest.raises(ValueError, match="seed must be at least 0, got -1"):
        learn_nearest(_images(), SPEC, seed=-1)


# --- inversion


@pytest.mark.parametrize("name", NAMES)
def test_an_image_of_the_database_is_found_back(name: str) -> None:
    """Its own windows are the nearest."""
    image = photograph(64, name)[..., : SIZE[0], : SIZE[1]]
    result = _database(1).reconstruct(_descriptor(name), SPEC, SIZE)
    torch.testing.assert_close(result.image, stretched((image * 255).round() / 255), atol=1e-5, rtol=0)


def _reference(descriptor: Tensor, neighbours: int) -> Tensor:
    """All distances to all windows, in double precision."""
    images = [image for _, image in sorted(_images().items())]
    pairs = list(Pairs(images, SPEC, CELLS, 10**6, np.random.default_rng(0)))
    known, patches = (torch.cat(parts).double() for parts in zip(*pairs, strict=True))
    windows = windows_at_cells(descriptor.double(), CELLS).flatten(0, 2)
    order = torch.stack([(known - window).norm(dim=1) for window in windows]).argsort(dim=1)
    expected = patches[order[:, :neighbours]].mean(1)
    return stretched(crop(average_patches(expected.view(1, *GRID, -1), SPEC, CELLS), SPEC, CELLS // 2, SIZE))


@pytest.mark.parametrize("neighbours", [1, 5, NEIGHBOURS])
def test_neighbours_are_those_of_a_plain_search(neighbours: int) -> None:
    descriptor = _descriptor("coffee")
    result = _database(neighbours).reconstruct(descriptor, SPEC, SIZE).image
    torch.testing.assert_close(result.double(), _reference(descriptor, neighbours), atol=1e-5, rtol=0)


def test_neighbours_by_default() -> None:
    assert learn_nearest(_images(), SPEC).neighbours == NEIGHBOURS


def test_more_neighbours_than_windows() -> None:
    """The mean of all patches is everywhere."""
    descriptor = _descriptor("coffee")
    few = learn_nearest(_images(), SPEC, windows=9)
    result = dataclasses.replace(few, neighbours=100).reconstruct(descriptor, SPEC, SIZE).image
    nine = dataclasses.replace(few, neighbours=9)
    assert torch.equal(result, nine.reconstruct(descriptor, SPEC, SIZE).image)
    assert torch.equal(result, nine.reconstruct(descriptor * 0, SPEC, SIZE).image)
    assert (float(result.min()), float(result.max())) == (0, 1)


def test_few_windows_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    descriptor = _descriptor("coffee")
    expected = _database().reconstruct(descriptor, SPEC, SIZE).image
    monkeypatch.setattr("nablahog.paper.baselines.nearest.BATCH", 50)
    torch.testing.assert_close(_database().reconstruct(descriptor, SPEC, SIZE).image, expected, atol=1e-5, rtol=0)


def test_nothing_to_invert() -> None:
    result = _database().reconstruct(torch.zeros(1, 6, 8, SPEC.channels), SPEC)
    assert (float(result.image.min()), float(result.image.max())) == (0, 1)
    assert result.distance.isfinite().all()


@pytest.mark.parametrize("gray", [0.5, 0.3])
def test_images_without_contrast(gray: float) -> None:
    database = learn_nearest({"flat": torch.full((30, 30), gray)}, SPEC)
    result = database.reconstruct(torch.zeros(1, 6, 8, SPEC.channels), SPEC)
    assert torch.equal(result.image, torch.full((1, 1, 24, 24), 0.5))
    assert result.distance.isfinite().all()


# --- files


def _account(**changed: Any) -> Any:
    learning = {"images": ["a", "b"], "sha256": "00", "windows": 9, "seed": 3, **changed}
    return {"learning": np.array(repr(learning).replace("'", '"'))}


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "fewer pixels": ({"pixels": np.zeros(99, np.uint8)}, "the sizes of the images must make 99 pixels"),
    "pixels in rows": ({"pixels": np.zeros((10, 14), np.uint8)}, "the sizes of the images must make 140 pixels"),
    "fractions of gray levels": ({"pixels": np.zeros(140)}, "expected pixels of uint8 .*, got float64 and int64"),
    "fractions of pixels": (
        {"sizes": np.array([[8.0, 10], [6, 10]])},
        r"sizes \(N, 2\), got uint8 and float64",
    ),
    "one size": ({"sizes": np.array([14, 10])}, r"int64 of shape \(2,\)"),
    "three sides": ({"sizes": np.ones((2, 3), int)}, r"int64 of shape \(2, 3\)"),
    "no pixels": ({"sizes": np.array([[14, 10], [0, 5]])}, "the sizes of the images must make 140 pixels"),
    "negative sizes": ({"sizes": np.array([[-14, -10], [0, 0]])}, "the sizes of the images must make 140 pixels"),
    "huge sizes": ({"sizes": np.array([[2**62, 4], [2**62, 4]])}, "the sizes of the images must make 140 pixels"),
    "no images": (
        {"sizes": np.zeros((0, 2), int), "pixels": np.zeros(0, np.uint8)},
        "the sizes of the images must make 0 pixels",
    ),
    "too small an image": ({"sizes": np.array([[13, 10], [1, 10]])}, "the image must hold at least one cell of 4x3"),
    "one image": ({"sizes": np.array([[14, 10]])}, "one for each of 2 names, got 1"),
    "one name": (_account(images=["a"]), "one for each of 1 names, got 2"),
    "no windows": (_account(windows=0), "windows must be at least 1, got 0"),
    "no seed": (_account(seed=[]), "its account of the learning cannot be read"),
}


@pytest.mark.parametrize("what", WRONG)
def test_wrong_contents(tmp_path: Path, what: str) -> None:
    check_refused(tiny_models.nearest(), tmp_path / "n.npz", *WRONG[what])


def test_no_neighbours() -> None:
    with pytest.raises(ValueError, match="neighbours must be at least 1, got 0"):
        dataclasses.replace(tiny_models.nearest(), neighbours=0)


@pytest.mark.parametrize("image", [torch.zeros(9, 9), torch.zeros(1, 9, 9, dtype=torch.uint8)])
def test_images_are_bytes(image: Tensor) -> None:
    with pytest.raises(ValueError, match=r"expected images \(H, W\) of uint8, got"):
        NearestWindows(SPEC, (image, image), tiny_models.nearest().learning)
