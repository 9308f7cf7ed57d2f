"""The numbers of a dialect of :func:`nablahog.presets.opencv` that the loops of ``native/opencv.cpp`` take."""

from __future__ import annotations

import ctypes
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from ...hog import BlockNorm, HOGSpec
from ...hog.orientation import opencv_table
from ...hog.poolings import BlockCells
from ...hog.steps import pooling_matrices
from .arguments import Size

_INTEGERS = (
    *("gamma", "bins", "window_width", "window_height", "block_width", "block_height"),
    *("across", "down", "cell_cols", "cell_rows"),
)


class Constants(ctypes.Structure):
    """``Scheme`` of ``native/opencv_votes.h``."""

    _fields_ = [
        *((name, ctypes.c_int64) for name in _INTEGERS),
        ("polynomial", ctypes.c_float * 7),
        *((name, ctypes.c_float) for name in ("offset", "epsilon", "epsilon_again", "clip")),
    ]


class Scheme(NamedTuple):
    """What describes windows of one dialect.

    Attributes:
        spec: the dialect.
        rows: of blocks in a window.
        cols: of these.
        constants: of the loops.
        by_col: weights (cols, width) of a block's pixels in its columns of cells.
        by_row: the same of rows, (rows, height).
    """

    spec: HOGSpec
    rows: int
    cols: int
    constants: Constants
    by_col: NDArray[np.float32]
    by_row: NDArray[np.float32]

    @property
    def size(self) -> int:
        """Numbers of a descriptor."""
        return self.rows * self.cols * self.spec.channels


def scheme(window: Size, spec: HOGSpec) -> Scheme:
    """Of windows of (width, height), in a dialect of :func:`nablahog.presets.opencv`."""
    assert isinstance(spec.pooling, BlockCells)
    assert isinstance(spec.normalizer, BlockNorm)
    (height, width), (down, across), norm = spec.pooling.block, spec.pooling.step, spec.normalizer
    by_row, by_col = (each.contiguous().numpy() for each in pooling_matrices(spec, height, width, torch.empty(0)))
    rows, cols = spec.grid(window[1], window[0])
    constants = Constants(
        gamma=spec.gamma == "sqrt",
        bins=spec.bins,
        window_width=window[0],
        window_height=window[1],
        block_width=width,
        block_height=height,
        across=across,
        down=down,
        cell_cols=len(by_col),
        cell_rows=len(by_row),
        polynomial=opencv_table(spec),
        offset=spec.bin_offset,
        epsilon=norm.epsilon,
        epsilon_again=norm.epsilon_again,
        clip=norm.clip,
    )
    return Scheme(spec, rows, cols, constants, by_col, by_row)
