"""The differentiable renderer: a mesh, a pose and a camera to an image (Section 3.2)."""

from ..runtime.lazy import names_when_used
from .camera import PARAMETERS, Camera, pose, pose_jacobian, pose_vjp
from .conventions import (
    Pascal3D,
    from_pascal3d,
    from_pytorch3d,
    to_pascal3d,
    to_pytorch3d,
)
from .mesh import Mesh, load_mesh, sample_chairs
from .rasterize import depth_and_normals
from .renderer import Renderer, render, silhouette
from .surface import Light

__all__ = [
    "PARAMETERS",
    "Camera",
    "Light",
    "Mesh",
    "Pascal3D",
    "Renderer",
    "depth_and_normals",
    "from_pascal3d",
    "from_pytorch3d",
    "load_mesh",
    "pose",
    "pose_jacobian",
    "pose_vjp",
    "render",
    "sample_chairs",
    "silhouette",
    "to_pascal3d",
    "to_pytorch3d",
]

names_when_used(__name__)  # for dir() and wrong names
