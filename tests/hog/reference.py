"""HOG once more, from the formulas, for tests: NumPy, float64, loops over pixels, slow and independent of the package.

Nothing is shared with the package but the spec: votes are dense over all bins instead of three candidates, space is a
loop over pixels and the cells that each votes into instead of two matrices, blocks are a loop over cells.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from nablahog.hog import (
    BilinearCells,
    BlockCells,
    BlockNorm,
    BoxCells,
    CellNorm,
    FourBlockNorm,
    GlobalNorm,
    HOGSpec,
)

Array = NDArray[np.float64]
Voters = list[tuple[int, list[tuple[int, float]]]]  # along one axis: a pixel, the cells it votes into, and how much
F32 = np.float32


# --- Eq. 1-2 ---------------------------------------------------------------------------------------------------------


def neighbour(plane: Array, y: int, x: int, spec: HOGSpec) -> float:
    """The value at a position that may be one pixel outside."""
    at = [y, x]
    for axis, n in enumerate(plane.shape):
        i = at[axis]
        if 0 <= i < n:
            continue
        if n == 1 or spec.border == "replicate":
            at[axis] = min(max(i, 0), n - 1)
        elif spec.border in ("zero", "gray"):
            return 0.0 if spec.border == "zero" else 128 / 255 * spec.value_range
        elif spec.border == "extrapolate":
            line = plane[:, at[1]] if axis == 0 else plane[at[0]]
            return float(2 * line[0] - line[1] if i < 0 else 2 * line[-1] - line[-2])
        else:
            at[axis] = -i if i < 0 else 2 * (n - 1) - i  # mirror about the outermost pixel
    return float(plane[at[0], at[1]])


def mirrored(i: int, n: int) -> int:
    return 0 if n == 1 else abs(i) if i < n else 2 * (n - 1) - i


def pixel_gradient(plane: Array, y: int, x: int, spec: HOGSpec) -> tuple[float, float]:
    """Eq. 2: [-1, 0, 1] in x and in y; of a Sobel mask over three rows or columns."""
    if spec.mask == "central":
        across = neighbour(plane, y, x + 1, spec) - neighbour(plane, y, x - 1, spec)
        return across, neighbour(plane, y + 1, x, spec) - neighbour(plane, y - 1, x, spec)
    gx = gy = 0.0
    for apart, weight in ((-1, 1), (0, 2), (1, 1)):
        row, col = mirrored(y + apart, plane.shape[0]), mirrored(x + apart, plane.shape[1])
        gx += weight * (neighbour(plane, row, x + 1, spec) - neighbour(plane, row, x - 1, spec))
        gy += weight * (neighbour(plane, y + 1, col, spec) - neighbour(plane, y - 1, col, spec))
    return gx, gy


def winner(magnitudes: list[float], x: int, width: int, cols: int, spec: HOGSpec) -> int:
    """Which channel of largest magnitude counts in column x."""
    largest = [c for c, m in enumerate(magnitudes) if m == max(magnitudes)]
    if spec.colour_ties == "opencv":
        return largest[-1 if x >= 4 * (width // 4) else 0]
    if spec.colour_ties == "dlib":
        last = min(cols * spec.cell_size[1], width) - 2  # columns 1 … last vote
        body = [c for first in range(1, last + 1, 8) for c in range(first, first + 8) if first + 7 <= last]
        return largest[-1 if x in body else 0]
    return largest[0]


# --- Eq. 3-4 ---------------------------------------------------------------------------------------------------------


def opencv_degrees(gx: float, gy: float) -> float:
    """OpenCV's arctangent, degrees in 0…360, in float32."""
    x, y = F32(gx), F32(gy)
    a, b = abs(x), abs(y)
    c = min(a, b) / (max(a, b) + F32(2.0**-52))
    terms = (0.9997878412794807, -0.3258083974640975, 0.1555786518463281, -0.04432655554792128)
    degrees = sum(F32(term * 180 / math.pi) * c ** (2 * k + 1) for k, term in enumerate(terms))
    degrees = float(90 - degrees if b > a else degrees)
    degrees = 180 - degrees if x < 0 else degrees
    return 360 - degrees if y < 0 else degrees


def vlfeat_votes(gx: float, gy: float, spec: HOGSpec) -> Array:
    """VLFeat's bilinear assignment of one gradient, by a float32 arccosine."""
    n = spec.bins // 2 if spec.signed else spec.bins
    x, y = F32(gx), F32(gy)
    length = max(F32(math.sqrt(float(x * x + y * y))), 1e-10)  # x**2 is float64 before NumPy 2
    dots = [x * F32(math.cos(k * math.pi / n)) + y * F32(math.sin(k * math.pi / n)) for k in range(n)]
    order = sorted(range(n), key=lambda k: (-abs(dots[k]), k))
    share = float(np.arccos(F32(min(abs(dots[order[0]]) / length, 1.0)))) / (math.pi / n)
    votes = np.zeros(spec.bins)
    for k, weight in zip(order[:2], (1 - share, share), strict=True):
        votes[k + n if spec.signed and dots[k] < 0 else k] += weight * length
    return votes


def linear_votes(gx: float, gy: float, spec: HOGSpec) -> Array:
    period = 360.0 if spec.signed else 180.0
    theta = opencv_degrees(gx, gy) if spec.angle == "opencv" else math.degrees(math.atan2(gy, gx))
    votes = np.empty(spec.bins)
    for b in range(spec.bins):
        mu = (b + spec.bin_offset) * period / spec.bins
        apart = abs(theta - (-mu if spec.counterclockwise else mu)) % period
        apart = min(apart, period - apart)
        votes[b] = math.hypot(gx, gy) * np.clip(1 - apart * spec.bins / period, 0, 1)
    return votes


def hard_bin(gx: float, gy: float, spec: HOGSpec) -> int:
    sense = -1 if spec.counterclockwise else 1
    if spec.boundary == "upper":
        turns = sense * math.atan2(gy, gx) / (2 * math.pi if spec.signed else math.pi)
        return math.floor(turns * spec.bins - spec.bin_offset + 0.5 + 1e-9) % spec.bins
    axes = spec.bins // 2 if spec.signed else spec.bins
    best, chosen = 0.0, 0
    for b in range(axes):
        angle = sense * (b + spec.bin_offset) * math.pi / axes
        cos, sin = math.cos(angle), math.sin(angle)
        if spec.directions == "four-decimals":
            cos, sin = round(cos, 4), round(sin, 4)
        dot = gx * float(F32(cos)) + gy * float(F32(sin))
        if abs(dot) > best:
            best, chosen = abs(dot), b + axes if spec.signed and dot < 0 else b
    return chosen


def vote(gx: float, gy: float, spec: HOGSpec) -> Array:
    """Eq. 3-4: what one pixel gives to each bin."""
    if spec.vote == "hard":
        votes = np.zeros(spec.bins)
        votes[hard_bin(gx, gy, spec)] = math.sqrt(gx * gx + gy * gy)
        return votes
    return vlfeat_votes(gx, gy, spec) if spec.angle == "vlfeat" else linear_votes(gx, gy, spec)


# --- Eq. 5-6 ---------------------------------------------------------------------------------------------------------


def cells(pixels: int, cell: int, rule: str) -> int:
    """How many cells an axis holds."""
    exact = pixels / cell
    if rule == "floor":
        return math.floor(exact)
    if rule == "ceil":
        return math.ceil(exact)
    return (pixels + cell // 2) // cell


def two_nearest(position: float, count: int) -> Iterator[tuple[int, float]]:
    for k in (math.floor(position), math.floor(position) + 1):
        if 0 <= k < count:
            yield k, 1 - abs(position - k)


def bilinear_voters(n: int, cell: int, count: int, scheme: BilinearCells, ring: int) -> Voters:
    visible = {"vote": n, "drop": min(count * cell, n), "repeat": count * cell}[scheme.beyond]
    output: Voters = []
    for i in range(ring, visible - ring):
        shares = []
        for k, weight in two_nearest((i + 0.5) / cell - 0.5, count):
            shares.append((k, weight * (scheme.edge_gain if k in (0, count - 1) else 1)))
        output.append((min(i, n - 1 - ring), shares))
    return output


def box_voters(n: int, cell: int, count: int, scheme: BoxCells, ring: int) -> Voters:
    tile = [1.0] * n
    if scheme.window:
        middle, sigma = (scheme.window - 1) / 2, scheme.window // 2
        bell = [math.exp(-(((k - middle) / sigma) ** 2) / 2) for k in range(scheme.window)]
        tile = [bell[i % scheme.window] / sum(bell) for i in range(n)]
    share = 1 / cell if scheme.mean else 1.0
    return [(i, [(i // cell, share * tile[i])] if i // cell < count else []) for i in range(ring, n - ring)]


def block_voters(n: int, cell: int, block: int, step: int, sigma: float, ring: int) -> Voters:
    output: Voters = []
    per_block = block // cell
    for number, start in enumerate(range(0, n - block + 1, step)):
        for k in range(block):
            bell = math.exp(-((k - block / 2) ** 2) / (2 * sigma**2))
            near = two_nearest((k + 0.5) / cell - 0.5, per_block)
            if ring <= start + k < n - ring:
                output.append((start + k, [(number * per_block + c, bell * weight) for c, weight in near]))
    return output


def voters(n: int, axis: int, spec: HOGSpec) -> tuple[int, Voters]:
    """How many cells there are along an axis of n pixels, and who votes into them."""
    cell, ring, scheme = spec.cell_size[axis], int(spec.border == "ignore"), spec.pooling
    if isinstance(scheme, BlockCells):
        block, step = scheme.block[axis], scheme.step[axis]
        count = len(range(0, n - block + 1, step)) * (block // cell)
        return count, block_voters(n, cell, block, step, scheme.sigma, ring)
    count = cells(n, cell, spec.partial_cells)
    if isinstance(scheme, BoxCells):
        return count, box_voters(n, cell, count, scheme, ring)
    return count, bilinear_voters(n, cell, count, scheme, ring)


def histograms(image: Array, spec: HOGSpec) -> Array:
    """Eq. 1-6: image (C, H, W) in 0…1 to cell histograms (rows, cols, colours · bins)."""
    image = np.sqrt(image * spec.value_range) if spec.gamma == "sqrt" else image * spec.value_range
    channels = len(image)
    if spec.colour == "separate":
        planes = image if channels == 3 else image[[0, 0, 0]]
        return np.concatenate([of_planes(plane[None], spec) for plane in planes], axis=-1)
    if spec.colour == "gray":
        weights = {1: [1.0], 3: [0.299, 0.587, 0.114]}.get(channels, [1 / channels] * channels)
        image = np.stack([sum(w * plane for w, plane in zip(weights, image, strict=True))])
    return of_planes(image, spec)


def of_planes(image: Array, spec: HOGSpec) -> Array:
    (rows, down), (cols, right) = voters(image.shape[1], 0, spec), voters(image.shape[2], 1, spec)
    votes: dict[tuple[int, int], Array] = {}
    result = np.zeros((rows, cols, spec.bins))
    for y, of_rows in down:
        for x, of_cols in right:
            if (y, x) not in votes:
                gradients = [pixel_gradient(plane, y, x, spec) for plane in image]
                squared = [gx * gx + gy * gy for gx, gy in gradients]
                votes[y, x] = vote(*gradients[winner(squared, x, image.shape[2], cols, spec)], spec)
            for row, by_row in of_rows:
                for col, by_col in of_cols:
                    result[row, col] += by_row * by_col * votes[y, x]
    return result


# --- Eq. 7 -----------------------------------------------------------------------------------------------------------


def global_norm(v: Array, scheme: GlobalNorm) -> Array:
    """Eq. 7, as printed or as meant."""
    norm = math.sqrt(float((v * v).sum()))
    if scheme.form == "printed":
        return v / math.sqrt(norm + scheme.epsilon)
    return v / math.sqrt(norm**2 + scheme.epsilon**2)


def cell_channels(v: Array, row: int, col: int, scheme: FourBlockNorm, *, signed: bool) -> Array:
    """All channels of one cell in the order of the parts."""
    rows, cols, bins = v.shape
    n = bins // 2 if signed else bins
    undirected = v[..., :n] + v[..., n:] if signed else v
    directed, folded, texture, each = np.zeros(bins), np.zeros(n), [], []
    for down, right in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        outside = not (0 <= row + down < rows and 0 <= col + right < cols)
        total = 0.0
        for r in (row, row + down):
            for c in (col, col + right):
                total += float((undirected[min(max(r, 0), rows - 1), min(max(c, 0), cols - 1)] ** 2).sum())
        factor = 1 / max(math.sqrt(total), scheme.epsilon) if scheme.floor else 1 / math.sqrt(total + scheme.epsilon)
        factor = 0.0 if outside and scheme.outside == "missing" else factor
        h = np.minimum(v[row, col] * factor, scheme.clip)
        u = np.minimum(undirected[row, col] * factor, scheme.clip)
        directed += h / 2
        folded += u / 2
        texture.append(u.sum() / math.sqrt(18) if scheme.texture == "vlfeat" else 0.2357 * h.sum())
        each.append(u)
    up_left, up_right, down_left, down_right = texture
    in_order = texture if scheme.texture == "vlfeat" else [down_right, up_right, down_left, up_left]
    channels = {"directed": directed, "undirected": folded, "texture": in_order, "blocks": np.ravel(each), "zero": [0]}
    return np.concatenate([channels[part] for part in scheme.parts])


def four_block_norm(v: Array, scheme: FourBlockNorm, *, signed: bool = True) -> Array:
    rows, cols, _ = v.shape
    edge = int(scheme.outside == "drop")
    return np.stack(
        [
            np.stack([cell_channels(v, row, col, scheme, signed=signed) for col in range(edge, cols - edge)])
            for row in range(edge, rows - edge)
        ]
    )


def normalized_block(v: Array, scheme: BlockNorm) -> Array:
    def unit(x: Array, epsilon: float) -> Array:
        energy = float((x**2).sum())
        return x / (math.sqrt(energy) + epsilon) if scheme.epsilon_outside_root else x / math.sqrt(energy + epsilon**2)

    if scheme.form in ("L1", "L1-sqrt"):
        share = v / (float(np.abs(v).sum()) + scheme.epsilon)
        return share if scheme.form == "L1" else np.sqrt(share)
    output = unit(v, scheme.epsilon)
    return output if scheme.form == "L2" else unit(np.minimum(output, scheme.clip), scheme.epsilon_again)


def block_norm(v: Array, scheme: BlockNorm) -> Array:
    (high, wide), (down, across) = scheme.block, scheme.step
    tops, lefts = range(0, v.shape[0] - high + 1, down), range(0, v.shape[1] - wide + 1, across)
    return np.stack(
        [np.stack([normalized_block(v[y : y + high, x : x + wide].ravel(), scheme) for x in lefts]) for y in tops]
    )


def cell_norm(v: Array, scheme: CellNorm) -> Array:
    return v / np.maximum(np.sqrt((v**2).sum(-1, keepdims=True)), scheme.epsilon)


def normalize(v: Array, spec: HOGSpec) -> Array:
    """Histograms (rows, cols, bins) of one colour to descriptors (rows, cols, channels)."""
    scheme = spec.normalizer
    if isinstance(scheme, GlobalNorm):
        return global_norm(v, scheme)
    if isinstance(scheme, FourBlockNorm):
        return four_block_norm(v, scheme, signed=spec.signed)
    if isinstance(scheme, BlockNorm):
        return block_norm(v, scheme)
    if isinstance(scheme, CellNorm):
        return cell_norm(v, scheme)
    raise NotImplementedError(f"tests/hog/reference.py has no slow version of {type(scheme).__name__}")


def hog(image: Array, spec: HOGSpec) -> Array:
    """Image (C, H, W), float64 in 0…1, to its descriptor (rows, cols, channels)."""
    v = histograms(image, spec)
    colours = np.split(v, 3, axis=-1) if spec.colour == "separate" else [v]
    return np.concatenate([normalize(one, spec) for one in colours], axis=-1)
