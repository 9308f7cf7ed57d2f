"""The ``opendr`` method against its rule written down once more, pixel by pixel, for a convex object of flat faces.

Outlines are drawn over the image one pixel wide.  The derivative at a pixel the object covers is minus the image's own
difference there times the way its surface moves: inside, the mean of the one-sided differences that touch no outline;
else twice the central difference.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.spatial import ConvexHull
from torch.testing import assert_close

from nablahog.render import Camera, Mesh, Renderer, pose, render
from nablahog.render.camera import to_camera, to_screen

from .shapes import FLAT, box, rectangle

Floats = NDArray[np.float64]
CAMERA = Camera.from_field_of_view(10, 24, 20)
HEIGHT, WIDTH = 24, 20


def faces_of(mesh: Mesh) -> list[tuple[Floats, float]]:
    """Corners (3, 3) in the object's frame and the brightness of each face under the default light."""
    light = np.array([1, -2, 3]) / math.sqrt(14)
    result = []
    for face in mesh.faces.tolist():
        a, b, c = corners = mesh.vertices.numpy()[face]
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal)
        result.append((corners, float(mesh.brightness[face[0]]) * (0.3 + 0.7 * abs(normal @ light))))
    return result


def seen(points: Floats, numbers: Floats) -> Floats:
    """x and y of points of the object."""
    at = torch.tensor(numbers)[None]
    result: Floats = to_screen(to_camera(torch.tensor(points), at), at, CAMERA)[0].numpy()
    return result


def surface(corners: Floats, numbers: Floats, x: float, y: float) -> Floats:
    """The point in a face's plane that is seen at (x, y)."""
    a, b, c = to_camera(torch.tensor(corners), torch.tensor(numbers)[None])[0].numpy()
    ray = np.array([(x - WIDTH / 2 - numbers[4]) / CAMERA.focal, (y - HEIGHT / 2 - numbers[5]) / CAMERA.focal, 1])
    along = np.linalg.solve(np.stack([b - a, c - a, -ray], axis=1), -a)
    return np.asarray(corners[0] + along[0] * (corners[1] - corners[0]) + along[1] * (corners[2] - corners[0]))


def by_the_rule(mesh: Mesh, numbers: Floats, background: Floats) -> tuple[Floats, Floats]:
    """The image (H, W) and its derivatives (6, H, W)."""
    faces = faces_of(mesh)
    image, shown = background.copy(), np.full((HEIGHT, WIDTH), -1)
    inverse = np.zeros((HEIGHT, WIDTH))
    for number, (corners, brightness) in enumerate(faces):
        (xa, ya, wa), (xb, yb, wb), (xc, yc, wc) = seen(corners, numbers)
        area = (xb - xa) * (yc - ya) - (xc - xa) * (yb - ya)
        for row in range(HEIGHT):
            for col in range(WIDTH):
                x, y = col + 0.5, row + 0.5
                p = ((xb - x) * (yc - y) - (xc - x) * (yb - y)) / area
                q = ((xc - x) * (ya - y) - (xa - x) * (yc - y)) / area
                w = p * wa + q * wb + (1 - p - q) * wc
                if min(p, q, 1 - p - q) >= 0 and w > inverse[row, col]:
                    inverse[row, col], shown[row, col], image[row, col] = w, number, brightness

    outline = np.zeros((HEIGHT, WIDTH), bool)
    before = image.copy(), shown.copy()
    outer = seen(mesh.vertices.numpy(), numbers)[:, :2]
    outer = outer[ConvexHull(outer).vertices]
    for (x0, y0), (x1, y1) in zip(outer, np.roll(outer, -1, axis=0), strict=True):
        steep = abs(y1 - y0) > abs(x1 - x0)
        start, end, level, last = (y0, y1, x0, x1) if steep else (x0, x1, y0, y1)
        for k in range(HEIGHT if steep else WIDTH):
            t = (k + 0.5 - start) / (end - start)
            if not 0 <= t < 1:
                continue
            place = level + t * (last - level)
            on, low = math.floor(place), math.floor(place - 0.5)
            pair = [(k, low), (k, low + 1)] if steep else [(low, k), (low + 1, k)]
            inner = next((each for each in pair if before[1][each] >= 0), None)
            if inner is None:  # a tip between samples
                continue
            target = (k, on) if steep else (on, k)
            outline[target] = True
            image[target], shown[target] = before[0][inner], before[1][inner]

    derivative = np.zeros((6, HEIGHT, WIDTH))
    for row in range(1, HEIGHT - 1):
        for col in range(1, WIDTH - 1):
            if shown[row, col] < 0:
                continue
            slope = []
            for rows, cols in (((0, 0), (-1, 1)), ((-1, 1), (0, 0))):
                sides = [(row + dr, col + dc) for dr, dc in zip(rows, cols, strict=True)]
                steps = [sign * (image[side] - image[row, col]) for sign, side in zip((-1, 1), sides, strict=True)]
                usable = [
                    step for step, side in zip(steps, sides, strict=True) if not outline[side] and not outline[row, col]
                ]
                slope.append(np.mean(usable) if usable else 2 * np.mean(steps))
            if not any(slope):
                continue
            point = surface(faces[shown[row, col]][0], numbers, col + 0.5, row + 0.5)[None]
            for k in range(6):
                small = 1e-5 * np.eye(6)[k]
                motion = (seen(point, numbers + small) - seen(point, numbers - small))[0, :2] / 2e-5
                derivative[k, row, col] = -np.dot(slope, motion)
    return image, derivative


@pytest.mark.slow
@pytest.mark.parametrize(
    "at", [pose(33.3, 27.7, 13.1, 7.7, 0.6, -1.1), pose(-62, 5, 13, -20, 1.2, 0.7)], ids=["above", "side"]
)
def test_the_image_and_its_derivatives_are_those_of_the_rule(at: torch.Tensor) -> None:
    mesh = box((1, 0.8, 0.9))
    picture = torch.rand(1, 1, HEIGHT, WIDTH, dtype=torch.float64)
    image, derivative = by_the_rule(mesh, at[0].numpy(), picture[0, 0].numpy())
    renderer = Renderer(mesh, CAMERA, method="opendr", supersampling=1)
    result = renderer(at, picture)[0, 0]
    assert_close(result, torch.from_numpy(image))
    for k in range(6):
        direction = torch.eye(6, dtype=torch.float64)[k : k + 1]
        _, slope = torch.func.jvp(lambda p: renderer(p, picture)[0, 0], (at,), (direction,))
        assert_close(slope, torch.from_numpy(derivative[k]), rtol=1e-5, atol=1e-6)


def test_a_boundary_counts_once() -> None:
    """The derivative of the covered area by a shift along one side is the length of that side."""
    one = rectangle(4.3, 5.2, 15.4, 17.1, CAMERA, brightness=1.0)
    at = pose(0, distance=3).requires_grad_()
    weights = torch.zeros(HEIGHT, WIDTH)
    weights[:, 10:] = 1  # the right side alone
    image = render(one, at, CAMERA, background=0.0, light=FLAT, method="opendr", supersampling=1)[0, 0]
    (slope,) = torch.autograd.grad((image * weights).sum(), at)
    assert float(slope[0, 4]) == pytest.approx(12, abs=1.01)
