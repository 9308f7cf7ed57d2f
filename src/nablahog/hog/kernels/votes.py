"""Eq. 1-4 compiled: gray images to what each pixel votes, and back from gradients to images."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import torch

from ...compile import compiled
from ..orientation import hard_directions, vanishing
from ..spec import HOGSpec

BORDERS = {"reflect": 0, "ignore": 0, "replicate": 1, "zero": 2}
_PIXELS_AT_ONCE = 2**15  # of the images between whose steps five planes wait in a processor's cache

# atan(t) / π for t in 0…1, within 8e-8: an odd polynomial, so that right angles stay exactly on their bin centres
_ARCTANGENT = np.array(
    [0.3183086485, -0.1060524763, 0.06305023492, -0.04212303499, 0.02534499976, -0.01069655349, 0.002168260411],
    np.float32,
)


@compiled
def _gradient(images: Any, scale: Any, border: int, gx: Any, gy: Any) -> None:
    """Eq. 1-2: images (B, H, W), times ``scale``, to their gradients."""
    batch, height, width = images.shape
    for b in range(batch):
        image = images[b]
        for y in range(height):
            for x in range(1, width - 1):
                gx[b, y, x] = scale * (image[y, x + 1] - image[y, x - 1])
            gx[b, y, 0] = gx[b, y, width - 1] = scale * (image[y, 0] - image[y, 0])
            if width > 1 and border > 0:
                gx[b, y, 0] = scale * (image[y, 1] - image[y, 0] if border == 1 else image[y, 1])
                gx[b, y, width - 1] = scale * (
                    image[y, width - 1] - image[y, width - 2] if border == 1 else -image[y, width - 2]
                )
        for y in range(1, height - 1):
            for x in range(width):
                gy[b, y, x] = scale * (image[y + 1, x] - image[y - 1, x])
        for x in range(width):
            gy[b, 0, x] = gy[b, height - 1, x] = scale * (image[0, x] - image[0, x])
            if height > 1 and border > 0:
                gy[b, 0, x] = scale * (image[1, x] - image[0, x] if border == 1 else image[1, x])
                gy[b, height - 1, x] = scale * (
                    image[height - 1, x] - image[height - 2, x] if border == 1 else -image[height - 2, x]
                )


@compiled
def _gradient_adjoint(to_gx: Any, to_gy: Any, scale: Any, border: int, images: Any) -> None:
    """Adds to ``images`` (B, H, W) what reaches them from their gradients."""
    batch, height, width = images.shape
    for b in range(batch):
        image = images[b]
        for y in range(height):
            row, along = image[y], to_gx[b, y]
            for x in range(1, width - 1):
                row[x + 1] += scale * along[x]
            for x in range(1, width - 1):
                row[x - 1] -= scale * along[x]
            if width > 1 and border > 0:
                row[1] += scale * along[0]
                row[width - 2] -= scale * along[width - 1]
                if border == 1:
                    row[0] -= scale * along[0]
                    row[width - 1] += scale * along[width - 1]
        for y in range(1, height - 1):
            above, below, along = image[y - 1], image[y + 1], to_gy[b, y]
            for x in range(width):
                below[x] += scale * along[x]
            for x in range(width):
                above[x] -= scale * along[x]
        if height > 1 and border > 0:
            for x in range(width):
                image[1, x] += scale * to_gy[b, 0, x]
                image[height - 2, x] -= scale * to_gy[b, height - 1, x]
                if border == 1:
                    image[0, x] -= scale * to_gy[b, 0, x]
                    image[height - 1, x] += scale * to_gy[b, height - 1, x]


@compiled
def _linear_single(
    gx: Any,
    gy: Any,
    tiny: Any,
    per_half_turn: Any,
    offset: Any,
    bins: Any,
    arctangent: Any,
    m: Any,
    nearest: Any,
    r: Any,
) -> None:
    """Eq. 2-4 for gradients (pixels,) in float32: magnitudes, nearest bins, and the rest of the way in bins.

    Without branches, so that several pixels go at a time.
    """
    a0, a1, a2, a3, a4, a5, a6 = arctangent
    one, half, zero = arctangent.dtype.type(1), arctangent.dtype.type(0.5), arctangent.dtype.type(0)
    quarter = half * half
    for i in range(gx.size):
        u, v = gx[i], gy[i]
        squared = u * u + v * v
        nothing = squared < tiny
        m[i] = zero if nothing else math.sqrt(squared)
        au, av = abs(u), abs(v)
        steep = av > au
        small = au if steep else av
        large = av if steep else au
        t = zero if nothing else small / (one if nothing else large)
        s = t * t
        turn = t * (a0 + s * (a1 + s * (a2 + s * (a3 + s * (a4 + s * (a5 + s * a6))))))
        turn = quarter if small == large else turn  # which may be a bin centre, too
        turn = half - turn if steep else turn
        turn = one - turn if u < zero else turn
        turn = -turn if v < zero else turn
        position = (zero if nothing else turn) * per_half_turn - offset
        whole = np.rint(position)
        r[i] = position - whole
        whole = whole + bins if whole < zero else whole
        whole = whole + bins if whole < zero else whole
        whole = whole - bins if whole >= bins else whole
        whole = whole if whole >= zero else zero  # of NaN
        nearest[i] = np.int32(whole)


@compiled
def _linear_double(
    gx: Any,
    gy: Any,
    tiny: Any,
    per_half_turn: Any,
    offset: Any,
    bins: Any,
    arctangent: Any,
    m: Any,
    nearest: Any,
    r: Any,
) -> None:
    """The same in float64."""
    for i in range(gx.size):
        u, v = gx[i], gy[i]
        squared = u * u + v * v
        nothing = squared < tiny
        m[i] = 0.0 if nothing else math.sqrt(squared)
        position = (0.0 if nothing else math.atan2(v, u) / math.pi) * per_half_turn - offset
        whole = np.rint(position)
        r[i] = position - whole
        whole %= bins
        nearest[i] = np.int32(whole if whole >= 0 else 0.0)


@compiled
def _hard(gx: Any, gy: Any, tiny: Any, directions: Any, signed: bool, m: Any, nearest: Any, r: Any) -> None:
    """The same by the largest |dot product| with ``directions`` (cos, sin) (2, axes), the first on ties; no rest."""
    axes = directions.shape[1]
    for i in range(gx.size):
        u, v = gx[i], gy[i]
        squared = u * u + v * v
        m[i] = squared * 0 if squared < tiny else math.sqrt(squared)
        best, most, sign = 0, u * 0 - 1, False
        for k in range(axes):
            dot = u * directions[0, k] + v * directions[1, k]
            if abs(dot) > most:
                best, most, sign = k, abs(dot), dot < 0
        nearest[i] = best + axes if signed and sign else best
        r[i] = 0


class Voter:
    """Gray images (B, H, W), a few at a time, in planes that stay in a processor's cache.

    Args:
        spec: the dialect.
        images: the batch, float32 or float64 in 0…1.
    """

    def __init__(self, spec: HOGSpec, images: Any) -> None:
        self.spec, self.images, self.dtype = spec, images, images.dtype.type
        self.scale, self.border = self.dtype(spec.value_range), BORDERS[spec.border]
        self.at_once = max(1, _PIXELS_AT_ONCE // max(1, images[:1].size))
        shape = (min(self.at_once, len(images)), *images.shape[1:])
        types = [images.dtype] * 4 + [np.dtype(np.int32)]
        self.planes = [np.empty(shape, dtype) for dtype in types]

    def __iter__(self) -> Iterator[tuple[slice, tuple[Any, Any], tuple[Any, Any, Any]]]:
        """Which images, their gradients, and what they vote: magnitudes, nearest bins, and the rest of the way in bins.

        Of a pixel without a gradient only the magnitude counts.  All may be changed; the next few overwrite them.
        """
        for first in range(0, len(self.images), self.at_once):
            few = slice(first, first + self.at_once)
            images = self.images[few]
            gx, gy, m, r, nearest = (plane[: len(images)] for plane in self.planes)
            _gradient(images, self.scale, self.border, gx, gy)
            self._vote(*(plane.reshape(-1) for plane in (gx, gy, m, nearest, r)))
            yield few, (gx, gy), (m, nearest, r)

    def _vote(self, gx: Any, gy: Any, *votes: Any) -> None:
        spec, dtype = self.spec, self.dtype
        tiny = dtype(vanishing(torch.float32 if dtype is np.float32 else torch.float64))
        if spec.vote == "hard":
            _hard(gx, gy, tiny, hard_directions(spec).astype(dtype), spec.signed, *votes)
            return
        turns = dtype(spec.bins * math.pi / spec.period), dtype(spec.bin_offset), dtype(spec.bins)
        linear = _linear_single if dtype is np.float32 else _linear_double
        linear(gx, gy, tiny, *turns, _ARCTANGENT, *votes)

    def add_to_images(self, to_gx: Any, to_gy: Any, found: Any) -> None:
        """Adds to ``found`` (B, H, W) what reaches images from their gradients."""
        _gradient_adjoint(to_gx, to_gy, self.scale, self.border, found)
