"""The loops of ``native/opencv.cpp`` in the steps of :mod:`nablahog.hog`.

Gradients are taken here: ``hog`` has no padding whose outermost pixels have gradients.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from ...hog import HOGSpec
from ...hog.layout import to_layout
from ...hog.orientation import opencv_angle
from ...hog.poolings import BlockCells
from ...hog.steps import pool
from .padded import Padded


def _gradients(padded: Padded, spec: HOGSpec) -> NDArray[np.float32]:
    """Gx, Gy (2, rows, cols) of all pixels, of the channel of largest magnitude."""
    (left, top), (right, bottom) = padded.before, padded.after
    around = (top + 1, bottom + 1), (left + 1, right + 1), (0, 0)
    values = np.pad(padded.image, around, mode="reflect").astype(np.float32)
    values = np.sqrt(values) if spec.gamma == "sqrt" else values
    both = np.stack([values[1:-1, 2:] - values[1:-1, :-2], values[2:, 1:-1] - values[:-2, 1:-1]])
    squared = np.square(both).sum(axis=0)
    first, last = squared.argmax(axis=2), squared.shape[2] - 1 - squared[..., ::-1].argmax(axis=2)
    width = squared.shape[1]
    # of equals the first channel, but in the last columns, which OpenCV computes one by one, the last one
    winner = np.where(np.arange(width) < width // 4 * 4, first, last)
    return np.take_along_axis(both, winner[None, ..., None], axis=3)[..., 0]


def votes(padded: Padded, spec: HOGSpec) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int64]]:
    """Votes of all pixels and the bins that the first go to; the second go to those after them.  All (rows, cols)."""
    gx, gy = _gradients(padded, spec)
    position = opencv_angle(torch.from_numpy(gx), torch.from_numpy(gy), spec).numpy()
    before, magnitude = np.floor(position), np.sqrt(gx * gx + gy * gy)
    f = position - before
    return magnitude * (1 - f), magnitude * f, before.astype(np.int64) % spec.bins


def descriptors(padded: Padded, corners: NDArray[np.int64], spec: HOGSpec, rows: int, cols: int) -> NDArray[np.float32]:
    """Descriptors (windows, numbers) of windows of so many rows and columns of blocks in the padded image.

    The blocks of the whole image, from some pixel on, serve all windows whole strides of blocks from there.
    """
    assert isinstance(spec.pooling, BlockCells)
    near, far, bins = (torch.from_numpy(each)[None, None] for each in votes(padded, spec))
    histograms = torch.zeros(1, spec.bins, *bins.shape[2:]).scatter_(1, bins, near)
    histograms.scatter_add_(1, (bins + 1) % spec.bins, far)
    strides, stride = corners[:, ::-1] // spec.pooling.step, corners[:, ::-1] % spec.pooling.step
    out = np.empty((len(corners), rows * cols * spec.channels), np.float32)
    for y, x in np.unique(stride, axis=0):
        cells = pool(histograms[..., y:, x:], spec)
        blocks = spec.normalizer.normalize(cells, spec.signed)[0]
        windows = blocks.unfold(1, rows, 1).unfold(2, cols, 1)  # (channels, rows, columns of windows, rows, cols)
        some = (stride == (y, x)).all(axis=1)
        row, col = torch.from_numpy(strides[some].T)
        out[some] = to_layout(windows[:, row, col].permute(1, 2, 3, 0), spec).numpy()
    return out
