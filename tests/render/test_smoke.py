"""A square in front of a camera."""

from __future__ import annotations

import torch

from nablahog.render import Camera, Light, pose, render

from .shapes import mesh


def test_a_square() -> None:
    """Of side 2 from 10 away with a focal length of 20 pixels: 4 pixels wide, as bright as its albedo."""
    square = mesh([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [(0, 1, 2), (0, 2, 3)], 0.25)
    image = render(square, pose(0, 90, 10), Camera(20.0, 8, 8), light=Light(ambient=1.0, diffuse=0.0), background=1.0)
    assert image.shape == (1, 1, 8, 8)
    expected = torch.ones(8, 8)
    expected[2:6, 2:6] = 0.25
    torch.testing.assert_close(image[0, 0].float(), expected, rtol=0, atol=1e-6)
