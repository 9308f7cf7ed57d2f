from .camera import (
    PARAMETERS as PARAMETERS,
    Camera as Camera,
    pose as pose,
    pose_jacobian as pose_jacobian,
    pose_vjp as pose_vjp,
)
from .conventions import (
    Pascal3D as Pascal3D,
    from_pascal3d as from_pascal3d,
    from_pytorch3d as from_pytorch3d,
    to_pascal3d as to_pascal3d,
    to_pytorch3d as to_pytorch3d,
)
from .mesh import Mesh as Mesh, load_mesh as load_mesh
from .models import sample_chairs as sample_chairs
from .rasterize import depth_and_normals as depth_and_normals
from .renderer import Renderer as Renderer, render as render, silhouette as silhouette
from .surface import Light as Light
