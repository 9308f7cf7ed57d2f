"""Poses of a model around an object's box, at several scales, places and in-plane rotations: the most similar views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from .crop import FILL
from .placement import equidistant_azimuths, fit_to_box, level_poses
from .prepared import PreparedModel, PreparedPhotograph
from .pyramid import Pyramid
from .views import VIEW_COUNT, view_descriptors

_OFF = 0.05  # of its similarity that a view loses which is off the box by a factor of 2, or by half its side


@dataclass(frozen=True, eq=False)
class Candidates:
    """The best views of a model in a pyramid.

    Attributes:
        poses: (K, 6) for the crop, angles in degrees.
        similarities: (K,), the highest first.
    """

    poses: Tensor
    similarities: Tensor


def candidates(
    model: PreparedModel,
    photograph: PreparedPhotograph,
    pyramid: Pyramid,
    elevations: Sequence[float],
    allowed: Tensor,
    count: int,
) -> Candidates:
    """The views that are more similar than those at neighbouring azimuths, elevations and tilts.

    Args:
        model: whose views.
        photograph: the object's crop.
        pyramid: around it.
        elevations: of the views, degrees.
        allowed: (VIEW_COUNT,), bool: which azimuths.
        count: the most to return.
    """
    template = photograph.calibrated
    assert template.whitener is not None
    views = torch.stack(
        [view_descriptors(model, template.spec, template.whitener, template.shrink, each) for each in elevations]
    )
    off = pyramid.scales.log2().square() + 4 * (pyramid.centres / FILL).square().sum(1)
    similarities = (views @ pyramid.windows.T).double() * (1 - _OFF * off)  # (E, VIEW_COUNT, P)
    tilts, which = torch.unique(pyramid.tilts, return_inverse=True)
    best = similarities.new_full((len(elevations), VIEW_COUNT, len(tilts)), -torch.inf)
    at = torch.zeros_like(best, dtype=torch.int64)
    for k in range(len(tilts)):
        places = (which == k).nonzero()[:, 0]
        values, index = similarities[:, :, places].max(2)
        best[:, :, k], at[:, :, k] = values, places[index]
    best[:, ~allowed] = -torch.inf
    around = functional.pad(best.permute(1, 0, 2)[None, None], (1, 1, 1, 1, 0, 0), value=-torch.inf)
    around = torch.cat([around[:, :, -1:], around, around[:, :, :1]], 2)
    highest = best >= functional.max_pool3d(around, 3, stride=1)[0, 0].permute(1, 0, 2)
    chosen = (highest & best.isfinite()).flatten().nonzero()[:, 0]
    values, order = best.flatten()[chosen].sort(descending=True)
    chosen = chosen[order[:count]]
    elevation, azimuth = chosen // (VIEW_COUNT * len(tilts)), chosen // len(tilts) % VIEW_COUNT
    window = at.flatten()[chosen]
    poses = level_poses(equidistant_azimuths(VIEW_COUNT)[azimuth], 0)
    poses[:, 1] = torch.tensor(elevations, dtype=torch.float64)[elevation]
    return Candidates(placed(poses, model, photograph, pyramid, window), values[:count])


def placed(
    poses: Tensor, model: PreparedModel, photograph: PreparedPhotograph, pyramid: Pyramid, windows: Tensor
) -> Tensor:
    """Level poses (K, 6) at the scales, tilts and places of windows (K,) of a pyramid."""
    scales, tilts, centres = (part[windows] for part in (pyramid.scales, pyramid.tilts, pyramid.centres))
    poses = fit_to_box(poses, model.hull, photograph.crop.camera, FILL * scales)
    angle = torch.deg2rad(tilts)
    x, y = poses[:, 4].clone(), poses[:, 5].clone()
    poses[:, 3] = tilts
    poses[:, 4] = angle.cos() * x + angle.sin() * y + centres[:, 0]
    poses[:, 5] = angle.cos() * y - angle.sin() * x + centres[:, 1]
    return poses
