"""Rasterisation: the nearest triangle at each sample and its depth, in C++ on a CPU and in PyTorch elsewhere."""

from __future__ import annotations

from ctypes import c_bool, c_int64

import numpy as np
import torch
from torch import Tensor

from .. import native

_INTEGERS, _REALS = native.array(np.int32), native.array(np.float32, np.float64)
_MESH = _REALS, c_int64, c_int64, _INTEGERS, c_int64
_rasterize = native.function("rasterize", c_bool, *_MESH, c_int64, c_int64, _INTEGERS, _REALS)
_CHUNK = 2**22  # samples in bounding boxes of triangles that are tested together


def rasterize(screen: Tensor, faces: Tensor, height: int, width: int) -> tuple[Tensor, Tensor]:
    """Finds the nearest triangle at each sample.

    A sample on the common edge of two triangles belongs to both; of triangles at equal depth the first is visible.
    Triangles with a corner behind the camera (1 / depth ≤ 0) are not drawn: clip them first, :func:`.pipeline.clip`.

    Args:
        screen: (B, V, 3), float32 or float64: x and y in samples, sample (row i, column j) being at (j + ½, i + ½), and
            1 / depth.
        faces: (F, 3), int64 into the points.
        height, width: samples.

    Returns:
        The triangle, int64, -1 where there is none, and 1 / depth, 0 where there is none; both (B, height, width).
        Neither is differentiable.
    """
    screen = screen.detach().contiguous()
    if not native.can_read(screen):
        return rasterize_torch(screen, faces, height, width)
    ids = torch.empty(len(screen), height, width, dtype=torch.int32)
    inverse, triangles = screen.new_empty(ids.shape), faces.int().contiguous()
    mesh = screen, len(screen), screen.shape[1], triangles, len(triangles)
    _rasterize(screen.dtype == torch.float64, *mesh, height, width, ids, inverse)
    return ids.long(), inverse


def rasterize_torch(screen: Tensor, faces: Tensor, height: int, width: int) -> tuple[Tensor, Tensor]:
    """:func:`rasterize` in PyTorch, on any device."""
    corners = screen[:, faces]  # (B, F, 3, 3)
    low, high = corners[..., :2].amin(2), corners[..., :2].amax(2)
    limit = screen.new_tensor([width, height])
    first = (low - 0.5).ceil().clamp(min=0)
    count = ((high - 0.5).floor().minimum(limit - 1) - first + 1).clamp(min=0)
    drawn = (corners[..., 2] > 0).all(2) & torch.isfinite(corners).all(3).all(2)
    boxes = torch.where(drawn, count.prod(2), 0).nan_to_num(0).long().flatten()
    listed = boxes.nonzero().squeeze(1)
    total = boxes[listed].cumsum(0)
    nothing = len(faces)
    ids = torch.full((len(screen) * height * width,), nothing, dtype=torch.int64, device=screen.device)
    inverse = screen.new_zeros(len(ids))
    start = 0
    while start < len(listed):
        done = int(total[start - 1]) if start else 0
        stop = max(start + 1, int(torch.searchsorted(total, done + _CHUNK)))
        chunk = listed[start:stop]
        which = chunk.repeat_interleave(boxes[chunk])
        step = torch.arange(len(which), device=screen.device) - (
            total[start:stop] - boxes[chunk] - done
        ).repeat_interleave(boxes[chunk])
        batch, face = which // len(faces), which % len(faces)
        across = count[batch, face, 0].long()
        x = first[batch, face, 0] + step % across + 0.5
        y = first[batch, face, 1] + step // across + 0.5
        weights = barycentric(corners[batch, face], faces[face], x, y)
        inside = (weights >= 0).all(1)  # false for triangles of no area, whose weights are NaN
        batch, face, x, y, weights = (part[inside] for part in (batch, face, x, y, weights))
        w = corners[batch, face, :, 2]
        w = (weights * w).sum(1).maximum(w.amin(1)).minimum(w.amax(1))  # rounding must not decide who is first
        place = (batch * height + y.long()) * width + x.long()
        nearer = inverse.scatter_reduce(0, place, w, "amax")
        ids[nearer > inverse] = nothing
        best = w == nearer[place]
        ids.scatter_reduce_(0, place[best], face[best], "amin")
        inverse = nearer
        start = stop
    ids[ids == nothing] = -1
    return ids.reshape(-1, height, width), inverse.reshape(-1, height, width)


def barycentric(corners: Tensor, faces: Tensor, x: Tensor, y: Tensor) -> Tensor:
    """Screen-space barycentric coordinates (N, 3) of points x, y (N,) in triangles with corners (N, 3, ≥ 2).

    Each edge is taken from the lower to the higher vertex index in ``faces`` (N, 3), so that two triangles compute the
    same number for their common edge.
    """
    parts = []
    for k in range(3):
        a, b = (k + 1) % 3, (k + 2) % 3
        swap = faces[:, a] > faces[:, b]
        p = torch.where(swap[:, None], corners[:, b, :2], corners[:, a, :2])
        q = torch.where(swap[:, None], corners[:, a, :2], corners[:, b, :2])
        cross = (q[:, 0] - p[:, 0]) * (y - p[:, 1]) - (q[:, 1] - p[:, 1]) * (x - p[:, 0])
        parts.append(torch.where(swap, -cross, cross))
    weights = torch.stack(parts, 1)
    return weights / weights.sum(1, keepdim=True)


def normalize_weights(weights: Tensor) -> Tensor:
    """Scales weights (N, 3) to a sum of 1.  Weights without a sum, as of triangles of no area, become 1/3."""
    return (weights / weights.sum(1, keepdim=True)).nan_to_num(1 / 3)
