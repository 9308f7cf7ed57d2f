"""The surroundings of a box, at several scales and in-plane rotations."""

from __future__ import annotations

import torch
from torch.testing import assert_close

from nablahog.pose.candidates import candidates
from nablahog.pose.crop import FILL, crop_object
from nablahog.pose.placement import bounding_boxes
from nablahog.pose.prepared import PreparedPhotograph, prepared_model
from nablahog.pose.pyramid import FOUND, ROUGH, places, pyramid, turned
from nablahog.pose.views import VIEW_COUNT
from nablahog.render import Camera, pose, render

from .common import degrees_between, model, photographed


def test_what_is_turned_counter_clockwise_is_upright_again() -> None:
    camera = Camera(300.0, 100, 100)
    upright, tilted = (render(model(), pose(40, 15, 4.0, theta), camera)[0, 0] for theta in (0, 30))
    (again,) = turned(tilted, [30], 1.0, (100, 100))
    assert float((again - upright).abs().mean()) < 0.015
    assert float((again - tilted).abs().mean()) > 0.05
    assert_close(turned(tilted, [0], 1.0, (100, 100))[0], tilted, atol=1e-5, rtol=0)


def test_places_are_those_of_the_samples() -> None:
    """An image whose brightness is its column, turned: samples have the x of their places."""
    columns = torch.arange(40.0).expand(40, 40).contiguous()
    (samples,) = turned(columns, [25], 1.5, (12, 12))
    grid = (torch.arange(12, dtype=torch.float64) + 0.5 - 6,) * 2
    x, _ = places(grid, torch.tensor([1.5]).double(), torch.tensor([25.0]).double())
    assert_close(samples.double(), x[0] + 40 / 2 - 0.5, atol=1e-3, rtol=0)


def test_the_window_of_the_box_is_the_template() -> None:
    image, box = photographed(model(), 40, 15, behind="coffee")
    photograph = PreparedPhotograph(crop_object(image, box))
    windows = pyramid(photograph, image, [0], FOUND)
    (same,) = ((windows.scales == 1) & (windows.centres == 0).all(1)).nonzero()
    template = photograph.calibrated.weights.flatten()
    assert float(torch.corrcoef(torch.stack([windows.windows[same[0]], template]))[0, 1]) > 0.8


def test_the_best_view_is_where_the_object_is() -> None:
    """A box that is too large, and beside the object."""
    image, box = photographed(model(), 40, 15, behind="coffee")
    rough = box.x0 - 0.3 * box.width, box.y0 - 0.2 * box.height, box.x1 + 0.05 * box.width, box.y1 + 0.15 * box.height
    photograph = PreparedPhotograph(crop_object(image, rough))
    crop = photograph.crop
    one = prepared_model(model(), crop.camera)
    everywhere = torch.ones(VIEW_COUNT, dtype=torch.bool)
    found = candidates(one, photograph, pyramid(photograph, image, [-15, 0, 15], ROUGH), [0, 15, 30], everywhere, 4)
    assert degrees_between(float(found.poses[0, 0]), 40) <= 7.5
    assert found.poses[0, 3] == 0
    assert list(found.similarities) == sorted(found.similarities, reverse=True)
    sides = bounding_boxes(found.poses[:1], one.hull, crop.camera)[0]
    expected = [(side - middle) * crop.zoom for side, middle in zip(box, crop.middle * 2, strict=True)]
    assert max(abs(float(side) - of) for side, of in zip(sides, expected, strict=True)) < 0.1 * FILL
