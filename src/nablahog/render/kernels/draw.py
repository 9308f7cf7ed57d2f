"""All steps of a rendering, pose after pose."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...runtime.compile import compiled
from .overdraw import overdraw, pool
from .picture import blend, outlines, shade, visible_edges
from .visibility import frame, project, visibility


@compiled
def draw(
    vertices: Any,
    faces: Any,
    corners: Any,
    ends: Any,
    kind: Any,
    planes: Any,
    turns: Any,
    distances: Any,
    eyes: Any,
    middles: Any,
    focal: Any,
    near: Any,
    nearest: Any,
    step: int,
    smooth: bool,
    first: int,
    every: int,
    images: Any,
    motions: Any,
    cut: Any,
    ids: Any,
    inverse: Any,
    samples: Any,
    slots: Any,
    places: Any,
    crossings: Any,
    followed: Any,
) -> None:
    """Draws an object at every ``every``-th pose from the ``first`` on over ``images``.

    Args:
        vertices: (V, 3); faces, corners: (F, 3), and the brightness there; ends, kind: of :class:`..topology.Edges`;
            planes: (2, 4, E), as for :func:`.picture.outlines`.
        turns, distances: (B, 3, 3) and (B,): into the camera's frame; eyes: (B, 3), the camera in the object's frame.
        middles: (B, 2), x and y of the principal point; focal: both in samples.
        near: (B,): poses at which a vertex is no farther are marked in ``cut`` (B,), and left out.
        nearest: (B,): vertices that are nearer are not seen, nor is what has them for corners.
        step: samples of a pixel along a side.
        smooth: by :func:`.picture.blend`, else as OpenDR.
        images, motions: (B, H, W) and (B, 4 or 0, H, W).
        others: scratch, flat, for all samples of an image, and for as many edges as there is room.
    """
    screen = np.empty((vertices.shape[0], 3), vertices.dtype)
    by_face = np.empty((faces.shape[0], 7), vertices.dtype)
    outlined, listed = np.empty((len(eyes[first::every]), kind.size), np.uint8), np.empty(kind.size, np.int32)
    outlines(planes, kind, eyes[first::every], outlined)
    box, whole, corner = np.empty(4, np.int64), np.zeros(4, np.int64), np.empty(2, np.int64)
    if faces.shape[0] == 0:
        return
    for b in range(first, images.shape[0], every):
        if project(vertices, turns[b], distances[b], focal, middles[b], nearest[b], screen) <= near[b]:
            cut[b] = True
            continue
        frame(screen, step, images.shape[1], images.shape[2], box)
        if box[0] >= box[1] or box[2] >= box[3]:
            continue
        corner[0], corner[1] = box[0], box[2]
        height, width = (box[1] - box[0]) * step, (box[3] - box[2]) * step
        whole[1], whole[3] = height, width
        size = height * width
        i, w = ids[:size].reshape(height, width), inverse[:size].reshape(height, width)
        s, k = samples[:size].reshape(height, width), slots[: 2 * size].reshape(2, height, width)
        visibility(screen, faces, whole, i, w)
        shade(screen, faces, corners, i, w, images[b], corner, step, by_face, s)
        outline = outlined[b // every]
        count = visible_edges(screen, ends, kind, outline, listed, w, k, places, crossings, followed)
        if smooth:
            blend(s, i, w, k, places, crossings, count, corner, step, images[b], motions[b])
        else:
            overdraw(s, w, outline, k, places, crossings, followed, count)
            pool(s, w, k[0], corner, step, images[b], motions[b])
