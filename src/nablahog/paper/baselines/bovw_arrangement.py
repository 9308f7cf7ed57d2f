"""The cost of an arrangement of visual words, estimated from a database, and the search for a cheap arrangement.

A word at a place costs -log(r + s), and so does a pair of neighbours.  r is the frequency of the word at the place, or
of the pair, relative to chance.  s > 0 keeps the cost finite where the database has none.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.ndimage import gaussian_filter
from scipy.optimize import linear_sum_assignment

Words = NDArray[np.int64]
Array = NDArray[np.float64]

# Halving or doubling any of these changes the correlation with the photograph by less than 0.02.
SIMILARITY = 0.2  # squared distance of two words at which their similarity is 1/e
BLUR = 2.0  # σ of the Gaussian over places
RIDGE = 2.0  # λ of the kernel ridge regression
PLACE_SMOOTHING = 1.0  # s of places
PAIR_SMOOTHING = 0.5  # s of pairs

MAX_SWEEPS = 100  # some ten are enough
MIN_DECREASE = 1e-9  # least decrease of the cost by a swap


class Costs:
    """The costs estimated from the words (N, rows, cols) of N images, and the words (K, n) themselves.

    ``right`` and ``below``, (K, K), are the costs of word j to the right of word i, and below it.
    """

    def __init__(self, database: Words, vocabulary: Array) -> None:
        count, self._rows, self._cols = database.shape
        words = len(vocabulary)
        self._places = database.reshape(count, -1) * (self._rows * self._cols) + np.arange(self._rows * self._cols)
        histograms = np.stack([np.bincount(each.ravel(), minlength=words) for each in database]).astype(np.float64)
        self._frequency = histograms.sum(0) / histograms.sum()
        self._rarity = np.log((count + 1) / ((histograms > 0).sum(0) + 1))
        self._features = self._normalized(histograms)
        kernel = (self._features @ self._features.T) ** 2
        self._factor = cho_factor(kernel + RIDGE * np.eye(count), lower=True)
        squared = np.square(vocabulary).sum(1)
        similarity = np.exp((2 * vocabulary @ vocabulary.T - squared[:, None] - squared) / SIMILARITY)
        self._similarity: Array = similarity / similarity.sum(1, keepdims=True)
        self.right = self._pair_costs(database[:, :, :-1], database[:, :, 1:])
        self.below = self._pair_costs(database[:, :-1], database[:, 1:])

    def location(self, histogram: Array) -> Array:
        """The cost of each word at each place, (K, rows, cols), in an image with a histogram (K,).

        Kernel ridge regression on the database predicts from the histogram how often a word is at a place.  The kernel
        is the squared cosine of two histograms, after a square root and weights by the words' rarity.  Counts are
        smoothed over similar words and neighbouring places.
        """
        kernel = ((self._features @ self._normalized(histogram)) ** 2)[:, None]
        weights: Array = cho_solve(self._factor, kernel)[:, 0]
        weights += (1 - weights.sum()) / len(weights)  # the regression is of the difference from the mean
        size = len(self._frequency), self._rows, self._cols
        counts = np.bincount(
            self._places.ravel(), np.repeat(weights, self._rows * self._cols), size[0] * size[1] * size[2]
        )
        expected = (self._similarity.T @ counts.reshape(size[0], -1)).reshape(size)
        expected = gaussian_filter(expected, (0, BLUR, BLUR), mode="nearest")
        ratio = expected.clip(min=0) / (self._similarity.T @ self._frequency)[:, None, None]
        cost: Array = -np.log(ratio + PLACE_SMOOTHING)
        return cost

    def _normalized(self, histograms: Array) -> Array:
        """Weighted square roots of histograms (…, K), of length 1, or 0 if all images have all their words."""
        weighted = np.sqrt(histograms) * self._rarity
        length = np.linalg.norm(weighted, axis=-1, keepdims=True)
        features: Array = weighted / np.where(length > 0, length, 1)
        return features

    def _pair_costs(self, first: Words, second: Words) -> Array:
        """-log(r + s) of pairs of words (K, K), from all pairs of the database."""
        words = len(self._frequency)
        pairs = np.bincount((first * words + second).ravel(), minlength=words * words).reshape(words, words)
        by_chance = np.outer(self._frequency, self._frequency) * max(1, first.size)
        cost: Array = -np.log(pairs / by_chance + PAIR_SMOOTHING)
        return cost


def arrange(words: Words, location: Array, costs: Costs, rng: np.random.Generator) -> tuple[Words, list[float], bool]:
    """A cheap arrangement of words (rows · cols,), with costs (K, rows, cols) at each place, and those of neighbours.

    The Hungarian method gives the cheapest one by places alone.  Then any two words are swapped, in random order, if
    that lowers the total cost, until no swap does.

    Returns:
        The words (rows, cols); the cost before and after each sweep over all pairs; whether no swap lowers it.
    """
    rows, cols = location.shape[1:]
    used, index = np.unique(words, return_inverse=True)
    count = len(used)
    places = location.reshape(len(location), -1)
    order, assigned = linear_sum_assignment(places[words])
    placed = np.full((rows + 2, cols + 2), count, np.int64)  # with a border of a word that costs nothing
    inner = np.empty(rows * cols, np.int64)
    inner[assigned] = index[order]
    placed[1:-1, 1:-1] = inner.reshape(rows, cols)
    at = np.zeros((rows + 2, cols + 2, count + 1))
    at[1:-1, 1:-1, :count] = places[used].T.reshape(rows, cols, count)
    right, below = (np.pad(each[np.ix_(used, used)], (0, 1)) for each in (costs.right, costs.below))
    cells = np.arange(placed.size).reshape(placed.shape)[1:-1, 1:-1].ravel()
    rng.shuffle(cells)
    grid = _Grid(placed.ravel(), cols + 2, at.reshape(-1, count + 1), right, below)
    history = [_total(placed, at, right, below)]
    settled = False
    while not settled and len(history) <= MAX_SWEEPS:
        change = grid.sweep(cells)
        history.append(history[-1] + change)
        settled = change == 0
    return used[placed[1:-1, 1:-1]], history, settled


def _total(placed: Words, at: Array, right: Array, below: Array) -> float:
    word_costs = np.take_along_axis(at, placed[..., None], 2).sum()
    pair_costs = right[placed[:, :-1], placed[:, 1:]].sum() + below[placed[:-1], placed[1:]].sum()
    return float(word_costs + pair_costs)


class _Grid:
    """Words (n,) on a grid of rows of ``stride`` places, with a border of the last word, changed in place.

    Costs are of words at places, (n, words), and of pairs, (words, words).
    """

    def __init__(self, placed: Words, stride: int, at: Array, right: Array, below: Array) -> None:
        self._placed, self._stride, self._at, self._right, self._below = placed, stride, at, right, below
        # if two neighbours are swapped, the cost of each assumes the other's old word beside it; this corrects it
        self._corrections = {
            apart: pair + pair.T - np.diag(pair) - np.diag(pair)[:, np.newaxis]
            for apart, pair in ((1, right), (stride, below))
        }
        self._costs = np.zeros_like(at)
        self._update(np.arange(len(placed)))

    def sweep(self, cells: Words) -> float:
        """Swaps each pair of inner places, in their order, if that lowers the cost; returns the total change."""
        total = 0.0
        for i, p in enumerate(cells):
            others = cells[i + 1 :]
            while len(others):
                changes = self._changes(p, others)
                k = int(np.argmax(changes < -MIN_DECREASE))
                if not changes[k] < -MIN_DECREASE:
                    break
                total += float(changes[k])
                swapped = np.array([p, others[k]])
                self._placed[swapped] = self._placed[swapped[::-1]]
                self._update((swapped + np.array([-1, 1, -self._stride, self._stride])[:, np.newaxis]).ravel())
                others = others[k + 1 :]
        return total

    def _changes(self, p: np.int64, others: Words) -> Array:
        """Changes of the cost if the word at ``p`` is swapped with that at each of ``others``."""
        word, words = self._placed[p], self._placed[others]
        changes: Array = self._costs[p, words] - self._costs[p, word]
        changes += self._costs[others, word] - self._costs[others, words]
        for apart, correction in self._corrections.items():
            beside = np.abs(others - p) == apart
            changes[beside] += correction[word, words[beside]]
        return changes

    def _update(self, places: Words) -> None:
        """Recomputes the costs of all words at some places, except for those of the border."""
        p = places[self._placed[places] < len(self._right) - 1]
        beside = self._right[self._placed[p - 1]] + self._right.T[self._placed[p + 1]]
        above_and_under = self._below[self._placed[p - self._stride]] + self._below.T[self._placed[p + self._stride]]
        self._costs[p] = self._at[p] + beside + above_and_under
