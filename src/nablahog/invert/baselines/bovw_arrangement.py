"""What an arrangement of visual words costs, by a database of arrangements, and the search for a cheap one.

A word costs -log(r + s) at a place, and so does a pair of neighbours: r says how many times more often than elsewhere
the word is expected there, or the pair is seen, and s keeps what the database happens not to hold from being forbidden.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.ndimage import gaussian_filter
from scipy.optimize import linear_sum_assignment

from ...runtime.compile import compiled

Words = NDArray[np.int64]
Array = NDArray[np.float64]

# Half of any of these, or twice as much, changes the correlation with the photograph by less than 0.02.
SAME = 0.2  # squared distance of two words at which one counts 1/e as much as the other for itself
BLUR = 2.0  # places: the σ by which an expected place is uncertain
RIDGE = 2.0
UNEXPECTED = 1.0  # s of places
UNSEEN = 0.5  # s of pairs

MAX_SWEEPS = 100  # some ten are enough
TOLERANCE = 1e-9  # by which a swap must lower the cost


class Costs:
    """The costs that a database of arrangements teaches.

    Args:
        database: (N, rows, cols), the words of N images; every word is somewhere.
        vocabulary: (K, n), the words themselves.

    Attributes:
        right: (K, K), the cost of word j to the right of word i.
        below: (K, K), the cost of word j below word i.
    """

    def __init__(self, database: Words, vocabulary: Array) -> None:
        count, self._rows, self._cols = database.shape
        words = len(vocabulary)
        self._places = database.reshape(count, -1) * (self._rows * self._cols) + np.arange(self._rows * self._cols)
        histograms = np.stack([np.bincount(each.ravel(), minlength=words) for each in database]).astype(np.float64)
        self._frequency = histograms.sum(0) / histograms.sum()
        self._rarity = np.log((count + 1) / ((histograms > 0).sum(0) + 1))
        self._features = self._described(histograms)
        kernel = (self._features @ self._features.T) ** 2
        self._factor = cho_factor(kernel + RIDGE * np.eye(count), lower=True)
        squared = np.square(vocabulary).sum(1)
        alike = np.exp((2 * vocabulary @ vocabulary.T - squared[:, None] - squared) / SAME)
        self._alike: Array = alike / alike.sum(1, keepdims=True)
        self.right = self._of_pairs(database[:, :, :-1], database[:, :, 1:])
        self.below = self._of_pairs(database[:, :-1], database[:, 1:])

    def location(self, histogram: Array) -> Array:
        """The cost of each word at each place, (K, rows, cols), in an image with the given histogram (K,).

        How often a word is at a place is predicted from the histogram: by ridge regression on the database, whose
        kernel is the square of the cosine between two histograms, of their roots, each weighed by the word's rarity.
        An image of the database counts where it has a word that is alike, too, and beside its place.
        """
        given = ((self._features @ self._described(histogram)) ** 2)[:, None]
        weights: Array = cho_solve(self._factor, given)[:, 0]
        weights += (1 - weights.sum()) / len(weights)  # the regression is of what differs from the mean
        size = len(self._frequency), self._rows, self._cols
        counts = np.bincount(
            self._places.ravel(), np.repeat(weights, self._rows * self._cols), size[0] * size[1] * size[2]
        )
        expected = (self._alike.T @ counts.reshape(size[0], -1)).reshape(size)
        expected = gaussian_filter(expected, (0, BLUR, BLUR), mode="nearest")
        ratio = expected.clip(min=0) / (self._alike.T @ self._frequency)[:, None, None]
        cost: Array = -np.log(ratio + UNEXPECTED)
        return cost

    def _described(self, histograms: Array) -> Array:
        """Histograms (…, K) as vectors of length 1, or 0 if they have only words that all images have."""
        weighed = np.sqrt(histograms) * self._rarity
        length = np.linalg.norm(weighed, axis=-1, keepdims=True)
        features: Array = weighed / np.where(length > 0, length, 1)
        return features

    def _of_pairs(self, first: Words, second: Words) -> Array:
        """-log(r + s) of pairs of words (K, K), from all pairs of the database."""
        words = len(self._frequency)
        pairs = np.bincount((first * words + second).ravel(), minlength=words * words).reshape(words, words)
        by_chance = np.outer(self._frequency, self._frequency) * max(1, first.size)
        cost: Array = -np.log(pairs / by_chance + UNSEEN)
        return cost


def arrange(words: Words, location: Array, costs: Costs, rng: np.random.Generator) -> tuple[Words, list[float], bool]:
    """A cheap arrangement of given words.

    First the cheapest by location alone, which the Hungarian method finds; then swaps of any two words, each of which
    lowers the whole cost, in an order drawn at random, until none does.

    Args:
        words: (rows · cols,), those to place.
        location: (K, rows, cols), what they cost there.
        costs: of neighbours.
        rng: decides the order.

    Returns:
        The words (rows, cols); the cost before and after each sweep over all pairs; whether no swap lowers it any more.
    """
    rows, cols = location.shape[1:]
    used, index = np.unique(words, return_inverse=True)
    count = len(used)
    places = location.reshape(len(location), -1)
    order, assigned = linear_sum_assignment(places[words])
    placed = np.full((rows + 2, cols + 2), count, np.int64)  # around them a word that costs nothing
    inner = np.empty(rows * cols, np.int64)
    inner[assigned] = index[order]
    placed[1:-1, 1:-1] = inner.reshape(rows, cols)
    at = np.zeros((rows + 2, cols + 2, count + 1))
    at[1:-1, 1:-1, :count] = places[used].T.reshape(rows, cols, count)
    right, below = (np.pad(each[np.ix_(used, used)], (0, 1)) for each in (costs.right, costs.below))
    cells = np.arange(placed.size).reshape(placed.shape)[1:-1, 1:-1].ravel()
    rng.shuffle(cells)
    flat, at_flat = placed.ravel(), at.reshape(-1, count + 1)
    history = [_total(placed, at, right, below)]
    settled = False
    while not settled and len(history) <= MAX_SWEEPS:
        change = _sweep(flat, cells, cols + 2, at_flat, right, below, TOLERANCE)
        history.append(history[-1] + change)
        settled = change == 0
    return used[placed[1:-1, 1:-1]], history, settled


def _total(placed: Words, at: Array, right: Array, below: Array) -> float:
    of_words = np.take_along_axis(at, placed[..., None], 2).sum()
    of_pairs = right[placed[:, :-1], placed[:, 1:]].sum() + below[placed[:-1], placed[1:]].sum()
    return float(of_words + of_pairs)


@compiled
def _around(placed: Any, p: Any, stride: int, at: Any, right: Any, below: Any) -> Any:
    """What the word at ``p`` costs there, with all its neighbours."""
    word = placed[p]
    beside = right[placed[p - 1], word] + right[word, placed[p + 1]]
    return at[p, word] + beside + below[placed[p - stride], word] + below[word, placed[p + stride]]


@compiled
def _between(placed: Any, p: Any, q: Any, stride: int, right: Any, below: Any) -> Any:
    """What the words at ``p`` and ``q``, p < q, cost as neighbours; 0 if they are none."""
    if q - p == 1:
        return right[placed[p], placed[q]]
    return below[placed[p], placed[q]] if q - p == stride else 0.0


@compiled
def _sweep(placed: Any, cells: Any, stride: int, at: Any, right: Any, below: Any, tolerance: float) -> float:
    """Swaps, of all pairs of cells, those that lower the cost.  Returns its change, 0 if there are none.

    Args:
        placed: (n,), the words of a grid with a border, row by row, changed in place.
        cells: the inner places, in the order to try them.
        stride: places of a row.
        at, right, below: costs of words at places, (n, words), and of pairs, (words, words).
        tolerance: by which a swap must lower the cost.
    """
    total = 0.0
    for i in range(cells.size):
        for j in range(i + 1, cells.size):
            p, q = min(cells[i], cells[j]), max(cells[i], cells[j])
            first, second = placed[p], placed[q]
            if first == second:
                continue
            # an edge between the two is in both sums
            change = _between(placed, p, q, stride, right, below)
            change -= _around(placed, p, stride, at, right, below) + _around(placed, q, stride, at, right, below)
            placed[p], placed[q] = second, first
            change += _around(placed, p, stride, at, right, below) + _around(placed, q, stride, at, right, below)
            change -= _between(placed, p, q, stride, right, below)
            if change < -tolerance:
                total += change
            else:
                placed[p], placed[q] = first, second
    return total
