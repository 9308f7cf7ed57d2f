"""The steps of anti-aliasing: motion of surfaces, silhouette edges, and which of several edges counts."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from nablahog.render import Camera, pose
from nablahog.render.camera import to_camera, to_screen
from nablahog.render.edge_gradient import silhouette_edges, surface_motion
from nablahog.render.surface import mesh_edges

from .shapes import box, cylinder, joined

WIDE = Camera.from_field_of_view(90, 40, 40)


def test_surfaces_move_as_their_points_do() -> None:
    """Of a point on a triangle that turns, bends and comes nearer, to where it is seen a moment later."""
    at = pose(20, 30, 2)
    corners = torch.randn(6, 3, 3, dtype=torch.float64) * 0.4
    velocity = torch.randn(6, 3, 3, dtype=torch.float64)
    weights = torch.rand(6, 3, dtype=torch.float64) + 0.1
    weights = weights / weights.sum(1, keepdim=True)

    def seen(points: Tensor) -> Tensor:
        return to_screen(to_camera(points.reshape(-1, 3), at), at, WIDE)

    def after(time: float) -> tuple[Tensor, Tensor]:
        moved = corners + time * velocity
        return seen(moved), seen((weights[..., None] * moved).sum(1))[0, :, :2]

    (early, before), (late, behind), (now, point) = after(-1e-6), after(1e-6), after(0)
    x, y = point.T
    faces, first = torch.arange(18).reshape(6, 3), torch.zeros(6, dtype=torch.int64)
    result = surface_motion(now, (late - early) / 2e-6, faces, first, x, y)
    assert_close(result, (behind - before) / 2e-6, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("where", [pose(33, 20, 3), pose(33, 20, 0.6), pose(200, -40, 0.3), pose(75, 60, 0.1)])
def test_silhouettes_are_where_one_face_is_turned_to_the_camera_and_one_away(where: Tensor) -> None:
    """Also where the faces go on behind the camera; of edges that do so themselves, nothing is said."""
    one = joined(box(), cylinder(16), box((0.2, 0.3, 2)))
    result = mesh_edges(one)
    points = to_camera(one.vertices, where)
    a, b = points[0][result.ends].unbind(1)
    normals = torch.linalg.cross((b - a)[:, None], points[0][result.opposite] - a[:, None])
    sides = (normals * a[:, None]).sum(2)
    expected = sides[:, 0] * sides[:, 1] >= 0
    front = (points[0][result.ends][..., 2] > 1e-3).all(1)
    assert front.sum() > 5
    assert torch.equal(silhouette_edges(to_screen(points, where, WIDE), result)[0][front], expected[front])
