"""A strip's crop is summed up in the bands of the whole image, where it counts: so it is rounded alike."""

from __future__ import annotations

import pytest
import torch

from nablahog.hog import BilinearCells, BlockCells, BlockNorm, BoxCells, HOGSpec
from nablahog.hog.poolings import Pooling
from nablahog.hog.strips import Strips
from nablahog.hog.tables import pooling_axes

from .zoo import SPECS, spec

WIDTH = 6


def bands(s: HOGSpec, height: int, at: int = 0) -> list[tuple[int, int]]:
    """Of an image, or of a crop that begins ``at``."""
    return [(int(a) + at, int(b) + at) for a, b, _ in pooling_axes(s, height, WIDTH, torch.float32)[0].stretches]


def assert_alike(s: HOGSpec, height: int) -> None:
    block, step = s.cell_size[0], s.cell_size[0]
    reach = block // 2 if isinstance(s.pooling, BilinearCells) else 0
    if isinstance(s.pooling, BlockCells):
        block, step = s.pooling.block[0], s.pooling.step[0]
    cells = block // s.cell_size[0]
    whole, strips = bands(s, height), list(Strips(s, height, WIDTH, torch.float32).of(1))
    assert len(strips) > 1
    for strip in strips:
        start, stop = strip.pixels
        first = start + strip.cells.start // cells * step - reach
        last = start + ((strip.cells.stop - 1) // cells) * step + block + reach
        crop = bands(s, stop - start, start)
        ours, theirs = ([band for band in result if band[1] > first and band[0] < last] for result in (crop, whole))
        assert ours == theirs, strip
        # and in none of them is the first or the last row of the crop, whose gradients are others
        assert all((start == 0 or above > start) and (stop == height or below < stop) for above, below in ours)


@pytest.mark.parametrize("border", ["reflect", "ignore"])
@pytest.mark.parametrize("cells", [1, 2, 3])
@pytest.mark.parametrize("cell", [1, 2, 4])
def test_blocks(cell: int, cells: int, border: str) -> None:
    block = cell * cells
    for step in range(1, 2 * block + 1):
        s = spec(
            cell_size=(cell, 1),
            pooling=BlockCells((block, 2), (step, 1), 3.0),
            normalizer=BlockNorm((cells, 2), (cells, 2)),
            border=border,
        )
        assert_alike(s, 3 * block + 14 * step + 1)


@pytest.mark.parametrize("pooling", [BilinearCells(), BilinearCells("repeat"), BoxCells(), BoxCells(window=3)])
def test_cells(pooling: Pooling) -> None:
    for cell in range(1, 12):
        for border in ("reflect", "ignore"):
            assert_alike(spec(cell_size=(cell, 1), pooling=pooling, border=border), 15 * cell + 1)


def test_the_margin_is_enough() -> None:
    """Of the memory that a strip takes."""
    for name, s in SPECS.items():
        strips = Strips(s, 3000, 50, torch.float32)
        for rows in (1, 7, 60):
            for strip in strips.of(rows):
                apart = (strip.rows.stop - strip.rows.start) * strips.apart
                assert strip.pixels.stop - strip.pixels.start <= apart + strips.margin, name
