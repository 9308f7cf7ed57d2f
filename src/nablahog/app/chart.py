"""The chart of a fit: similarity and its derivative by azimuth, with the pose shown and the steps of a search."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from torch import Tensor

from ..viz.similarity_plot import LEFT, RIGHT, SimilarityPlot
from .messages import Pose

AZIMUTHS = 180  # points of the curve
HEIGHTS = 150, 90  # pixels of similarity and derivative
LEAST_WIDTH, MOST_WIDTH = 280, 2000
MOST_STEPS = 300  # of a search, the newest


class SimilarityChart:
    """The state of the chart; a curve's values are NaN until they are computed."""

    def __init__(self) -> None:
        self.steps: list[tuple[float, float]] = []  # azimuths and similarities
        self._curve = np.full((2, AZIMUTHS), np.nan)  # similarities and derivatives
        self._curve_pose: Pose = (math.nan,) * 6
        self._pose: Pose = (0.0,) * 6  # the one that is shown
        self._here = math.nan, math.nan  # similarity and derivative
        self._width = 480

    def begin_curve(self, pose: Pose) -> None:
        """Drops the curve; the next one is that of a pose at all azimuths."""
        self._curve_pose, self._curve[:] = pose, np.nan
        if math.isnan(self._here[0]):
            self._pose = pose

    def add_to_curve(self, first: int, similarities: Tensor, derivatives: Tensor) -> None:
        """Adds similarities and their derivatives per degree, of which the first is at the curve's point ``first``."""
        part = slice(first, first + len(similarities))
        self._curve[:, part] = similarities.numpy(), derivatives.numpy()

    def move(self, pose: Pose, similarity: float, derivative: float, width: int) -> None:
        """Shows a pose, in a chart of ``width`` pixels."""
        self._pose, self._here = pose, (similarity, derivative)
        self._width = min(max(width, LEAST_WIDTH), MOST_WIDTH)

    def draw(self) -> dict[str, Any]:
        """The chart as an SVG, in words, and the part of its width, from … to, that goes from 0° to 360°."""
        similarities, derivatives = self._curve
        similarity, derivative = self._here
        steps = self.steps[-MOST_STEPS:]
        description = self._describe()
        plot = SimilarityPlot(
            np.array([*similarities, similarity, *(value for _, value in steps)]),
            np.append(derivatives, derivative),
            description,
            width=self._width,
            heights=HEIGHTS,
        )
        plot.mark(self._pose[0], "here")
        plot.curve(similarities, derivatives, "curve" if self._is_current() else "faint")
        for step in steps:
            plot.drawing.dot((plot.top.x(step[0] % 360), plot.top.y(step[1])), "path", 3, ringed=True)
        if math.isfinite(similarity):
            plot.tangent(self._pose[0], similarity, derivative)
        across = [LEFT / self._width, 1 - RIGHT / self._width]
        return {"svg": plot.drawing.svg(), "description": description, "across": across}

    def _is_current(self) -> bool:
        """Whether the curve is that of the pose that is shown, whose azimuth alone may differ."""
        return np.allclose(self._curve_pose[1:], self._pose[1:], rtol=0, atol=0.005)

    def _describe(self) -> str:
        similarities = self._curve[0]
        parts = []
        if not np.isnan(similarities).all():
            best = int(np.nanargmax(similarities))
            parts.append(f"the largest is {similarities[best]:.3f} at {360 * best / AZIMUTHS:.0f}°")
        if math.isfinite(self._here[0]):
            parts.append(f"here {self._here[0]:.3f} at {self._pose[0]:.0f}°")
        return f"Similarity over all azimuths: {', '.join(parts)}"
