"""Elements: the patches that stand out, apart from each other."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from nablahog.hog import hog, presets
from nablahog.pose.background import default_background
from nablahog.pose.photograph import EMPTY, Elements, all_patches, elements
from nablahog.pose.whitening import Background

SPEC = presets.aubry(8)


@pytest.fixture(scope="module")
def background() -> Background:
    return default_background(SPEC)


def drawing() -> Tensor:
    """A triangle, a bar and a grid on white, 128x160."""
    image = torch.ones(1, 1, 128, 160)
    image[..., 20:50, 30:34] = 0.2
    for y in range(60, 100):
        image[..., y, 80 : 80 + y // 2] = 0.6
    image[..., 90:120:6, 20:60] = 0.1
    return image


@pytest.fixture(scope="module")
def descriptor() -> Tensor:
    return hog(drawing(), SPEC)[0]


@pytest.fixture(scope="module")
def result(descriptor: Tensor, background: Background) -> Elements:
    return elements(descriptor, background, (4, 5), count=None, threshold=1.2)


@pytest.mark.slow
def test_they_are_patches_of_the_descriptor(result: Elements, descriptor: Tensor, background: Background) -> None:
    assert len(result) > 5
    assert repr(result).startswith(f"<Elements: {len(result)} of ")
    for position, patch in zip(result.positions.tolist(), result.patches, strict=True):
        row, col = position
        assert torch.equal(patch, descriptor[row : row + 4, col : col + 5])
    assert_close(result.discriminability, background.discriminability(result.patches))


def overlap(a: Tensor, b: Tensor, size: tuple[int, int]) -> float:
    """Shared cells in those of the box around both, counted."""
    cells = [
        {(y, x) for y in range(r, r + size[0]) for x in range(c, c + size[1])} for r, c in (a.tolist(), b.tolist())
    ]
    rows, cols = zip(*(cells[0] | cells[1]), strict=True)
    return len(cells[0] & cells[1]) / ((max(rows) - min(rows) + 1) * (max(cols) - min(cols) + 1))


@pytest.mark.parametrize("limit", [0.0, 0.25])
def test_greedy_by_discriminability_with_little_overlap(
    descriptor: Tensor, background: Background, limit: float
) -> None:
    """Every patch is either kept, or overlaps too much with a better one that is."""
    size = (4, 5)
    result = elements(descriptor, background, size, count=None, overlap=limit, threshold=1.2)
    assert (result.discriminability.diff() <= 0).all()
    patches = all_patches(descriptor, size)
    norms = background.discriminability(patches.flatten(0, 1)).view(patches.shape[:2])
    least = 1.2 * background.discriminability(torch.zeros(1, *size, 9))
    kept = {tuple(position): k for k, position in enumerate(result.positions.tolist())}
    assert len(kept) > 3
    for row in range(patches.shape[0]):
        for col in range(patches.shape[1]):
            here, norm = torch.tensor([row, col]), norms[row, col]
            better = [k for k in range(len(result)) if result.discriminability[k] >= norm]
            near = [k for k in better if overlap(here, result.positions[k], size) > limit]
            if (row, col) in kept:
                assert near == [kept[row, col]]
                assert norm > least
            else:
                assert near or norm <= least


def test_count_keeps_the_best(result: Elements, descriptor: Tensor, background: Background) -> None:
    few = elements(descriptor, background, (4, 5), count=3, threshold=1.2)
    assert torch.equal(few.positions, result.positions[:3])
    assert torch.equal(few.weights, result.weights[:3])


def test_overlap_of_one_excludes_nothing(descriptor: Tensor, background: Background) -> None:
    result = elements(descriptor, background, count=None, overlap=1.0, threshold=0.0)
    assert len(result) == (16 - 4) * (20 - 4)
    assert len(result.positions.unique(dim=0)) == len(result)


def test_weights(result: Elements, background: Background) -> None:
    empty = result.patches.sum(dim=3) <= EMPTY
    assert 0 < empty.float().mean() < 1
    assert not result.weights[empty].any()
    assert_close(result.weights[~empty], background.whiten(result.patches)[~empty])


@pytest.mark.parametrize("shape", [(16, 20, 9), (3, 20, 9), (20, 3, 9), (0, 5, 9)])
def test_nothing_there(background: Background, shape: tuple[int, ...]) -> None:
    for threshold in (0.0, 2.0) if shape[0] < 5 or shape[1] < 5 else (1.0, 2.0):
        none = elements(torch.zeros(shape), background, threshold=threshold)
        assert len(none) == 0
        assert none.positions.shape == (0, 2)
        assert none.weights.shape == none.patches.shape == (0, 5, 5, 9)
        assert none.discriminability.shape == (0,)


def test_double_precision(descriptor: Tensor, background: Background) -> None:
    single, double = elements(descriptor, background), elements(descriptor.double(), background)
    assert single.weights.dtype == torch.float32
    assert double.weights.dtype == torch.float64
    assert_close(single.weights, double.weights.float(), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"descriptor": torch.zeros(8, 9)}, r"must be a tensor \(rows, cols, 9\) .*got shape \(8, 9\)"),
        ({"descriptor": torch.zeros(8, 8, 9).int()}, "got torch.int32"),
        ({"count": 0}, "count must be an integer"),
        ({"overlap": -0.1}, "overlap must be .* in 0 … 1"),
        ({"threshold": float("nan")}, "threshold must be"),
        ({"size": (11, 5)}, r"must have 1…10 rows and columns of cells here, got 11x5"),
    ],
)
def test_refuses(descriptor: Tensor, background: Background, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        elements(**{"descriptor": descriptor, "background": background} | changes)
