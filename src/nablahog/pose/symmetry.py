"""From where else a model looks the same: a bottle from everywhere, a table from behind."""

from __future__ import annotations

from functools import lru_cache

from torch import Tensor

from .crop import SIDE
from .placement import equidistant_azimuths
from .prepared import PreparedModel, coarse_background, whitener_of
from .views import ELEVATION_STEP, VIEW_COUNT, view_descriptors

ALIKE = 0.9
"""Correlation of two views from which on no photograph tells them apart."""


def equivalent_azimuths(model: PreparedModel, azimuth: float, elevation: float) -> tuple[float, ...]:
    """Azimuths in 0…360 from which the model looks as it does from ``azimuth``, that itself left out.

    Args:
        model: whose views are compared.
        azimuth, elevation: of one, degrees.

    Returns:
        Multiples of 360 / :data:`.views.VIEW_COUNT` degrees from ``azimuth`` on, farther away than its own maximum
        reaches; all of them for a solid of revolution.
    """
    alike = view_correlations(model, ELEVATION_STEP * round(elevation / ELEVATION_STEP))
    nearest = round(azimuth / 360 * VIEW_COUNT) % VIEW_COUNT
    same = (alike[nearest] >= ALIKE).roll(-nearest)
    return tuple((azimuth + float(turn)) % 360 for turn in equidistant_azimuths(VIEW_COUNT)[same][1:])


@lru_cache(maxsize=512)
def view_correlations(model: PreparedModel, elevation: float) -> Tensor:
    """Correlations (VIEW_COUNT, VIEW_COUNT) of the whitened views at an elevation, a multiple of ELEVATION_STEP."""
    background, shrink = coarse_background(None)
    rows, cols = background.spec.grid(SIDE // shrink, SIDE // shrink)
    whitener = whitener_of(background, rows, cols)
    views = view_descriptors(model, background.spec, whitener, shrink, elevation)
    return views @ whitener(views.reshape(VIEW_COUNT, -1, rows, cols)).flatten(1).T
