"""The photograph and the object with the outline of its model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import interpolate

from ...io.images import Picture, as_array
from ...pose import PoseEstimate
from ...pose.crop import CROP_FILL, ObjectCrop, crop_object
from ...render import Camera, Mesh, silhouette
from ...viz.pictures import BLUE, outlined
from ...viz.similarity_plot import draw_boxes

SIDE = 240  # pixels of the close-up, and of the height of the photograph beside it
WIDEST = 4  # width of the picture of a photograph, at most, as a multiple of its greatest height
SEVERAL_MODELS = (
    " The pose is the mean of those of the best models, eight at most, and the outline that of the best one there."
)
"""Of a search among several models, below pictures."""
_FILL = 0.8  # share of the close-up's side for the longer side of the box


def join_pictures(photograph: Tensor, estimate: PoseEstimate, mesh: Mesh) -> NDArray[np.float64]:
    """The close-up, and right of it the photograph, above black where it is less high; both with the outline.

    ``photograph`` is (C, H, W); the result is of the :func:`joined_shape`, in 0…1.
    """
    _, _, close = close_up(photograph, estimate, mesh, SIDE, _FILL * SIDE)
    whole = outline_photograph(photograph, estimate, mesh, SIDE)
    below = ((0, 0), (0, SIDE - whole.shape[1]), (0, 0))
    return np.concatenate([close, np.pad(whole, below)], axis=2)


def joined_shape(size: Sequence[int]) -> tuple[int, int, int]:
    """The shape of :func:`join_pictures` for a photograph of a size (height, width)."""
    return 3, SIDE, SIDE + picture_size(size, SIDE)[1]


def outline_photograph(photograph: Tensor, estimate: PoseEstimate, mesh: Mesh, height: int) -> NDArray[np.float64]:
    """The photograph with the object's box, blue, and the model's outline, red, (3, H, W), at most ``height`` high."""
    size = picture_size(photograph.shape[1:], height)
    whole = interpolate(photograph[None], size, mode="bilinear", antialias=True)[0]
    whole = whole / 255 if not whole.is_floating_point() else whole
    drawn, pose, camera = estimate.render_arguments(mesh)
    zoom = max(size) / max(photograph.shape[1:])
    outline = _draw_outline(whole, drawn, scale_pose(pose[0], zoom), Camera(camera.focal * zoom, *size))
    return draw_boxes(outline, [[side * zoom for side in estimate.box]], BLUE)


def picture_size(size: Sequence[int], height: int) -> tuple[int, int]:
    """Height and width of the picture of a photograph of a size (height, width)."""
    zoom = min(height / size[0], WIDEST * height / size[1])
    return max(1, round(size[0] * zoom)), max(1, round(size[1] * zoom))


def close_up(
    photograph: Tensor, estimate: PoseEstimate, mesh: Mesh, side: int, fill: float
) -> tuple[ObjectCrop, Tensor, NDArray[np.float64]]:
    """A crop of ``side`` pixels, ``fill`` of them the box's longer side; the pose in it; the model's outline on it."""
    known = estimate.camera.focal, estimate.principal_point
    crop = crop_object(photograph, estimate.box, side, fill, *known)
    pose = scale_pose(estimate.crop_pose, fill / CROP_FILL)
    return crop, pose, _draw_outline(crop.image[0], mesh, pose, crop.camera)


def _draw_outline(picture: Picture, mesh: Mesh, pose: Tensor, camera: Camera) -> NDArray[np.float64]:
    return outlined(picture, as_array(silhouette(mesh, pose, camera)[0, 0]) >= 0.5)


def scale_pose(pose: Tensor, zoom: float) -> Tensor:
    """A pose (6,), as (1, 6), for a picture of another size."""
    scaled = pose.clone()
    scaled[4:] *= zoom
    return scaled[None]
