"""The differentiable renderer: a mesh, a pose and a camera to an image, and from its derivative back (Section 3.2)."""

from .camera import PARAMETERS, Camera, pose
from .mesh import Mesh, load_mesh
from .renderer import Renderer, pose_jacobian, render
from .shading import Light
from .views import depth_and_normals, silhouette

__all__ = [
    "PARAMETERS",
    "Camera",
    "Light",
    "Mesh",
    "Renderer",
    "depth_and_normals",
    "load_mesh",
    "pose",
    "pose_jacobian",
    "render",
    "silhouette",
]
