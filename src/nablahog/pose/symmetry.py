"""From where else a model looks the same: after turns by its symmetry, and where what tells views apart is hidden.

What differs in a detail, as the front of a table by its drawer, is another side, but nearly as likely.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import torch
from torch import Tensor

from ..render.surface import Light
from .background import FINE_CELL, default_background, pose_spec
from .model import (
    VIEW_COUNT,
    PreparedModel,
    crop_whitener,
    describe_views,
    equidistant_azimuths,
    round_elevation,
    signed_angles,
)
from .similarity import coarse_background

_ALIKE = 0.95  # correlation of large cells from which on two views are nearly the same
_NEIGHBOURS = 8  # of 48 views, with the one itself, that may differ although a model looks the same all around
SAME_SIDE = 15.0  # degrees: poses whose azimuths are closer look at the object from the same side
_LARGEST_ORDER = 12  # of a symmetry: turns by 30°
_COMPARED_VIEWS, _ELEVATION = 8, 20.0  # that tell of it, and their elevation, degrees
_SAME = 0.985  # correlation of small cells from which on they are the same
_MAYBE_ALIKE = 0.75  # correlation of large cells, at the nearest azimuths of the grid, from which on they may be
_FROM_ABOVE = Light((0.0, 0.0, 1.0))  # the same from all azimuths: shading does not tell views of a bottle apart


class Sides(NamedTuple):
    """Azimuths in 0…360 from which a model looks as it does from another one, degrees, or nearly so."""

    equivalent: tuple[float, ...]
    similar: tuple[float, ...]


def compare_sides(model: PreparedModel, azimuth: float, elevation: float) -> Sides:
    """The azimuths from which the model looks as it does from ``azimuth``, degrees, and those that differ in a detail.

    Equivalent are the turns of :func:`symmetry_order`, and further azimuths next to ``azimuth``, as of a mug whose
    handle is hidden: all, of a bottle.  Similar are others whose views have nearly the same large cells, such as those
    of a table from behind that has a drawer.
    """
    correlations = view_correlations(model, round_elevation(elevation))
    nearest = round(azimuth / 360 * VIEW_COUNT) % VIEW_COUNT
    turns, alike = equidistant_azimuths(VIEW_COUNT), (correlations[nearest] >= _ALIKE).roll(-nearest)
    next_to = alike.cumprod(0) + alike.flip(0).roll(1).cumprod(0).roll(-1).flip(0) > 0
    if next_to.sum() > VIEW_COUNT - _NEIGHBOURS:
        return Sides(tuple(((azimuth + turns[1:]) % 360).tolist()), ())
    order = symmetry_order(model)
    known = torch.cat([equidistant_azimuths(order), turns[next_to]])
    apart = signed_angles(turns[:, None] - known).abs().amin(1) > SAME_SIDE
    beside = turns[next_to & (signed_angles(turns).abs() > SAME_SIDE)]
    equivalent = torch.cat([equidistant_azimuths(order)[1:], beside])
    return Sides(*(tuple(((azimuth + each) % 360).tolist()) for each in (equivalent, turns[alike & apart])))


@lru_cache(maxsize=512)
def symmetry_order(model: PreparedModel) -> int:
    """The largest n up to :data:`_LARGEST_ORDER` for which a model looks the same after turns by 360° / n, or 1.

    Views from azimuths all around are compared in small cells, by a light that moves with the camera, so that drawers
    and labels show.  The turns are about the centre of the surface, through which the axis of a symmetric object goes.
    """
    a, b, c = model.mesh.vertices[model.mesh.faces].unbind(1)
    areas = torch.linalg.cross(b - a, c - a).norm(dim=1, keepdim=True)
    centre = (areas * (a + b + c)).sum(0) / (3 * areas.sum())
    centred = PreparedModel(replace(model.mesh, vertices=model.mesh.vertices - centre))
    background, first = default_background(pose_spec(FINE_CELL)), equidistant_azimuths(_COMPARED_VIEWS, 7.0)

    def describe_lit(azimuths: Tensor) -> Tensor:
        lights = [Light((math.sin(angle), -math.cos(angle), 1.0)) for angle in (azimuths + 30).deg2rad().tolist()]
        return torch.cat(
            [
                describe_views(centred, azimuth, _ELEVATION, background, 1, light)
                for azimuth, light in zip(azimuths[:, None], lights, strict=True)
            ]
        )

    whitened: Tensor | None = None
    for order in range(_LARGEST_ORDER, 1, -1):
        if _may_have_order(view_correlations(model, _ELEVATION), order):
            if whitened is None:
                whitened = crop_whitener(background)(describe_lit(first))
            products = (whitened * describe_lit(first + 360 / order)).sum(dim=(1, 2, 3))
            if products.min() >= _SAME:
                return order
    return 1


def _may_have_order(correlations: Tensor, order: int) -> bool:
    """Whether views of large cells are much alike after a turn by 360° / ``order``, as far as the grid tells."""
    turn = VIEW_COUNT / order
    after = torch.stack([correlations.roll(-steps, 1).diagonal() for steps in (math.floor(turn), math.ceil(turn))])
    return bool(after.amax(0).mean() >= _MAYBE_ALIKE)


def looks_same_all_around(azimuths: Sequence[float]) -> bool:
    """Whether a model with these equivalent azimuths looks the same from all around, as a bottle does."""
    return len(azimuths) >= VIEW_COUNT - _NEIGHBOURS


@lru_cache(maxsize=512)
def view_correlations(model: PreparedModel, elevation: float) -> Tensor:
    """Correlations (VIEW_COUNT, VIEW_COUNT) of the whitened views at an elevation, degrees, lit from above."""
    background, shrink = coarse_background()
    views = describe_views(model, equidistant_azimuths(VIEW_COUNT), elevation, background, shrink, _FROM_ABOVE)
    return views.flatten(1) @ crop_whitener(background, shrink)(views).flatten(1).T


def forget_sides() -> None:
    """Empties the caches of this module, which hold models."""
    symmetry_order.cache_clear()
    view_correlations.cache_clear()
