"""Edge gradients: anti-aliased edges between samples, and the derivative of pixels by the motion of edges.

The derivative of an image has two parts: that of brightness on the surfaces, and at each boundary the difference of
brightness across it times the motion of the boundary.  There is a boundary between any two neighbouring samples of
different brightness.  If an edge of the mesh crosses the link between them, it gives the exact place and motion of the
boundary.  Otherwise (smooth shading, or surfaces that intersect) the boundary is half-way, and moves with the surface
in front.

Not covered: half a sample along the image's border; corners, where the areas of two edges in a sample are added instead
of multiplied; creases of faces so steep that 1 / depth changes by :data:`GAP` between samples; and edges at the near
plane, which move but are not anti-aliased.  All of these errors shrink with the size of a sample.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from .rasterize import barycentric, normalize_weights
from .surface import BOUNDARY, SMOOTH, Edges

GAP = 0.05
"""Relative difference of 1 / depth between neighbouring samples above which one surface ends before another."""
TOUCHING = 0.004
"""As a share of 1 / depth: an edge at most so far behind a surface may still be its crease."""


class Crossings(NamedTuple):
    """Links between neighbouring samples that a visible edge crosses: N of them, and as many numbers in each field."""

    batch: Tensor
    axis: Tensor  # the link goes from a sample down (0) or to the right (1)
    row: Tensor
    col: Tensor
    at: Tensor  # in 0…1: how far along the link
    slope: Tensor  # samples along the link that the edge advances for each sample across it
    measured: Tensor  # False where the link is along the edge's minor axis: its crossing counts on the other axis
    edge: Tensor  # index of the edge
    part: Tensor  # in 0…1: how far along the edge, on the screen

    def select(self, index: Tensor) -> Crossings:
        """The crossings at an index or in a mask."""
        return Crossings(*(field[index] for field in self))


def edge_crossings(screen: Tensor, edges: Edges, ids: Tensor, inverse: Tensor) -> Crossings:
    """Follows each edge sample by sample along both axes, and lists the links that it crosses where it is visible.

    An edge is visible where it lies in front of what is behind.  Of several edges on one link, the outermost of the
    nearer surface counts where there is a gap in depth, which only a silhouette can make, else the nearest.

    Args:
        screen: (B, V, 3), as for :func:`.rasterize.rasterize`.
        edges: of the mesh.
        ids, inverse: (B, H, W), triangles and 1 / depth, from :func:`.rasterize.rasterize`.
    """
    screen = screen.detach()
    ends = screen[:, edges.ends]
    silhouette = silhouette_edges(screen, edges)
    candidates = (ends[..., 2] > 0).all(2) & (silhouette | (edges.kind != SMOOTH))
    across = (ends[:, :, 1, :2] - ends[:, :, 0, :2]).abs()
    steep = across[..., 1] > across[..., 0]
    axes = [_find_crossings(axis, ends, candidates, ids, inverse, silhouette, steep == (axis == 1)) for axis in (0, 1)]
    return Crossings(*(torch.cat(field) for field in zip(*axes, strict=True)))


def silhouette_edges(screen: Tensor, edges: Edges) -> Tensor:
    """(B, E): True for edges of one face only, and for those with both faces on one side on the screen (B, V, 3).

    It holds for edges in front of the camera.
    """
    a, b = screen[:, edges.ends, :2].unbind(2)
    along = (b - a).unsqueeze(2)
    opposite = screen[:, edges.opposite]
    third = opposite[..., :2] - a.unsqueeze(2)
    side = along[..., 0] * third[..., 1] - third[..., 0] * along[..., 1]
    side = side * opposite[..., 2].sign()  # points behind the camera are projected to the other side
    return (side[..., 0] * side[..., 1] >= 0) | (edges.kind == BOUNDARY)


def _find_crossings(
    axis: int, ends: Tensor, candidates: Tensor, ids: Tensor, inverse: Tensor, silhouette: Tensor, measured: Tensor
) -> Crossings:
    """The crossings of links along one axis; ``p`` runs across the links, ``q`` along them."""
    size_p, size_q = (ids.shape[2], ids.shape[1]) if axis == 0 else (ids.shape[1], ids.shape[2])
    p, q = ends[..., axis], ends[..., 1 - axis]  # (B, E, 2)
    p_low, p_high = p.amin(2), p.amax(2)
    first = (p_low - 0.5).ceil().clamp(min=0)
    last = ((p_high - 0.5).ceil() - 1).clamp(max=size_p - 1)
    counts = torch.where(candidates & (p_low < p_high), (last - first + 1).clamp(min=0), 0).long()
    batch, edge = counts.nonzero(as_tuple=True)
    counts = counts[batch, edge]
    which = torch.arange(len(counts), device=ids.device).repeat_interleave(counts)
    number = torch.arange(len(which), device=ids.device) - (counts.cumsum(0) - counts)[which]
    batch, edge = batch[which], edge[which]
    place = first[batch, edge].long() + number
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
    visible = torch.where(gap, silhouette[batch, edge] & (w >= (low + high) / 2), w >= (1 - TOUCHING) * low)
    visible &= high > 0
    at = position - k
    rank = torch.where(gap, torch.where(here > there, at, 1 - at), w)
    link = (batch * ids.shape[1] + row) * ids.shape[2] + col
    index = visible.nonzero().squeeze(1)
    index = index[argmax_at(link[index], rank[index], ids.numel())]
    axes = torch.full_like(link, axis)
    return Crossings(batch, axes, row, col, at, slope, measured[batch, edge], edge, part).select(index)


def argmax_at(place: Tensor, rank: Tensor, size: int) -> Tensor:
    """Indices of the entries with the highest rank (N,) ≥ 0 at each place (N,), the first of several equal ones."""
    best = rank.new_full((size,), -1).scatter_reduce(0, place, rank, "amax")
    equal = (rank == best[place]).nonzero().squeeze(1)
    number = place.new_full((size,), len(place)).scatter_reduce(0, place[equal], equal, "amin")
    return number[number < len(place)]


def antialias(
    samples: Tensor,
    ids: Tensor,
    inverse: Tensor,
    crossings: Crossings,
    screen: Tensor,
    motion: Tensor,
    edges: Edges,
    faces: Tensor,
    supersampling: int,
) -> Tensor:
    """Samples (B, s H, s W), s the supersampling, to pixels (B, H, W): means, with visible edges where they cross.

    Differentiable in ``samples``; linear in ``motion``, the change of ``screen`` (B, V, 3), of which images change by
    the derivative.
    """
    image = torch.nn.functional.avg_pool2d(samples[:, None], supersampling)[:, 0]
    for axis in (0, 1):
        size = samples.shape[1 + axis] - 1
        difference = samples.narrow(1 + axis, 1, size) - samples.narrow(1 + axis, 0, size)
        touching = (ids >= 0).narrow(1 + axis, 0, size) | (ids >= 0).narrow(1 + axis, 1, size)  # links of the object
        on_axis = crossings.select(crossings.axis == axis)
        crossed = torch.zeros_like(touching)
        crossed[on_axis.batch, on_axis.row, on_axis.col] = True
        moving = on_axis.select(on_axis.measured & touching[on_axis.batch, on_axis.row, on_axis.col])
        image = _move_edges(image, axis, difference, moving, motion, edges, supersampling)
        # links without an edge: their middle moves with the surface in front
        n, row, col = ((difference != 0) & touching & ~crossed).nonzero().T
        row2, col2 = row + (axis == 0), col + (axis == 1)
        nearer = inverse[n, row2, col2] > inverse[n, row, col]
        corners = faces[torch.where(nearer, ids[n, row2, col2], ids[n, row, col])]
        moved = surface_motion(screen, motion, corners, n, (col + col2 + 1) / 2, (row + row2 + 1) / 2)[:, 1 - axis]
        change = -difference.detach()[n, row, col] * (1 / supersampling**2) / 2 * moved
        image = image.index_put((n, row // supersampling, col // supersampling), change, accumulate=True)
        image = image.index_put((n, row2 // supersampling, col2 // supersampling), change, accumulate=True)
    return image


def _move_edges(
    image: Tensor, axis: int, difference: Tensor, moving: Crossings, motion: Tensor, edges: Edges, supersampling: int
) -> Tensor:
    """Moves the boundary of links with an edge to the crossing; its derivative is that of the edge's motion."""
    share, across = 1 / supersampling**2, difference[moving.batch, moving.row, moving.col]
    after = (moving.at >= 0.5).long()
    row, col = moving.row + after * (axis == 0), moving.col + after * (axis == 1)
    pixel = (moving.batch, row // supersampling, col // supersampling)
    image = image.index_put(pixel, (0.5 - moving.at) * across * share, accumulate=True)
    ends = motion[moving.batch[:, None], edges.ends[moving.edge]]
    moved = torch.lerp(ends[:, 0], ends[:, 1], moving.part[:, None])
    # by which the edge moves along the link: this share of a sample changes sides
    advance = moved[:, 1 - axis] - moving.slope * moved[:, axis]
    return image.index_put(pixel, -across.detach() * share * advance, accumulate=True)


def surface_motion(screen: Tensor, motion: Tensor, corners: Tensor, batch: Tensor, x: Tensor, y: Tensor) -> Tensor:
    """Motion on the screen (N, 2) of points of a surface, given that of the corners of its triangles.

    With β the barycentric coordinates of a point u on the screen, u = Σ β u_k.  A point fixed on the surface keeps
    coordinates proportional to β times 1 / depth, so that du = Σ β (du_k - (u_k - u) dw_k / w_k).

    Args:
        screen, motion: (B, V, 3), x, y and w = 1 / depth, and their change.
        corners: (N, 3), the triangles' vertices.
        batch, x, y: (N,), the image and the points.
    """
    at = screen.detach()[batch[:, None], corners]
    weights = barycentric(at, corners, x, y)
    # half a sample beyond the silhouette of a triangle seen from the side is far away in its plane
    weights = normalize_weights(weights.clamp(min=-0.5))
    point = torch.stack([x, y], 1)
    change = motion[batch[:, None], corners]
    across = at[..., :2] - point[:, None]
    return (weights[..., None] * (change[..., :2] - across * (change[..., 2:] / at[..., 2:]))).sum(1)
