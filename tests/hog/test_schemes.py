"""Normalisers and poolings: what they refuse."""

from __future__ import annotations

import math
from typing import Any

import pytest

from nablahog.hog import BilinearCells, BlockCells, BlockNorm, BoxCells, CellNorm, FourBlockNorm, GlobalNorm


@pytest.mark.parametrize("value", [0, -1e-5, math.nan, math.inf, "small", None])
def test_normalizers_refuse(value: Any) -> None:
    with pytest.raises(ValueError, match=r"^epsilon must be a number in 1e-12 … 1e\+12, got "):
        GlobalNorm(epsilon=value)
    with pytest.raises(ValueError, match=r"^epsilon must be a number in 1e-12 … 1e\+12, got "):
        FourBlockNorm(epsilon=value)
    with pytest.raises(ValueError, match=r"^epsilon must be a number in 1e-12 … 1e\+12, got "):
        CellNorm(epsilon=value)
    with pytest.raises(ValueError, match=r"^clip must be a number in 1e-12 … 1e\+12, got "):
        FourBlockNorm(clip=value)
    for name in ("epsilon", "epsilon_again", "clip"):
        with pytest.raises(ValueError, match=rf"^{name} must be a number in 1e-12 … 1e\+12, got "):
            BlockNorm((2, 2), **{name: value})


@pytest.mark.parametrize("form", ["", "L2", None])
def test_global_norm_refuses_form(form: Any) -> None:
    with pytest.raises(ValueError, match=r"^form must be one of 'printed', 'robust', got "):
        GlobalNorm(form=form)


@pytest.mark.parametrize("field", ["texture", "outside"])
@pytest.mark.parametrize("value", ["", "VLFeat", None, []])
def test_four_block_norm_refuses_choices(field: str, value: Any) -> None:
    with pytest.raises(ValueError, match=rf"^{field} must be one of '\w+', .*, got "):
        FourBlockNorm(**{field: value})


@pytest.mark.parametrize("value", [0, 1, None, "yes"])
def test_normalizers_refuse_flags(value: Any) -> None:
    with pytest.raises(ValueError, match=r"^floor must be True or False, got "):
        FourBlockNorm(floor=value)
    with pytest.raises(ValueError, match=r"^epsilon_outside_root must be True or False, got "):
        BlockNorm((2, 2), epsilon_outside_root=value)
    with pytest.raises(ValueError, match=r"^mean must be True or False, got "):
        BoxCells(mean=value)


@pytest.mark.parametrize("value", [2, (2,), [2], (0, 2), (2.0, 2), (True, 2), None])
def test_sizes_of_blocks_are_pairs(value: Any) -> None:
    message = r" must be a pair \(height, width\) of integers in 1 … 1,000,000, got "
    for name in ("block", "step"):
        sizes = {"block": (2, 2), "step": (1, 1), name: value}
        with pytest.raises(ValueError, match="^" + name + message):
            BlockNorm(**sizes)
        with pytest.raises(ValueError, match="^" + name + message):
            BlockCells(**sizes, sigma=1.0)


@pytest.mark.parametrize("form", ["", "l2", "L3", None])
def test_block_norm_refuses_form(form: Any) -> None:
    with pytest.raises(ValueError, match=r"^form must be one of 'L1', 'L1-sqrt', 'L2', 'L2-Hys', got "):
        BlockNorm((2, 2), form=form)


@pytest.mark.parametrize("value", [0, -1.0, math.nan, "small", None])
def test_poolings_refuse(value: Any) -> None:
    with pytest.raises(ValueError, match=r"^edge_gain must be a number in 1e-12 … 1e\+12, got "):
        BilinearCells(edge_gain=value)
    with pytest.raises(ValueError, match=r"^sigma must be a number in 1e-12 … 1e\+12, got "):
        BlockCells((2, 2), (2, 2), value)
    with pytest.raises(ValueError, match=r"^beyond must be one of 'vote', 'drop', 'repeat', got "):
        BilinearCells(value)


@pytest.mark.parametrize("window", [1, -1, 8.0, True, None])
def test_box_cells_refuse_window(window: Any) -> None:
    """One pixel alone would have no spread."""
    with pytest.raises(ValueError, match=r"^window must be 0 or a number of pixels in 2 … 1,000,000, got "):
        BoxCells(window=window)


@pytest.mark.parametrize(
    "value",
    [
        *[(), ("texture",), ("zero",), ("texture", "zero"), ("texture", "directed"), ("blocks", "texture")],
        *[("directed",) * 2, ("colour",), ["colour"], "directed", None, ([],)],
    ],
)
def test_refuses_parts(value: Any) -> None:
    names = "'directed', 'undirected', 'texture', 'blocks', 'zero'"
    with pytest.raises(ValueError, match=rf"^parts must be a tuple of {names}, in this order, not of texture or zero"):
        FourBlockNorm(parts=value)
