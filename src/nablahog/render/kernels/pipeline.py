"""All steps of a rendering, pose after pose."""

from __future__ import annotations

import numpy as np

from ...runtime.compile import compiled
from .antialias import antialias
from .arrays import Crossings, EdgeArrays, Images, MeshArrays, Pixels, PoseArrays, Samples
from .opendr import draw_silhouettes, resolve
from .rasterize import bounding_box, project, rasterize
from .shade import shade
from .silhouettes import edge_crossings, silhouette_edges


@compiled
def render_poses(
    mesh: MeshArrays,
    edges: EdgeArrays,
    poses: PoseArrays,
    focal: float,
    step: int,
    antialiased: bool,
    first: int,
    stride: int,
    target: Images,
    scratch: Samples,
    crossed: Crossings,
) -> None:
    """Renders a mesh over ``target.image`` at the poses ``first``, ``first + stride``, ….

    Args:
        mesh, edges, poses: of the object and its views.
        focal: focal length in samples.
        step: samples of a pixel along a side.
        antialiased: by :func:`.antialias.antialias`, else as OpenDR does.
        first, stride: so that several threads share the poses out.
        target: gets the images.
        scratch, crossed: memory, flat, for all samples of an image, and for as many crossings as there is room.
    """
    vertices, faces, kind = mesh.vertices, mesh.faces, edges.kind
    eyes = poses.eye[first::stride]
    screen = np.empty((vertices.shape[0], 3), vertices.dtype)
    gradients = np.empty((faces.shape[0], 7), vertices.dtype)
    silhouettes, candidates = np.empty((len(eyes), kind.size), np.uint8), np.empty(kind.size, np.int32)
    silhouette_edges(edges, eyes, silhouettes)
    box, all_samples, corner = np.empty(4, np.int64), np.zeros(4, np.int64), np.empty(2, np.int64)
    if faces.shape[0] == 0:
        return
    for b in range(first, target.image.shape[0], stride):
        depth = project(
            vertices, poses.rotation[b], poses.distance[b], focal, poses.centre[b], poses.nearest[b], screen
        )
        if depth <= poses.near[b]:
            target.clipped[b] = True
            continue
        bounding_box(screen, step, target.image.shape[1], target.image.shape[2], box)
        if box[0] >= box[1] or box[2] >= box[3]:
            continue
        corner[0], corner[1] = box[0], box[2]
        height, width = (box[1] - box[0]) * step, (box[3] - box[2]) * step
        all_samples[1], all_samples[3] = height, width
        size = height * width
        samples = Samples(
            scratch.ids[:size].reshape(height, width),
            scratch.inverse[:size].reshape(height, width),
            scratch.brightness[:size].reshape(height, width),
        )
        number = crossed.number[: 2 * size].reshape(2, height, width)
        crossings = Crossings(number, crossed.link, crossed.values, crossed.edge)
        pixels, silhouette = Pixels(target.image[b], target.screen_gradient[b], corner, step), silhouettes[b // stride]
        rasterize(screen, faces, all_samples, samples.ids, samples.inverse)
        shade(screen, mesh, pixels, gradients, samples)
        count = edge_crossings(screen, edges, silhouette, candidates, samples.inverse, crossings)
        if antialiased:
            antialias(samples, crossings, count, pixels)
        else:
            draw_silhouettes(samples, silhouette, crossings, count)
            resolve(samples, number[0], pixels)
