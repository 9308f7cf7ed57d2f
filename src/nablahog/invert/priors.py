"""Priors on images, made independent of the contrast that HOG leaves open."""

from __future__ import annotations

import torch
from torch import Tensor

from ..hog.orientation import magnitude

ROUNDING = 0.05  # of the mean gradient magnitude: below it an absolute difference is rounded off, for the minimiser


def smoothness(image: Tensor) -> Tensor:
    """The sum of Eq. 9's smoothness term over 4-neighbours, Σ |i_p - i_q|, as a share of Σ‖∇i‖: (A, 1, H, W) to (A,).

    The mask [-1, 0, 1] of ∇ skips the pixel in the middle, so the descriptor fixes Σ‖∇i‖ and leaves patterns of period
    two open; this ratio is smallest where neighbours change monotonically, and grows with each such pattern.
    """
    dx, dy = image[..., :, 1:] - image[..., :, :-1], image[..., 1:, :] - image[..., :-1, :]
    gx, gy = (dx[..., 1:] + dx[..., :-1])[..., 1:-1, :], (dy[..., 1:, :] + dy[..., :-1, :])[..., 1:-1]
    pixels = image[0].numel()  # sums over them, since the mean of no differences, in one row or column, is NaN
    visible = magnitude(gx, gy).sum(dim=(1, 2, 3)) / pixels
    scale = torch.where(visible > 0, visible, 1)
    rounding = (ROUNDING * scale).square().reshape(-1, 1, 1, 1)
    terms = [(d.square() + rounding).sqrt().sum(dim=(1, 2, 3)) for d in (dx, dy)]
    return (terms[0] + terms[1]) / (pixels * scale)
