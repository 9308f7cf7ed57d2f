"""Visible edges between samples: where they cross, what that makes of the pixels, and how pixels change as they move.

The derivative of an image of surfaces is that of brightness on the surfaces, plus, wherever brightness differs between
two places, the difference times the way the boundary moves.  Two neighbouring samples of different brightness are such
a place.  An edge of the mesh between them says exactly where the boundary is and how it moves; without one (smooth
shading, or surfaces that pass through each other) it is half-way between them, and moves with the surface in front.

What this leaves out: half a sample along the image's border; corners, where the shares of two edges in a sample add up
instead of multiplying; creases of faces so steep that 1 / depth changes by :data:`GAP` between samples, and edges that
the near plane cuts, which move but are not smoothed.  More samples to a pixel make all of these as much smaller.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from .rasterize import barycentric, normalized
from .topology import OPEN, SMOOTH, Edges

GAP = 0.05
"""Where 1 / depth differs by more than this share between neighbouring samples, one surface ends before another."""
_TOUCHING = 0.004  # as a share of 1 / depth: so far behind a surface an edge may still be its crease


class Crossings(NamedTuple):
    """Links between neighbouring samples that a visible edge crosses.

    Attributes:
        batch, axis, row, col: (N,): the link goes from sample (row, col) down (axis 0) or to the right (axis 1).
        at: (N,) in 0…1: how far along the link.
        slope: (N,): samples along the link that the edge advances for each sample across it.
        measured: (N,): False where the link is along the edge's minor axis: its crossing counts on the other axis.
        edge: (N,): which edge.
        part: (N,) in 0…1: how far along the edge, on the screen.
    """

    batch: Tensor
    axis: Tensor
    row: Tensor
    col: Tensor
    at: Tensor
    slope: Tensor
    measured: Tensor
    edge: Tensor
    part: Tensor


def crossings(screen: Tensor, edges: Edges, ids: Tensor, inverse: Tensor) -> Crossings:
    """Follows each edge sample by sample along both axes, and keeps it where it lies in front of what is behind.

    Of several edges on one link, it keeps the outermost of the nearer surface where there is a gap in depth, which
    only an outline can make, else the nearest.

    Args:
        screen: (B, V, 3), as for :func:`.rasterize.visibility`, which made ``ids`` and ``inverse`` (B, H, W).
        edges: of the mesh.
    """
    screen = screen.detach()
    ends = screen[:, edges.ends]
    outline = outlines(screen, edges)
    followed = (ends[..., 2] > 0).all(2) & (outline | (edges.kind != SMOOTH))
    across = (ends[:, :, 1, :2] - ends[:, :, 0, :2]).abs()
    steep = across[..., 1] > across[..., 0]
    found = [_along(axis, ends, followed, ids, inverse, outline, steep == (axis == 1)) for axis in (0, 1)]
    return Crossings(*(torch.cat(field) for field in zip(*found, strict=True)))


def outlines(screen: Tensor, edges: Edges) -> Tensor:
    """(B, E): whether an edge, before the camera, is one of an open surface, or both its faces lie on one side of it on
    the screen (B, V, 3)."""
    a, b = screen[:, edges.ends, :2].unbind(2)
    along = (b - a).unsqueeze(2)
    opposite = screen[:, edges.opposite]
    third = opposite[..., :2] - a.unsqueeze(2)
    side = along[..., 0] * third[..., 1] - third[..., 0] * along[..., 1]
    side = side * opposite[..., 2].sign()  # what is behind the camera is projected to the other side
    return (side[..., 0] * side[..., 1] >= 0) | (edges.kind == OPEN)


def _along(
    axis: int, ends: Tensor, followed: Tensor, ids: Tensor, inverse: Tensor, outline: Tensor, measured: Tensor
) -> Crossings:
    """The crossings of links along one axis; ``p`` runs across the links, ``q`` along them."""
    size_p, size_q = (ids.shape[2], ids.shape[1]) if axis == 0 else (ids.shape[1], ids.shape[2])
    p, q = ends[..., axis], ends[..., 1 - axis]  # (B, E, 2)
    p_low, p_high = p.amin(2), p.amax(2)
    first = (p_low - 0.5).ceil().clamp(min=0)
    last = ((p_high - 0.5).ceil() - 1).clamp(max=size_p - 1)
    counts = torch.where(followed & (p_low < p_high), (last - first + 1).clamp(min=0), 0).long()
    batch, edge = counts.nonzero(as_tuple=True)
    counts = counts[batch, edge]
    which = torch.arange(len(counts), device=ids.device).repeat_interleave(counts)
    step = torch.arange(len(which), device=ids.device) - (counts.cumsum(0) - counts)[which]
    batch, edge = batch[which], edge[which]
    place = first[batch, edge].long() + step
    p, q, w = p[batch, edge], q[batch, edge], ends[batch, edge][:, :, 2]
    part = (place + 0.5 - p[:, 0]) / (p[:, 1] - p[:, 0])
    slope = (q[:, 1] - q[:, 0]) / (p[:, 1] - p[:, 0])
    position = q[:, 0] + (place + 0.5 - p[:, 0]) * slope - 0.5
    w = torch.lerp(w[:, 0], w[:, 1], part)
    inside = (position >= 0) & (position < size_q - 1)
    batch, edge, place, part, slope, position, w = (
        field[inside] for field in (batch, edge, place, part, slope, position, w)
    )
    k = position.long()
    row, col = (k, place) if axis == 0 else (place, k)
    row2, col2 = (row + 1, col) if axis == 0 else (row, col + 1)
    here, there = inverse[batch, row, col], inverse[batch, row2, col2]
    low, high = torch.minimum(here, there), torch.maximum(here, there)
    gap = high - low > GAP * high
    seen = torch.where(gap, outline[batch, edge] & (w >= (low + high) / 2), w >= (1 - _TOUCHING) * low)
    seen &= high > 0
    at = position - k
    rank = torch.where(gap, torch.where(here > there, at, 1 - at), w)
    link = (batch * ids.shape[1] + row) * ids.shape[2] + col
    kept = seen.nonzero().squeeze(1)
    kept = kept[highest(link[kept], rank[kept], ids.numel())]
    axes = torch.full_like(kept, axis)
    return Crossings(
        batch[kept], axes, row[kept], col[kept], at[kept], slope[kept], measured[batch, edge][kept], edge[kept],
        part[kept],
    )  # fmt: skip


def highest(place: Tensor, rank: Tensor, size: int) -> Tensor:
    """Which of entries with a place (N,) in 0…size-1 and a rank (N,) of 0 or more is first at its place: the one of the
    highest rank, and of several such the first."""
    best = rank.new_full((size,), -1).scatter_reduce(0, place, rank, "amax")
    kept = (rank == best[place]).nonzero().squeeze(1)
    number = place.new_full((size,), len(place)).scatter_reduce(0, place[kept], kept, "amin")
    return number[number < len(place)]


def blend(
    samples: Tensor, ids: Tensor, inverse: Tensor, found: Crossings, screen: Tensor, edges: Edges, faces: Tensor,
    step: int,
) -> Tensor:  # fmt: skip
    """Samples (B, H · step, W · step) to pixels (B, H, W): means, with visible edges where they cross.

    Differentiable in ``samples``, and in ``screen`` (B, V, 3), through which everything moves.
    """
    batch, height, width = samples.shape
    image = torch.nn.functional.avg_pool2d(samples[:, None], step)[:, 0]
    share = 1 / step**2
    moved = screen - screen.detach()  # 0; only its derivative matters
    for axis in (0, 1):
        on_axis = found.axis == axis
        one = Crossings(*(field[on_axis] for field in found))
        shape = (batch, height - 1, width) if axis == 0 else (batch, height, width - 1)
        second = (slice(None), slice(1, None), slice(None)) if axis == 0 else (slice(None), slice(None), slice(1, None))
        first = tuple(slice(0, n) for n in shape)
        difference = samples[second] - samples[first]
        crossed = torch.zeros(shape, dtype=torch.bool, device=samples.device)
        crossed[one.batch, one.row, one.col] = True
        either = (ids[first] >= 0) | (ids[second] >= 0)

        # links with an edge
        one = Crossings(*(field[one.measured] for field in one))
        one = Crossings(*(field[either[one.batch, one.row, one.col]] for field in one))
        d = difference[one.batch, one.row, one.col]
        after = (one.at >= 0.5).long()
        row, col = one.row + after * (axis == 0), one.col + after * (axis == 1)
        pixel = (one.batch, row // step, col // step)
        image = image.index_put(pixel, (0.5 - one.at) * d * share, accumulate=True)
        ends = moved[one.batch[:, None], edges.ends[one.edge]]
        way = torch.lerp(ends[:, 0], ends[:, 1], one.part[:, None])
        # samples along the link that the edge moves: so much of a sample changes sides
        way = way[:, 1 - axis] - one.slope * way[:, axis]
        image = image.index_put(pixel, -d.detach() * share * way, accumulate=True)

        # links without
        link = ((difference.detach() != 0) & either & ~crossed).nonzero()
        d = difference.detach()[tuple(link.T)]
        n, row, col = link.T
        row2, col2 = row + (axis == 0), col + (axis == 1)
        nearer = inverse[n, row2, col2] > inverse[n, row, col]
        face = torch.where(nearer, ids[n, row2, col2], ids[n, row, col])
        way = surface_motion(screen, moved, faces[face], n, (col + col2 + 1) / 2, (row + row2 + 1) / 2)[:, 1 - axis]
        change = -d * share / 2 * way
        image = image.index_put((n, row // step, col // step), change, accumulate=True)
        image = image.index_put((n, row2 // step, col2 // step), change, accumulate=True)
    return image


def surface_motion(screen: Tensor, moved: Tensor, corners: Tensor, batch: Tensor, x: Tensor, y: Tensor) -> Tensor:
    """How points x, y (N,) of the surface through triangles ``corners`` (N, 3) move on the screen, (N, 2), if the
    triangles' corners move by ``moved`` (B, V, 3): x, y and 1 / depth.

    With β the point's barycentric coordinates on the screen, u = Σ β u_k; the surface's own coordinates, which stay,
    are proportional to β times 1 / depth, so that du = Σ β (du_k - (u_k - u) dw_k / w_k).
    """
    at = screen.detach()[batch[:, None], corners]
    weights = barycentric(at, corners, x, y)
    # half a sample beyond the outline of a triangle seen from the side is far away in its plane
    weights = normalized(weights.clamp(min=-0.5))
    point = torch.stack([x, y], 1)
    change = moved[batch[:, None], corners]
    across = at[..., :2] - point[:, None]
    return (weights[..., None] * (change[..., :2] - across * (change[..., 2:] / at[..., 2:]))).sum(1)
