"""HOG once more, from the formulas, for tests: NumPy, float64, loops over pixels, slow and independent of the package.

Nothing is shared with the package but the spec: votes are dense over all bins instead of three candidates, space is a
loop over the four neighbouring cells of each pixel instead of two matrices, blocks are a loop over cells.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from nablahog.hog import FourBlockNorm, GlobalNorm, HOGSpec

Array = NDArray[np.float64]


def neighbour(n: int, i: int, border: str) -> int | None:
    """Index of the pixel that stands at position ``i`` of ``n``; None for a black one."""
    if 0 <= i < n:
        return i
    if border == "zero":
        return None
    if border == "replicate":
        return min(max(i, 0), n - 1)
    return min(abs(i) if i < 0 else 2 * (n - 1) - i, n - 1) if n > 1 else 0  # mirror about the outermost pixel


def pixel_gradient(plane: Array, y: int, x: int, border: str) -> tuple[float, float]:
    """Eq. 2: [-1, 0, 1] in x and in y."""
    height, width = plane.shape

    def at(row: int, col: int) -> float:
        r, c = neighbour(height, row, border), neighbour(width, col, border)
        return 0.0 if r is None or c is None else float(plane[r, c])

    return at(y, x + 1) - at(y, x - 1), at(y + 1, x) - at(y - 1, x)


def vote(gx: float, gy: float, spec: HOGSpec) -> Array:
    """Eq. 3-4: what one pixel gives to each bin."""
    magnitude = math.sqrt(gx * gx + gy * gy)
    if spec.vote == "linear":
        period = 360.0 if spec.signed else 180.0
        theta = math.degrees(math.atan2(gy, gx))
        votes = np.empty(spec.bins)
        for b in range(spec.bins):
            mu = (b + spec.bin_offset) * period / spec.bins
            apart = abs(theta - mu) % period
            apart = min(apart, period - apart)
            votes[b] = magnitude * np.clip(1 - apart * spec.bins / period, 0, 1)
        return votes
    votes = np.zeros(spec.bins)
    axes = spec.bins // 2 if spec.signed else spec.bins
    best, winner = 0.0, 0
    for b in range(axes):
        angle = (b + spec.bin_offset) * math.pi / axes
        dot = gx * float(np.float32(math.cos(angle))) + gy * float(np.float32(math.sin(angle)))
        if abs(dot) > best:
            best, winner = abs(dot), b + axes if spec.signed and dot < 0 else b
    votes[winner] = magnitude
    return votes


def cells(pixels: int, cell: int, rule: str) -> int:
    """How many cells an axis holds."""
    exact = pixels / cell
    if rule == "floor":
        return math.floor(exact)
    if rule == "ceil":
        return math.ceil(exact)
    return (pixels + cell // 2) // cell


def histograms(image: Array, spec: HOGSpec) -> Array:
    """Eq. 1-6: image (C, H, W) in 0…1 to cell histograms (rows, cols, bins)."""
    image = image * spec.value_range
    channels, height, width = image.shape
    if spec.colour == "gray":
        weights = {1: [1.0], 3: [0.299, 0.587, 0.114]}.get(channels, [1 / channels] * channels)
        image = np.stack([sum(w * plane for w, plane in zip(weights, image, strict=True))])
    rows = cells(height, spec.cell_size[0], spec.partial_cells)
    cols = cells(width, spec.cell_size[1], spec.partial_cells)
    result = np.zeros((rows, cols, spec.bins))
    for y in range(height):
        for x in range(width):
            if spec.border == "ignore" and (y in (0, height - 1) or x in (0, width - 1)):
                continue
            gx, gy = pixel_gradient(image[0], y, x, spec.border)
            for plane in image[1:]:
                other = pixel_gradient(plane, y, x, spec.border)
                if other[0] * other[0] + other[1] * other[1] > gx * gx + gy * gy:
                    gx, gy = other
            votes = vote(gx, gy, spec)
            v = (y + 0.5) / spec.cell_size[0] - 0.5
            u = (x + 0.5) / spec.cell_size[1] - 0.5
            for row in (math.floor(v), math.floor(v) + 1):
                for col in (math.floor(u), math.floor(u) + 1):
                    if 0 <= row < rows and 0 <= col < cols:
                        result[row, col] += (1 - abs(v - row)) * (1 - abs(u - col)) * votes
    return result


def global_norm(v: Array, scheme: GlobalNorm) -> Array:
    """Eq. 7, as printed or as meant."""
    norm = math.sqrt(float((v * v).sum()))
    if scheme.form == "printed":
        return v / math.sqrt(norm + scheme.epsilon)
    return v / math.sqrt(norm**2 + scheme.epsilon**2)


def four_block_norm(v: Array, scheme: FourBlockNorm) -> Array:
    """UoCTTI: directed, undirected and texture channels of each cell, as far as the scheme has them."""
    rows, cols, directions = v.shape
    n = directions // 2
    undirected = v[..., :n] + v[..., n:]
    energy = (undirected**2).sum(-1)
    result = np.zeros((rows, cols, 3 * n + 4))
    for row in range(rows):
        for col in range(cols):
            for block, (down, right) in enumerate([(-1, -1), (-1, 1), (1, -1), (1, 1)]):
                total = 0.0
                for r in (row, row + down):
                    for c in (col, col + right):
                        total += energy[min(max(r, 0), rows - 1), min(max(c, 0), cols - 1)]
                factor = 1 / math.sqrt(total + scheme.epsilon)
                h = np.minimum(v[row, col] * factor, scheme.clip)
                u = np.minimum(undirected[row, col] * factor, scheme.clip)
                result[row, col, :directions] += h / 2
                result[row, col, directions : 3 * n] += u / 2
                result[row, col, 3 * n + block] = u.sum() / math.sqrt(18)
    parts = {"directed": slice(2 * n), "undirected": slice(2 * n, 3 * n), "texture": slice(3 * n, None)}
    return np.concatenate([result[..., parts[part]] for part in scheme.parts], axis=-1)


def hog(image: Array, spec: HOGSpec) -> Array:
    """Image (C, H, W), float64 in 0…1, to its descriptor (rows, cols, channels)."""
    v = histograms(image, spec)
    if isinstance(spec.normalizer, GlobalNorm):
        return global_norm(v, spec.normalizer)
    return four_block_norm(v, spec.normalizer)
