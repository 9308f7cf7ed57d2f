"""How fast the machine can be: bytes it moves and operations it does a second, and what a descriptor needs of both.

One thread; the best of several repeats, since a limit is what nothing exceeds.
"""

from __future__ import annotations

import ctypes
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nablahog.hog import BlockCells, BoxCells, GlobalNorm, HOGSpec

KIB = 1024
SIZES = tuple(KIB << k for k in range(7, 20, 2))  # bytes moved: 128 KiB … 512 MiB, from the first cache to memory
_FLOATS = 2048  # numbers; four arrays of them fit into any first-level cache
_CHAIN = 32


@dataclass(frozen=True)
class Rates:
    """What one thread does in a second, at most.

    Attributes:
        bandwidth: bytes read and written a second, by the bytes moved, copying from array to array; for few bytes no
            less than for more.
        fused: multiply-adds, in vectors of float32 as the compiler makes them.
        divisions, roots: likewise.
    """

    bandwidth: dict[int, float]
    fused: float
    divisions: float
    roots: float

    def bandwidth_of(self, moved: float) -> float:
        """The bandwidth at the nearest size measured."""
        return self.bandwidth[min(self.bandwidth, key=lambda size: abs(np.log(size / moved)))]


@dataclass(frozen=True)
class Work:
    """What has to be done for one pixel, in the mean over an image.

    Attributes:
        moved: bytes: each input read once, each output written once.
        fused: additions, multiplications, both in one, comparisons and selections; each counts as one.
        divisions, roots: those of the angle and of the magnitude, which processors do beside the others.
    """

    moved: float
    fused: float
    divisions: float
    roots: float


GRADIENT = 2 + 2  # two differences; the squared magnitude
ANGLE = 5 + 7 + 4  # folding to 0…45°; a polynomial of seven terms; unfolding
LINEAR = 3 + 2  # bin and share; two votes
HARD = 8  # four comparisons with a tangent each
ENTRY = 5  # of a descriptor: square, scale, clip, sum, write
CHAIN = 8  # from the derivative of the votes to that of the gradient
SCATTER = 4  # from the gradient's derivative to four pixels
IMAGE = 4  # bytes a pixel, float32


def work(spec: HOGSpec, backward: bool) -> Work:
    """The least that the dialect needs, of a gray image in float32.

    Votes go to rows of cells first, and what a row of cells has gathered in a column of pixels to columns of cells.
    Backward, gradient and votes are found again from the image.
    """
    height, width = spec.cell_size
    linear = spec.vote == "linear"
    cells, nearest = 1, 1 if isinstance(spec.pooling, BoxCells) else 2  # rows of cells: a cell's height; near a pixel
    if isinstance(spec.pooling, BlockCells):
        cells = spec.pooling.block[0] // height
        nearest = 2 * cells - 1  # in the mean: two in each block, but one at its rim
    votes = GRADIENT + (ANGLE + LINEAR if linear else HARD)
    pooled = (2 if linear else 1) * nearest + spec.bins * cells * nearest / height
    entries = spec.channels / (height * width)
    each = 2 if isinstance(spec.normalizer, GlobalNorm) else ENTRY  # square and scale
    fused, moved = votes + pooled + each * entries, IMAGE + IMAGE * entries
    if backward:
        fused += votes + pooled + 2 * each * entries + CHAIN + SCATTER
        moved += 2 * IMAGE + IMAGE * entries
    angles = 2 if backward else 1
    return Work(moved, fused, angles if linear else 0, angles)


def limits_ms(needed: Work, pixels: int, rates: Rates) -> tuple[float, float]:
    """Milliseconds that the bytes of so many pixels take at least, and that the operations take."""
    moved = needed.moved * pixels
    operations = max(needed.fused / rates.fused, needed.divisions / rates.divisions + needed.roots / rates.roots)
    return 1e3 * moved / rates.bandwidth_of(moved), 1e3 * operations * pixels


def measured(repeats: int = 12) -> Rates:
    bandwidth = {size: _bandwidth(size, repeats) for size in SIZES}
    loops = _compiled()
    return Rates(
        {size: max(rate for other, rate in bandwidth.items() if other >= size) for size in SIZES},
        _per_second(loops.fused, (4, _FLOATS // 4), _FLOATS * _CHAIN, repeats),
        _per_second(loops.divisions, (2, _FLOATS), _FLOATS, repeats),
        _per_second(loops.roots, (2, _FLOATS), _FLOATS, repeats),
    )


def _bandwidth(moved: int, repeats: int) -> float:
    source = np.ones(moved // 8, np.float32)
    target = source.copy()
    calls = max(1, SIZES[4] // moved)

    def copy() -> None:
        for _ in range(calls):
            np.copyto(target, source)

    return _best(copy, repeats, moved * calls)


def _compiled() -> ctypes.CDLL:
    """The loops of ``limits.cpp``."""
    with tempfile.TemporaryDirectory() as folder:
        library, source = Path(folder) / "limits.so", Path(__file__).with_name("limits.cpp")
        options = ["-O3", "-march=native", "-mprefer-vector-width=512", "-ffast-math", "-shared", "-fPIC"]
        subprocess.run(["c++", *options, str(source), "-o", str(library)], check=True)
        return ctypes.CDLL(str(library))


def _per_second(loop: Callable[..., None], shape: tuple[int, ...], operations: int, repeats: int) -> float:
    numbers, times = np.random.default_rng(0).uniform(0.5, 1, shape).astype(np.float32), 1000
    address, columns = ctypes.c_void_p(numbers.ctypes.data), ctypes.c_long(shape[-1])
    return _best(lambda: loop(address, columns, ctypes.c_long(times)), repeats, operations * times)


def _best(call: Callable[[], None], repeats: int, amount: float) -> float:
    """How much of ``amount`` a second; by the time of the process, which other programs do not count in."""
    call()
    shortest = float("inf")
    for _ in range(repeats):
        start = time.process_time()
        call()
        shortest = min(shortest, time.process_time() - start)
    return amount / shortest
