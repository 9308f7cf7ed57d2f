"""Windows and patches are those of a plain loop, and patches make the image again that they were cut from."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

from nablahog import hog, presets
from nablahog.hog import HOGSpec
from nablahog.paper.baselines.windows import (
    Pairs,
    average_patches,
    check_images,
    crop,
    patch_size,
    stretched,
    windows_at_cells,
)

SPECS = {
    "rounded": presets.uoctti((3, 2), orientations=3),
    "floor": presets.paper((2, 3)),
    "ceil": dataclasses.replace(presets.paper(4), partial_cells="ceil"),
    "cells of one pixel": presets.paper(1),
}
SIZES = [(12, 12), (10, 7), (13, 17), (4, 5)]
ALL = 10**6

every_spec = pytest.mark.parametrize("spec", SPECS.values(), ids=SPECS.keys())
every_side = pytest.mark.parametrize("cells", [3, 5, 7])


def _images() -> list[Tensor]:
    return [torch.rand(*size) for size in SIZES]


def _rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def _window(descriptor: Tensor, cells: int, row: int, col: int) -> Tensor:
    """Zero beyond the descriptor (rows, cols, channels)."""
    rows, cols, channels = descriptor.shape
    window = torch.zeros(cells, cells, channels)
    for i in range(cells):
        for j in range(cells):
            y, x = row + i - cells // 2, col + j - cells // 2
            if 0 <= y < rows and 0 <= x < cols:
                window[i, j] = descriptor[y, x]
    return window.flatten()


def _patch(image: NDArray[Any], spec: HOGSpec, cells: int, row: int, col: int) -> Tensor:
    """Beyond the image, the nearest of its pixels."""
    height, width = spec.cell_size
    patch = np.zeros((cells * height, cells * width), np.float32)
    for i in range(cells * height):
        for j in range(cells * width):
            y, x = (row - cells // 2) * height + i, (col - cells // 2) * width + j
            patch[i, j] = image[min(max(y, 0), image.shape[0] - 1), min(max(x, 0), image.shape[1] - 1)]
    return torch.from_numpy(patch.ravel())


def _places(image: Tensor, spec: HOGSpec) -> list[tuple[int, int]]:
    rows, cols = spec.grid(*image.shape)
    return [(row, col) for row in range(rows) for col in range(cols)]


def _cut(image: Tensor, spec: HOGSpec, cells: int) -> Tensor:
    """All patches of an image (rows, cols, pixels)."""
    patches = [_patch(image.numpy(), spec, cells, *place) for place in _places(image, spec)]
    return torch.stack(patches).view(*spec.grid(*image.shape), -1)


# --- cutting


@every_spec
@every_side
def test_windows_at_cells(spec: HOGSpec, cells: int) -> None:
    descriptors = torch.rand(2, 4, 3, spec.channels)
    result = windows_at_cells(descriptors, cells)
    assert result.shape == (2, 4, 3, cells * cells * spec.channels)
    for k in range(2):
        for row in range(4):
            for col in range(3):
                assert torch.equal(result[k, row, col], _window(descriptors[k], cells, row, col))


@every_spec
@every_side
def test_pairs(spec: HOGSpec, cells: int) -> None:
    images = _images()
    pairs = Pairs(images, spec, cells, ALL, _rng())
    result = list(pairs)
    assert len(pairs) == sum(len(windows) for windows, _ in result)
    for image, (windows, patches) in zip(images, result, strict=True):
        descriptor = hog(image[None, None], spec)[0]
        expected = [_window(descriptor, cells, *place) for place in _places(image, spec)]
        assert torch.equal(windows, torch.stack(expected))
        assert torch.equal(patches, _cut(image, spec, cells).flatten(0, 1))
        assert windows.dtype == patches.dtype == torch.float32


def test_patch_size() -> None:
    assert patch_size(SPECS["rounded"], 5) == (15, 10)


def _chosen(most: int, seed: int = 0) -> tuple[Tensor, Tensor]:
    torch.manual_seed(0)
    pairs = list(Pairs(_images(), SPECS["rounded"], 3, most, _rng(seed)))
    windows, patches = (torch.cat(parts) for parts in zip(*pairs, strict=True))
    return windows, patches


def test_some_of_the_windows() -> None:
    whole, few = _chosen(ALL), _chosen(9)
    assert len(few[0]) == len(few[1]) == 9
    torch.manual_seed(0)
    pairs = Pairs(_images(), SPECS["rounded"], 3, 9, _rng())
    assert len(pairs) == 9
    assert len(set(pairs.chosen.tolist())) == 9
    for some, every in zip(few, whole, strict=True):
        assert torch.equal(some, every[torch.from_numpy(pairs.chosen)])


def test_images_of_which_none_is_chosen() -> None:
    spec = SPECS["rounded"]
    result = list(Pairs(_images(), spec, 3, 1, _rng()))
    assert [len(windows) for windows, _ in result].count(0) == len(SIZES) - 1
    for windows, patches in result:
        assert (windows.shape[1], patches.shape[1]) == (9 * spec.channels, 9 * 6)


def test_the_seed_decides() -> None:
    assert torch.equal(_chosen(9)[0], _chosen(9)[0])
    assert not torch.equal(_chosen(9)[0], _chosen(9, seed=1)[0])
    assert torch.equal(_chosen(ALL)[0], _chosen(ALL, seed=1)[0])


# --- putting together


def _assembled(patches: Tensor, spec: HOGSpec, cells: int, size: tuple[int, int]) -> Tensor:
    return crop(average_patches(patches, spec, cells), spec, cells // 2, size)


@every_spec
@every_side
@pytest.mark.parametrize("size", SIZES)
def test_patches_of_an_image_make_it_again(spec: HOGSpec, cells: int, size: tuple[int, int]) -> None:
    images = torch.rand(2, *size)
    patches = torch.stack([_cut(image, spec, cells) for image in images])
    result = _assembled(patches, spec, cells, size)
    torch.testing.assert_close(result, images[:, None], rtol=0, atol=1e-6)


@pytest.mark.parametrize("name", ["rounded", "ceil"])
def test_patches_are_averaged(name: str) -> None:
    """A loop over patches, which adds each at its place."""
    spec, cells, size = SPECS[name], 3, (10, 7)
    (height, width), (rows, cols) = spec.cell_size, spec.grid(*size)
    patches = torch.rand(1, rows, cols, 9 * height * width, dtype=torch.float64)
    total, count = (np.zeros(((rows + 2) * height, (cols + 2) * width)) for _ in range(2))
    for row in range(rows):
        for col in range(cols):
            place = np.s_[row * height : (row + 3) * height, col * width : (col + 3) * width]
            total[place] += patches[0, row, col].view(3 * height, 3 * width).numpy()
            count[place] += 1
    expected = (total / count)[height : height + size[0], width : width + size[1]]
    np.testing.assert_allclose(_assembled(patches, spec, cells, size)[0, 0], expected, rtol=1e-12)


def test_stretched() -> None:
    images = torch.tensor([[0.25, 0.5, 0.75], [-3, 1, 5], [0.3, 0.3, 0.3], [0, 0, 0]])[:, None, None]
    for each in (images, images.double()):
        result = stretched(each)
        assert result.dtype == each.dtype
        assert result[:, 0, 0].tolist() == [[0, 0.5, 1], [0, 0.5, 1], [0.5] * 3, [0.5] * 3]


@pytest.mark.parametrize("gray", [0.3, 0.9])
def test_rounding_is_no_contrast(gray: float) -> None:
    spec = SPECS["rounded"]
    patches = torch.full((1, 5, 6, 25 * 6), gray)
    result = stretched(_assembled(patches, spec, 5, (15, 12)))
    assert torch.equal(result, torch.full((1, 1, 15, 12), 0.5))


# --- what to learn from


def test_names_are_sorted() -> None:
    images = {name: torch.rand(6, 6) for name in "bca"}
    assert check_images(images, SPECS["rounded"]) == ["a", "b", "c"]


WRONG = {
    "of doubles": torch.zeros(6, 6, dtype=torch.float64),
    "of bytes": torch.zeros(6, 6, dtype=torch.uint8),
    "a stack": torch.zeros(1, 6, 6),
    "too bright": torch.full((6, 6), 1.1),
    "negative": torch.full((6, 6), -0.1),
    "NaN": torch.full((6, 6), torch.nan),
}


@pytest.mark.parametrize("what", WRONG)
def test_bad_images(what: str) -> None:
    with pytest.raises(ValueError, match=r"^x: expected an image \(H, W\) of float32 in 0…1$"):
        check_images({"a": torch.rand(6, 6), "x": WRONG[what]}, SPECS["rounded"])


def test_too_few_and_too_small_images() -> None:
    spec = SPECS["floor"]
    with pytest.raises(ValueError, match=r"^expected images to learn from, got none$"):
        check_images({}, spec)
    for size in ((0, 6), (1, 60), (6, 2)):
        with pytest.raises(ValueError, match=rf"^x: .* one cell of 2x3 pixels .*got an image of {size[0]}x{size[1]}"):
            check_images({"x": torch.zeros(size)}, spec)


BLOCKS = [presets.dpm(), presets.dlib(), presets.seeing3d(), presets.skimage(), presets.opencv()]


@pytest.mark.parametrize("spec", BLOCKS, ids=lambda spec: spec.name)
def test_descriptors_whose_rows_are_not_those_of_the_cells(spec: HOGSpec) -> None:
    with pytest.raises(ValueError, match=f"for itself only: {spec.name} has blocks, or leaves the outermost"):
        check_images({"image": torch.zeros(64, 128)}, spec)
