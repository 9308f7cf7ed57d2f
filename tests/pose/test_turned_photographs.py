"""Samples of a turned photograph."""

from __future__ import annotations

import math

import pytest
import torch
from torch.testing import assert_close

from nablahog.pose.pyramid import turned


@pytest.mark.parametrize("size", [(40, 40), (30, 50), (50, 30)])
@pytest.mark.parametrize("tilt", [0.0, 20.0, -90.0])
def test_a_ramp_stays_a_ramp(size: tuple[int, int], tilt: float) -> None:
    """Brightness 2x + 3y, from the middle, is sampled where the turned grid lies, whatever the sides of the image."""
    y, x = (torch.arange(n) - (n - 1) / 2 for n in size)
    ramp = 2 * x + 3 * y[:, None]
    (samples,) = turned(ramp, [tilt], 1.5, (9, 12))
    down, across = (1.5 * (torch.arange(n) - (n - 1) / 2) for n in (9, 12))
    cosine, sine = math.cos(math.radians(tilt)), math.sin(math.radians(tilt))
    at_x = cosine * across + sine * down[:, None]
    at_y = cosine * down[:, None] - sine * across
    assert_close(samples, 2 * at_x + 3 * at_y, rtol=0, atol=1e-4)
