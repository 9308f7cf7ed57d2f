"""OpenDR's approximate derivative, that of the paper's renderer (``opendr/common.py``, ``opendr/renderer.py``).

The image shows at each sample what its triangle shows, with silhouette edges drawn over it one sample wide.  The
derivative at a covered sample is minus the image gradient there, times the motion of the sample's triangle.  The image
gradient is the mean of the one-sided differences that touch no silhouette.  On a silhouette it is twice the central
difference, because the difference of one boundary spreads over two samples.  Uncovered samples have derivative 0, and
so has what a silhouette hides.

OpenDR draws silhouettes with OpenGL's lines; here a sample is on a silhouette if an edge crosses the half of a link
that is next to it.

Source: Loper and Black, OpenDR: An Approximate Differentiable Renderer (ECCV 2014), and its code.
"""

from __future__ import annotations

import torch
from torch import Tensor

from .edge_gradient import Crossings, argmax_at, surface_motion


def draw_silhouettes(crossings: Crossings, silhouette: Tensor, *images: Tensor) -> tuple[Tensor, tuple[Tensor, ...]]:
    """Draws silhouette edges one sample wide, with the surface in front.

    Args:
        crossings: of :func:`.edge_gradient.edge_crossings`.
        silhouette: (B, E), which edges are silhouettes.
        images: (B, H, W) each, to draw over; the first of them is 1 / depth.

    Returns:
        The samples drawn, (B, H, W), bool, and the images.
    """
    crossings = crossings.select(crossings.measured & silhouette[crossings.batch, crossings.edge])
    batch, row1, col1 = crossings.batch, crossings.row, crossings.col
    down = crossings.axis == 0
    row2, col2 = row1 + down.long(), col1 + (~down).long()
    inverse = images[0]
    nearer = inverse[batch, row2, col2] > inverse[batch, row1, col1]
    row, col = torch.where(nearer, row2, row1), torch.where(nearer, col2, col1)
    after = crossings.at >= 0.5
    to_row, to_col = torch.where(after, row2, row1), torch.where(after, col2, col1)
    # where several silhouettes meet in a sample, the nearest is visible
    sample = (batch * inverse.shape[1] + to_row) * inverse.shape[2] + to_col
    best = argmax_at(sample, inverse[batch, row, col], inverse.numel())
    source = batch[best], row[best], col[best]
    target = batch[best], to_row[best], to_col[best]
    drawn = torch.zeros_like(inverse, dtype=torch.bool)
    drawn[target] = True
    return drawn, tuple(image.index_put(target, image[source]) for image in images)


def image_gradient(samples: Tensor, drawn: Tensor) -> tuple[Tensor, Tensor]:
    """The image gradient along x and y at each sample, each (B, H, W), with silhouettes ``drawn``; see above."""
    return _difference(samples, drawn, 2), _difference(samples, drawn, 1)


def _difference(samples: Tensor, drawn: Tensor, dim: int) -> Tensor:
    size = samples.shape[dim]
    step = samples.diff(dim=dim)
    usable = ~(drawn.narrow(dim, 1, size - 1) | drawn.narrow(dim, 0, size - 1))
    zero = torch.zeros_like(samples.narrow(dim, 0, 1))
    before, after = torch.cat([zero, step], dim), torch.cat([step, zero], dim)
    no = torch.zeros_like(drawn.narrow(dim, 0, 1))
    has_before, has_after = torch.cat([no, usable], dim), torch.cat([usable, no], dim)
    number = has_before.to(samples.dtype) + has_after.to(samples.dtype)
    one_sided = torch.where(has_before, before, 0) + torch.where(has_after, after, 0)
    # the central difference is half of before + after, and counts twice
    return torch.where(number > 0, one_sided / number.clamp(min=1), before + after)


def resolve(
    samples: Tensor, ids: Tensor, drawn: Tensor, screen: Tensor, motion: Tensor, faces: Tensor, step: int
) -> Tensor:
    """Samples (B, H · step, W · step) to pixels (B, H, W): means.

    Differentiable in ``samples`` and linear in ``motion`` as :func:`.edge_gradient.antialias` is.
    """
    image = torch.nn.functional.avg_pool2d(samples[:, None], step)[:, 0]
    along_x, along_y = image_gradient(samples.detach(), drawn)
    place = ((ids >= 0) & ((along_x != 0) | (along_y != 0))).nonzero()
    n, row, col = place.T
    moved = surface_motion(screen, motion, faces[ids[n, row, col]], n, col + 0.5, row + 0.5)
    change = -(along_x[n, row, col] * moved[:, 0] + along_y[n, row, col] * moved[:, 1]) / step**2
    return image.index_put((n, row // step, col // step), change, accumulate=True)
