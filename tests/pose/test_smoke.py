"""The pose of a chair on white, rendered at a known one."""

from __future__ import annotations

import pytest

from nablahog.pose import estimate_pose

from .common import degrees_between, model, photographed


@pytest.mark.parametrize("azimuth", [5, 215])
def test_a_clean_rendering(azimuth: float) -> None:
    image, box = photographed(model(), azimuth, 18)
    estimate = estimate_pose(image, model(), box=box)
    assert degrees_between(estimate.azimuth, azimuth) < 2
    assert abs(estimate.elevation - 18) < 4
    assert abs(estimate.theta) < 3
    assert estimate.similarity_kind == "calibrated"
    assert estimate.renderings > 100
    (trace,) = [trace for trace in estimate.traces if trace.azimuths[-1] % 360 == estimate.azimuth]
    assert len(trace.azimuths) == 4  # a view all around, the ends of a coarse, a short and the full ascent
    view, climbed, *_, maximum = trace.similarities  # of large cells; the last ascents climb those of small ones
    assert view <= climbed
    assert view < maximum
