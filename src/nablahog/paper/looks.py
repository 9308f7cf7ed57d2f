"""The look of other renderers: cast shadows, highlights, and compression as JPEG."""

from __future__ import annotations

import io
import math
from typing import TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage
from torch import Tensor

from ..render import Camera, Light, Mesh, depth_and_normals, render
from ..render.camera import pose as make_pose
from ..render.camera import rotations, to_camera, to_screen

Floats: TypeAlias = NDArray[np.float64]

_FAR = 50.0  # distance of the lamp in units of the mesh: its rays are nearly parallel
_MAP_SIDE = 384  # pixels along a side of the shadow map, the depths seen from the lamp
_BIAS = 0.008  # of the shadow map in units of the mesh, so that a surface does not shade itself
_SHADOW_BLUR = 0.7  # pixels, σ of the edges of shadows
_SHININESS = 25.0  # exponent of highlights


def relight(
    picture: Floats,
    opacity: Floats,
    mesh: Mesh,
    pose: Tensor,
    camera: Camera,
    light: Light,
    *,
    shadow: float,
    gloss: float,
) -> tuple[Floats, Floats]:
    """Adds shadows, which the object casts on itself and on the floor, and highlights (Blinn-Phong) to a rendering.

    Args:
        picture, opacity: (H, W), the rendering on black, and the share of each pixel that it covers.
        mesh, pose, camera, light: of the rendering; shadows need the light to come from above.
        shadow: share of the direct light that is missing in a shadow, in 0…1.
        gloss: brightness of a highlight, in 0…1.

    Returns:
        The picture and its opacity, of which the shadow on the floor is a part.
    """
    toward = torch.nn.functional.normalize(torch.tensor(light.direction, dtype=torch.float64), dim=0)
    depth, facing = depth_and_normals(mesh, pose[None], camera)
    covered = depth[0].isfinite()
    rotation = rotations(pose[None])[0]
    normals = (rotation.T @ facing[0].reshape(3, -1)).T  # in the object's frame
    points, rays, floor = _cast_rays(mesh, pose, camera, rotation, depth[0])
    dark = _find_shadow(mesh, toward, points).reshape(depth[0].shape)
    away = (normals @ toward <= 0).reshape(dark.shape)
    on_object = _soften(torch.where(covered, dark | away, False))
    on_floor = _soften(torch.where(~covered & floor, dark, False))
    ambient = render(mesh, pose[None], camera, background=0.0, light=Light(light.direction, light.ambient, 0.0))
    shaded = picture + shadow * on_object * (ambient[0, 0].double().numpy() - picture)
    half = torch.nn.functional.normalize(toward - rays, dim=1)
    mirrored = (normals * half).sum(1).clamp(min=0).reshape(dark.shape) ** _SHININESS
    shine = gloss * np.where(covered.numpy(), mirrored.numpy(), 0) * (1 - on_object)
    glossy: Floats = np.minimum(shaded + shine * opacity, opacity)
    return glossy, 1 - (1 - opacity) * (1 - shadow * (1 - light.ambient) * on_floor)


def _cast_rays(
    mesh: Mesh, pose: Tensor, camera: Camera, rotation: Tensor, depth: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Points (H·W, 3) of the object or the floor, in the object's frame, unit rays (H·W, 3), and where the floor is."""
    rows, cols = torch.meshgrid(
        torch.arange(camera.height, dtype=torch.float64), torch.arange(camera.width, dtype=torch.float64), indexing="ij"
    )
    x = (cols + 0.5 - camera.width / 2 - pose[4]) / camera.focal
    y = (rows + 0.5 - camera.height / 2 - pose[5]) / camera.focal
    rays = torch.stack([x, y, torch.ones_like(x)], dim=-1).reshape(-1, 3) @ rotation
    origin = -pose[2] * rotation[2]  # of the camera
    to_floor = (mesh.vertices[:, 2].amin() - origin[2]) / rays[:, 2]
    floor = (to_floor > 0) & (rays[:, 2] < 0)  # from below it would be seen through the ground
    far = torch.where(depth.reshape(-1).isfinite(), depth.reshape(-1), torch.where(floor, to_floor, 0.0))
    unit = torch.nn.functional.normalize(rays, dim=1)
    return origin + far[:, None] * rays, unit, floor.reshape(depth.shape)


def _find_shadow(mesh: Mesh, toward: Tensor, points: Tensor) -> Tensor:
    """Whether the mesh is between points (N, 3) and a far lamp in the direction ``toward`` (3,)."""
    x, y, z = toward.tolist()
    lamp = make_pose(math.degrees(math.atan2(x, -y)), math.degrees(math.asin(z)), _FAR)
    camera = Camera(0.95 * _FAR * _MAP_SIDE, _MAP_SIDE, _MAP_SIDE)
    nearest = depth_and_normals(mesh, lamp, camera)[0][0]
    screen = to_screen(to_camera(points, lamp), lamp, camera)[0]
    col, row = screen[:, 0].floor().long(), screen[:, 1].floor().long()
    inside = (col >= 0) & (col < _MAP_SIDE) & (row >= 0) & (row < _MAP_SIDE)
    first = torch.full_like(screen[:, 0], math.inf)
    first[inside] = nearest[row[inside], col[inside]]
    behind: Tensor = 1 / screen[:, 2] > first + _BIAS
    return behind


def _soften(mask: Tensor) -> Floats:
    blurred: Floats = ndimage.gaussian_filter(mask.double().numpy(), _SHADOW_BLUR, mode="nearest")
    return blurred


def compress_jpeg(image: Floats, quality: int) -> Floats:
    """An image (3, H, W) in 0…1, (3, H, W), after compression as a JPEG file of ``quality`` 1…95."""
    levels = np.rint(image * 255).astype(np.uint8).transpose(1, 2, 0)
    file = io.BytesIO()
    Image.fromarray(levels).save(file, "JPEG", quality=quality)
    with Image.open(file) as decoded:
        back: Floats = np.asarray(decoded.convert("RGB"), dtype=np.float64).transpose(2, 0, 1) / 255
    return back
