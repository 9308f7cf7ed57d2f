"""The rendering in PyTorch, on any device, differentiable in everything; the native loops are tested against it.

Its steps: clipping and rasterisation (:mod:`.rasterize`), shading, and, of the two methods, either anti-aliasing
(:mod:`.edge_gradient`) or OpenDR's approximate derivative, that of the paper's renderer (``opendr/common.py``,
``opendr/renderer.py``), which is here.

OpenDR's image shows at each sample what its triangle shows, with silhouette edges drawn over it one sample wide.  The
derivative at a covered sample is minus the image gradient there, times the motion of the sample's triangle.  The image
gradient is the mean of the one-sided differences that touch no silhouette.  On a silhouette it is twice the central
difference, because the difference of one boundary spreads over two samples.  Uncovered samples have derivative 0, and
so has what a silhouette hides.  OpenDR draws silhouettes with OpenGL's lines; here a sample is on a silhouette if an
edge crosses the half of a link that is next to it.

Source: Loper and Black, OpenDR: An Approximate Differentiable Renderer (ECCV 2014), and its code.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d, pad

from .camera import Camera, to_camera, to_screen
from .edge_gradient import Crossings, antialias, argmax_at, edge_crossings, silhouette_edges, surface_motion
from .mesh import Mesh
from .rasterize import NEAR, barycentric, clip_to_view, group_cut_views, normalize_weights, rasterize
from .surface import Edges


def render_torch(
    mesh: Mesh,
    brightness: Tensor,
    edges: Edges,
    poses: Tensor,
    camera: Camera,
    background: Tensor,
    supersampling: int,
    method: str,
    by_motion: bool = False,
) -> Tensor:
    """Images (B, 1, H, W) of a mesh at poses (B, 6) over backgrounds (1 or B, H, W), which decide the dtype.

    Where several edges meet in a pixel their areas may add up to more than it has: images may leave 0…1.

    Args:
        mesh: its vertices and faces.
        brightness: (F, 3), at the corners of each face.
        edges: of the mesh.
        poses, camera, background: the view.
        supersampling: samples of a pixel along a side.
        method: "edges" or "opendr".
        by_motion: whether four more channels are wanted, the screen gradient of :class:`.renderer.Rendering`.
    """
    points, faces = to_camera(mesh.vertices, poses), mesh.faces
    near = (1 - 1e-6) * NEAR * poses.detach()[:, None, 2:3]
    if len(poses) == 1:
        points, faces, brightness = clip_to_view(points, faces, brightness, poses[:, 2])
    elif bool((cut := (points[..., 2:] <= near).flatten(1).any(1)).any()):
        groups, order = group_cut_views(cut)
        behind = background.expand(len(poses), -1, -1)
        images = [
            render_torch(mesh, brightness, edges, poses[g], camera, behind[g], supersampling, method, by_motion)
            for g in groups
        ]
        return torch.cat(images)[order]
    beside = points[..., 2:].abs() < 1e-3 * near  # not drawn; their 1 / depth may be infinite, without derivative
    screen = to_screen(torch.where(beside, -1.0, points), poses, camera)
    screen = torch.cat([screen[..., :2] * supersampling, screen[..., 2:]], dim=-1).to(background.dtype)

    ids, inverse = rasterize(screen, faces, camera.height * supersampling, camera.width * supersampling)
    samples = _shade(ids, screen, faces, brightness, background.expand(len(poses), -1, -1), supersampling)
    crossings = edge_crossings(screen, edges, ids, inverse)
    if method == "opendr":
        silhouette = silhouette_edges(screen.detach(), edges)
        drawn, (inverse, samples, ids) = draw_silhouettes(crossings, silhouette, inverse, samples, ids)

    def draw_moved(motion: Tensor) -> Tensor:
        if method == "edges":
            return antialias(samples, ids, inverse, crossings, screen, motion, edges, faces, supersampling)
        return resolve(samples, ids, drawn, screen, motion, faces, supersampling)

    image = draw_moved(screen - screen.detach())  # the motion is 0; only its derivative matters
    if not by_motion:
        return image[:, None]
    w = screen[..., 2:]
    zero, pixel = torch.zeros_like(w), torch.full_like(w, supersampling)
    motions = [pixel, zero, zero], [supersampling * w, zero, zero], [zero, pixel, zero], [zero, supersampling * w, zero]
    return torch.stack([image, *(draw_moved(torch.cat(motion, 2)) - image for motion in motions)], 1)


def _shade(
    ids: Tensor, screen: Tensor, faces: Tensor, brightness: Tensor, background: Tensor, supersampling: int
) -> Tensor:
    """Brightness of the samples (B, s H, s W), perspective-correct between the corners of each triangle."""
    samples = background.repeat_interleave(supersampling, 1).repeat_interleave(supersampling, 2)
    place = (ids >= 0).nonzero(as_tuple=True)
    face = ids[place]
    at = screen.detach()[place[0][:, None], faces[face]]
    weights = barycentric(at, faces[face], place[2] + 0.5, place[1] + 0.5) * at[..., 2]
    weights = normalize_weights(weights.clamp(min=0))[:, 1:]
    bright = brightness[face].to(samples)
    first = bright[:, :1]  # keeps a face of one brightness exactly so
    return samples.index_put(place, (first + (weights * (bright[:, 1:] - first)).sum(1, keepdim=True)).squeeze(1))


def draw_silhouettes(crossings: Crossings, silhouette: Tensor, *images: Tensor) -> tuple[Tensor, tuple[Tensor, ...]]:
    """Draws silhouette edges (B, E) one sample wide, with the surface in front, over images (B, H, W) each.

    The first image is 1 / depth.  Returns the samples drawn, (B, H, W), bool, and the images.
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


def _image_gradient(samples: Tensor, drawn: Tensor) -> Tensor:
    """The image gradient along x at each sample, (B, H, W), with silhouettes ``drawn``; see above."""
    difference, usable = samples.diff(dim=2), ~(drawn[..., 1:] | drawn[..., :-1])
    before, after = pad(difference, (1, 0)), pad(difference, (0, 1))
    has_before, has_after = pad(usable, (1, 0)), pad(usable, (0, 1))
    number = has_before.to(samples.dtype) + has_after.to(samples.dtype)
    one_sided = torch.where(has_before, before, 0) + torch.where(has_after, after, 0)
    # the central difference is half of before + after, and counts twice
    return torch.where(number > 0, one_sided / number.clamp(min=1), before + after)


def resolve(
    samples: Tensor, ids: Tensor, drawn: Tensor, screen: Tensor, motion: Tensor, faces: Tensor, supersampling: int
) -> Tensor:
    """Samples (B, s H, s W), s the supersampling, to pixels (B, H, W): means.

    Differentiable in ``samples`` and linear in ``motion`` as :func:`.edge_gradient.antialias` is.
    """
    image = avg_pool2d(samples[:, None], supersampling)[:, 0]
    still = samples.detach()
    along_x, along_y = _image_gradient(still, drawn), _image_gradient(still.mT, drawn.mT).mT
    place = ((ids >= 0) & ((along_x != 0) | (along_y != 0))).nonzero()
    n, row, col = place.T
    moved = surface_motion(screen, motion, faces[ids[n, row, col]], n, col + 0.5, row + 0.5)
    change = -(along_x[n, row, col] * moved[:, 0] + along_y[n, row, col] * moved[:, 1]) / supersampling**2
    return image.index_put((n, row // supersampling, col // supersampling), change, accumulate=True)
