"""Arrangements of words that no swap betters, and the costs that decide."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from nablahog.paper.baselines.bovw_arrangement import BLUR, PLACE_SMOOTHING, RIDGE, SIMILARITY, Costs, arrange


def test_costs_of_pairs() -> None:
    costs = Costs(np.array([[[0, 1]]]), np.eye(2))
    seen, unseen = -math.log(4 + 0.5), -math.log(0.5)  # once where a quarter is expected
    np.testing.assert_allclose(costs.right, [[unseen, seen], [unseen, unseen]])
    np.testing.assert_allclose(costs.below, np.full((2, 2), unseen))


def test_similarities_to_a_word_add_up_to_one() -> None:
    costs = Costs(np.array([[[0, 1, 2]]]), np.array([[0.0, 0.0], [0.1, 0.0], [0.0, 0.3]]))
    np.testing.assert_allclose(costs._similarity.sum(axis=1), 1)


def test_costs_of_places() -> None:
    """Two kinds of images, of words 0 and 1 above or of words 2 and 3 below; each also with the words 4 and 5."""
    one, other = [[0, 1, 4], [4, 5, 5]], [[4, 5, 5], [2, 3, 4]]
    costs = Costs(np.array([one, other] * 20), np.eye(6))
    for of, absent in ((one, other), (other, one)):
        histogram = np.bincount(np.ravel(of), minlength=6).astype(np.float64)
        result = costs.location(histogram)
        assert result.shape == (6, 2, 3)
        rows, cols = np.indices((2, 3))
        own, others = (result[np.array(words), rows, cols].mean() for words in (of, absent))
        assert own < others - 0.1


def test_costs_of_places_are_those_of_ridge_regression_without_a_kernel() -> None:
    """On the products of all pairs of features, whose inner product is the squared cosine, about the mean."""
    rng = np.random.default_rng(0)
    database, vocabulary = rng.integers(12, size=(8, 3, 4)), 0.3 * rng.random((12, 3))
    counts = np.array([np.bincount(each.ravel(), minlength=12) for each in database])
    roots = np.sqrt(counts) * np.log((8 + 1) / ((counts > 0).sum(0) + 1))
    features = roots / np.linalg.norm(roots, axis=1, keepdims=True)
    products = np.einsum("ni,nj->nij", features, features).reshape(8, -1)
    present = (database[:, None] == np.arange(12)[:, None, None]).reshape(8, -1).astype(float)
    deviations = products.T @ (present - present.mean(0))
    regression = np.linalg.solve(products.T @ products + RIDGE * np.eye(144), deviations)
    similar = np.exp(-np.square(vocabulary[:, None] - vocabulary).sum(2) / SIMILARITY)
    similar /= similar.sum(1, keepdims=True)
    for histogram, pairs in zip(counts, products, strict=True):
        places = similar.T @ (present.mean(0) + pairs @ regression).reshape(12, -1)
        smooth = gaussian_filter(places.reshape(12, 3, 4), (0, BLUR, BLUR), mode="nearest").clip(min=0)
        by_chance = similar.T @ (counts.sum(0) / counts.sum())
        expected = -np.log(smooth / by_chance[:, None, None] + PLACE_SMOOTHING)
        np.testing.assert_allclose(Costs(database, vocabulary).location(histogram.astype(float)), expected)


def _problem(seed: int, rows: int = 5, cols: int = 4) -> tuple[Any, Any, Costs]:
    rng = np.random.default_rng(seed)
    database = rng.integers(7, size=(6, rows, cols))
    database.flat[:7] = np.arange(7)
    costs = Costs(database, rng.random((7, 3)))
    costs.right, costs.below = rng.normal(size=(2, 7, 7))
    return rng.integers(7, size=rows * cols), rng.normal(size=(7, rows, cols)), costs


def _cost(placed: Any, location: Any, costs: Costs) -> float:
    rows, cols = placed.shape
    total = 0.0
    for y, x in itertools.product(range(rows), range(cols)):
        total += location[placed[y, x], y, x]
        total += costs.right[placed[y, x], placed[y, x + 1]] if x + 1 < cols else 0
        total += costs.below[placed[y, x], placed[y + 1, x]] if y + 1 < rows else 0
    return total


@pytest.mark.parametrize("seed", range(2))
def test_no_swap_betters_what_is_found(seed: int) -> None:
    words, location, costs = _problem(seed)
    result, history, settled = arrange(words, location, costs, np.random.default_rng(seed))
    assert settled
    assert np.array_equal(np.sort(result, axis=None), np.sort(words))
    assert history[-1] == pytest.approx(_cost(result, location, costs))
    assert all(after <= before for before, after in itertools.pairwise(history))
    assert history[-1] < history[0]
    for p, q in itertools.combinations(range(result.size), 2):
        swapped = result.copy()
        swapped.flat[p], swapped.flat[q] = result.flat[q], result.flat[p]
        assert _cost(swapped, location, costs) > history[-1] - 1e-6


def test_places_alone_are_solved_exactly() -> None:
    words, location, costs = _problem(1, 2, 3)
    costs.right[:] = costs.below[:] = 0
    _, history, _ = arrange(words, location, costs, np.random.default_rng(0))
    every = (_cost(np.reshape(each, (2, 3)), location, costs) for each in itertools.permutations(words))
    assert history[-1] == pytest.approx(min(every))


@pytest.mark.parametrize("shape", [(1, 2), (2, 1)])
def test_neighbours_decide_where_places_do_not(shape: tuple[int, int]) -> None:
    costs = Costs(np.array([[[0], [1]]]).reshape(1, *shape), np.eye(2))
    for words in ([0, 1], [1, 0]):
        result, _, _ = arrange(np.array(words), np.zeros((2, *shape)), costs, np.random.default_rng(0))
        assert result.ravel().tolist() == [0, 1]
