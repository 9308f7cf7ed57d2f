"""The differentiable renderer: a mesh, a pose and a camera to an image, and from its derivative back (Section 3.2)."""

from .camera import PARAMETERS, Camera, pose
from .conventions import (
    Pascal3D,
    from_pascal3d,
    from_pytorch3d,
    from_seeing3d,
    to_pascal3d,
    to_pytorch3d,
    to_seeing3d,
)
from .mesh import Mesh, load_mesh
from .renderer import Renderer, pose_jacobian, render
from .shading import Light
from .views import depth_and_normals, silhouette

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
    "from_seeing3d",
    "load_mesh",
    "pose",
    "pose_jacobian",
    "render",
    "silhouette",
    "to_pascal3d",
    "to_pytorch3d",
    "to_seeing3d",
]
