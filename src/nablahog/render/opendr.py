"""OpenDR's approximate derivatives, the paper's renderer (``opendr/common.py``, ``opendr/renderer.py``).

The image is what a triangle shows at each sample, outlines drawn over it one sample wide.  The derivative at a covered
sample is minus the image's own difference there, times the motion of the triangle it shows: inside, the mean of the
one-sided differences that touch no outline; on an outline, twice the central difference of the image, because a
boundary counts once though its difference spreads over two samples.  Uncovered samples have no derivative, nor has
what an outline hides.

OpenDR draws outlines with OpenGL's lines; here a sample is on an outline if an edge crosses the half of the link that
is next to it.
"""

from __future__ import annotations

import torch
from torch import Tensor

from .edges import Crossings, highest, surface_motion


def overdraw(found: Crossings, outline: Tensor, *pictures: Tensor) -> tuple[Tensor, tuple[Tensor, ...]]:
    """Which samples are on an outline, and ``pictures`` with the surface in front drawn there.

    Args:
        found: of :func:`.edges.crossings`.
        outline: (B, E), which edges are outlines.
        pictures: (B, H, W) each, the first of them 1 / depth.
    """
    kept = found.measured & outline[found.batch, found.edge]
    found = Crossings(*(field[kept] for field in found))
    down = found.axis == 0
    second = found.row + down.long(), found.col + (~down).long()
    inverse = pictures[0]
    nearer = inverse[found.batch, second[0], second[1]] > inverse[found.batch, found.row, found.col]
    row, col = torch.where(nearer, second[0], found.row), torch.where(nearer, second[1], found.col)
    after = found.at >= 0.5
    to_row, to_col = torch.where(after, second[0], found.row), torch.where(after, second[1], found.col)
    # of several outlines through one sample the nearest is seen
    place = (found.batch * inverse.shape[1] + to_row) * inverse.shape[2] + to_col
    front = inverse[found.batch, row, col]
    best = highest(place, front, inverse.numel())
    source = found.batch[best], row[best], col[best]
    target = found.batch[best], to_row[best], to_col[best]
    on_outline = torch.zeros_like(inverse, dtype=torch.bool)
    on_outline[target] = True
    return on_outline, tuple(picture.index_put(target, picture[source]) for picture in pictures)


def differences(samples: Tensor, on_outline: Tensor) -> tuple[Tensor, Tensor]:
    """The image's derivative along x and y, per sample, each (B, H, W), as above."""
    return _difference(samples, on_outline, 2), _difference(samples, on_outline, 1)


def _difference(samples: Tensor, on_outline: Tensor, dim: int) -> Tensor:
    size = samples.shape[dim]
    step = samples.diff(dim=dim)
    usable = ~(on_outline.narrow(dim, 1, size - 1) | on_outline.narrow(dim, 0, size - 1))
    zero = torch.zeros_like(samples.narrow(dim, 0, 1))
    before, after = torch.cat([zero, step], dim), torch.cat([step, zero], dim)
    no = torch.zeros_like(on_outline.narrow(dim, 0, 1))
    has_before, has_after = torch.cat([no, usable], dim), torch.cat([usable, no], dim)
    number = has_before.to(samples.dtype) + has_after.to(samples.dtype)
    one_sided = torch.where(has_before, before, 0) + torch.where(has_after, after, 0)
    # a central difference is half the sum of both steps, and counts twice
    return torch.where(number > 0, one_sided / number.clamp(min=1), before + after)


def blend(samples: Tensor, ids: Tensor, on_outline: Tensor, screen: Tensor, faces: Tensor, step: int) -> Tensor:
    """Samples (B, H · step, W · step) to pixels (B, H, W): means; differentiable as :func:`.edges.blend`."""
    image = torch.nn.functional.avg_pool2d(samples[:, None], step)[:, 0]
    along_x, along_y = differences(samples.detach(), on_outline)
    place = ((ids >= 0) & ((along_x != 0) | (along_y != 0))).nonzero()
    n, row, col = place.T
    way = surface_motion(screen, screen - screen.detach(), faces[ids[n, row, col]], n, col + 0.5, row + 0.5)
    change = -(along_x[n, row, col] * way[:, 0] + along_y[n, row, col] * way[:, 1]) / step**2
    return image.index_put((n, row // step, col // step), change, accumulate=True)
