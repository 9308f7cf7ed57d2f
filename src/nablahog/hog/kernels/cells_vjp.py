"""The vjp of Eq. 1-6 in one pass: gradients with respect to cell histograms to gradients with respect to images.

Votes are recomputed, which takes less time than fetching them from memory.  A ring buffer of three rows holds gradients
with respect to Gx and Gy: a row of the image depends on its own and both beside it.
"""

from __future__ import annotations

from typing import NamedTuple

from ...runtime.arrays import DType, Floats
from ...runtime.compile import borrowing
from ...runtime.simd import PADDING, whole_vectors
from .cells import rows_at_once
from .gradient_loops import Gradients, gradients_of_rows, new_gradients, padded
from .gradient_vjp import (
    PlaneGradients,
    Ring,
    border_vjp,
    hard_votes_vjp,
    new_plane_gradients,
    new_ring,
    ring_line,
    row_vjp,
    votes_vjp,
)
from .norm_simd import copy
from .parameters import Pixels, Plan, Voting
from .pooling_vjp import (
    CellGradients,
    VoteGradients,
    new_cell_gradients,
    new_vote_gradients,
    votes_gradient,
    wrap_bins,
)
from .votes import Votes, linear_votes, new_votes, vote


class BandVjp(NamedTuple):
    """Workspace: what is recomputed of a band, or known of the gradients with respect to it.

    ``exact`` and ``grad_exact`` are empty unless votes are by a library's angle: then these are by the exact one.
    """

    gradients: Gradients
    votes: Votes
    exact: Votes
    grad_cells: CellGradients
    grad_votes: VoteGradients
    grad_exact: VoteGradients
    grad_planes: PlaneGradients
    ring: Ring


def new_band_vjp(plan: Plan, width: int, dtype: DType) -> BandVjp:
    """For images of that width."""
    rows = plan.pooling.most_rows
    size = rows * whole_vectors(width) + PADDING
    exact = size if plan.voting.library_angle else 0
    return BandVjp(
        new_gradients(plan.reading, width, rows, dtype),
        new_votes(size, dtype),
        new_votes(exact, dtype),
        new_cell_gradients(plan.pooling, dtype),
        new_vote_gradients(size, dtype),
        new_vote_gradients(exact, dtype),
        new_plane_gradients(size, dtype),
        new_ring(plan.reading, width, dtype),
    )


@borrowing
def _recompute(pixels: Pixels, start: int, plan: Plan, begin: int, end: int, last_read: int, band: BandVjp) -> int:
    """Gradients and votes of rows of a band; returns the last row that was read."""
    stride, gradients, votes, exact = padded(pixels.width), band.gradients, band.votes, band.exact
    few = rows_at_once(stride)
    for first in range(begin, end, few):
        last = min(first + few, end)
        at = (first - begin) * stride
        last_read = gradients_of_rows(pixels, start, plan.reading, first, last, last_read, gradients, at)
        rows = slice(at, at + (last - first) * stride)
        gx, gy = gradients.gx[rows], gradients.gy[rows]
        vote(gx, gy, plan.voting, votes.m[rows], votes.f[rows], votes.bins[rows])
        if plan.voting.library_angle:
            linear_votes(gx, gy, plan.voting, exact.m[rows], exact.f[rows], exact.bins[rows])
    return last_read


@borrowing
def _pooling_vjp(grad_cells: Floats, k: int, plan: Plan, stride: int, first: int, rows: int, band: BandVjp) -> None:
    """Gradients of the votes of the k-th band, of ``rows`` from the ``first`` on."""
    pooling = plan.pooling
    wrap_bins(grad_cells, pooling, k, band.grad_cells.cells)
    votes_gradient(band.grad_cells, band.votes.bins, stride, first, rows, pooling, band.grad_votes)
    if plan.voting.library_angle:
        votes_gradient(band.grad_cells, band.exact.bins, stride, first, rows, pooling, band.grad_exact)


@borrowing
def _voting_vjp(voting: Voting, size: int, band: BandVjp) -> None:
    """Gradients of Gx and Gy of the first ``size`` elements of the band's planes."""
    gx, gy = band.gradients.gx[:size], band.gradients.gy[:size]
    if voting.hard:
        hard_votes_vjp(band.votes, band.grad_votes, gx, gy, band.grad_planes)
    elif voting.library_angle:
        exact = band.exact, band.grad_exact
        votes_vjp(band.votes, band.grad_votes, *exact, gx, gy, voting.slope, band.grad_planes)
    else:
        votes = band.votes, band.grad_votes
        votes_vjp(*votes, *votes, gx, gy, voting.slope, band.grad_planes)


@borrowing
def cells_vjp_of_images(
    pixels: Pixels,
    plan: Plan,
    grad_cells: Floats,
    images: tuple[int, int],
    rows: tuple[int, int],
    band: BandVjp,
    grad_images: Floats,
) -> None:
    """Rows (first, last) of images (first, last), to ``grad_images`` (images, channels · height · width).

    ``grad_cells`` is (images, rows · cols · bins).
    """
    height, width, reading, pooling = pixels.height, pixels.width, plan.reading, plan.pooling
    stride, line = padded(width), ring_line(width)
    ring = band.ring
    of_x, of_y, ring_x, ring_y = band.grad_planes.gx, band.grad_planes.gy, ring.gx, ring.gy
    begin, end = rows
    for image in range(images[0], images[1]):
        start, out = image * pixels.strides[0], grad_images[image]
        ring_x[:] = 0
        ring_y[:] = 0
        row, last_read = max(begin - 1, 0), -1
        while row < end + 1:  # with the rows beside those wanted; below the image there is nothing
            k = pooling.band_of[row] if row < height else -1
            stop = row + 1 if k < 0 else min(pooling.bands[k, 1], end + 1)
            if k >= 0:
                last_read = _recompute(pixels, start, plan, row, stop, last_read, band)
                _pooling_vjp(grad_cells[image], k, plan, stride, row, stop - row, band)
                _voting_vjp(plan.voting, (stop - row) * stride, band)
            for y in range(row, stop):
                at, to = (y - row) * stride, y % 3 * line
                if k >= 0:
                    copy(of_x, at, width, ring_x, to + 1)
                    copy(of_y, at, width, ring_y, to + 1)
                    border_vjp(ring_x, ring_y, to, width, y, height, reading.border_factor)
                    if ring.channel_gx.size > 0:
                        copy(band.gradients.winner, at, width, ring.winner, to + 1)
                else:
                    ring_x[to : to + width + 2] = 0
                    ring_y[to : to + width + 2] = 0
                if y - 1 >= begin:
                    row_vjp(pixels, start, y - 1, reading, ring, out)
            row = stop
