"""Random triangles: a derivative-free search that HOGgles' authors publish beside their method.

Vondrick et al., *HOGgles* (ICCV 2013): a triangle of random place, size, direction and brightness is added to the
image, and accepted if that lowers the distance of the descriptors.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import torch
from torch import Tensor

from ...hog.descriptor import hog
from ...hog.spec import HOGSpec
from ...invert.checks import check_descriptor
from ...invert.objective import squared_norm
from ...invert.reconstruction import Reconstruction, relative_distance

TRIANGLES = 10_000
_SIDE = 4  # cells: the largest width and height of a triangle
_BRIGHTNESS = 0.25  # the largest change of gray by a triangle
_BATCH = 128  # triangles drawn at a time


@torch.no_grad()
def reconstruct_by_triangles(
    descriptor: Tensor,
    spec: HOGSpec,
    image_size: tuple[int, int] | None = None,
    *,
    seed: int = 0,
    triangles: int = TRIANGLES,
    progress: Callable[[int, int], None] | None = None,
) -> Reconstruction:
    """Images made of triangles on middle gray.

    The authors try triangles for a day, 25 a second; here a number of triangles is tried.

    Args:
        descriptor: (B, rows, cols, channels), float32 or float64.
        spec: the dialect that made it.
        image_size: (height, width); by default whole cells.
        seed: of the triangles, the same for every image of the batch.
        triangles: how many are tried, at least 1.
        progress: called with the triangles tried and all of them.

    Returns:
        Images in 0…1; one evaluation is one triangle, which takes no derivative.

    Raises:
        TypeError, ValueError: as :func:`nablahog.reconstruct`, or there are no triangles to try.
    """
    began = time.perf_counter()
    height, width = check_descriptor(descriptor, spec, image_size)
    if triangles < 1:
        raise ValueError(f"there must be at least one triangle to try, got {triangles}")
    descriptor = descriptor.detach()
    images = torch.full((len(descriptor), 1, height, width), 0.5).to(descriptor)
    scale = squared_norm(descriptor).sqrt()
    best = (hog(images, spec) - descriptor).flatten(1).norm(dim=1)
    history = []
    generator = torch.Generator().manual_seed(seed)
    for number, triangle in enumerate(_triangles(triangles, height, width, spec.cell_size, generator)):
        candidate = (images + triangle.to(images)).clamp(0, 1)
        distance = (hog(candidate, spec) - descriptor).flatten(1).norm(dim=1)
        closer = distance < best
        images = torch.where(closer.reshape(-1, 1, 1, 1), candidate, images)
        best = torch.where(closer, distance, best)
        history.append(best / scale)
        if progress is not None:
            progress(number + 1, triangles)
    return Reconstruction(
        images,
        relative_distance(images, descriptor, spec),
        ["all triangles were tried"] * len(images),
        torch.stack(history),
        torch.full((len(images),), triangles),
        time.perf_counter() - began,
    )


def _triangles(
    count: int, height: int, width: int, cell: tuple[int, int], generator: torch.Generator
) -> Iterator[Tensor]:
    """``count`` images (height, width) of one triangle each, 0 elsewhere."""
    rows, cols = torch.arange(height) + 0.5, torch.arange(width) + 0.5
    while count > 0:
        drawn = min(count, _BATCH)
        count -= drawn
        turn, rel_width, rel_height, x, y, brightness = torch.rand((6, drawn), generator=generator)
        # half a square, rotated, then stretched to its bounding box
        corners = torch.tensor([[-1.0, -1], [1, -1], [1, 1]])
        cos, sin = torch.cos(2 * torch.pi * turn), torch.sin(2 * torch.pi * turn)
        rotated = torch.stack([cos, -sin, sin, cos], dim=1).reshape(-1, 2, 2) @ corners.T  # (drawn, 2, 3)
        extent = (cos.abs() + sin.abs())[:, None, None]
        size = torch.stack([1 + rel_width * _SIDE * cell[1], 1 + rel_height * _SIDE * cell[0]], dim=1)[..., None]
        middle = torch.stack([x * width, y * height], dim=1)[..., None]
        across, down = (middle + size / 2 * rotated / extent).unbind(1)
        inside = torch.ones((drawn, height, width), dtype=torch.bool)
        for k in range(3):
            x0, y0, x1, y1 = across[:, k], down[:, k], across[:, (k + 1) % 3], down[:, (k + 1) % 3]
            side = (x1 - x0)[:, None, None] * (rows[:, None] - y0[:, None, None]) - (y1 - y0)[:, None, None] * (
                cols - x0[:, None, None]
            )
            inside &= side >= 0
        yield from inside * (2 * brightness[:, None, None] - 1) * _BRIGHTNESS
