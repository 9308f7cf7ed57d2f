"""Drawings of made-up similarities, without what is in their pictures: `make generated` writes them as they are now."""

from __future__ import annotations

import re

import numpy as np
import torch

from nablahog.app.chart import AZIMUTHS, SimilarityChart
from nablahog.viz.similarity_plot import draw_by_azimuth


def similarity_by_azimuth() -> str:
    """The figure of a page of a pose: with two searches, one across 0°, and three renderings."""
    angles = np.arange(0, 360, 15)
    drawing = draw_by_azimuth(
        angles * (360 - angles) / 4000,
        (360 - 2 * angles) / 4000,
        kind="calibrated",
        azimuth=170.0,
        traces=[([350.0, 365.0, 380.0], [1.0, 1.5, 1.75]), ([90.0, 140.0, 170.0], [5.0, 7.0, 8.0])],
        views=[np.full((4, 4), level) for level in (0.2, 0.5, 0.8)],
    )
    return re.sub(r"data:image/png;base64,[\w+/=]+", "picture.png", drawing.svg())


def chart() -> str:
    """The chart of the page in the browser: a curve, the pose that is shown, and the steps of a search."""
    shown, angles = SimilarityChart(), torch.arange(AZIMUTHS, dtype=torch.float64) * (360 / AZIMUTHS)
    pose = (100.0, 20.0, 3.0, 0.0, 0.0, 0.0)
    shown.begin_curve(pose)
    shown.add_to_curve(0, angles * (360 - angles) / 4000, (360 - 2 * angles) / 4000)
    shown.steps += [(80.0, 5.0), (100.0, 6.0)]
    shown.move(pose, 6.5, 0.04, 640)
    drawn = shown.draw()
    return f"{drawn['svg']}\n<!-- {drawn['description']} {drawn['across']} -->\n"
