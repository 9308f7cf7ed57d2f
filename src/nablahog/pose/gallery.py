"""A model from all around, drawn and described once: how alike its views are to a photograph is then one product."""

from __future__ import annotations

from functools import lru_cache

import torch
from torch import Tensor

from ..hog import HOGSpec
from .canvas import FILL
from .filter import Whitener
from .matching import DETAIL, Model
from .placing import place, upright
from .similarity import Template, describe, deviations, in_batches, smaller_poses, white

VIEWS = 48  # azimuths around an object
STEP = 5.0  # degrees between the elevations that there are views of
_KEPT = 512  # sets of views, of half a megabyte


def azimuths(count: int = VIEWS, first: float = 0.0) -> Tensor:
    """All around, (count,), degrees."""
    return first + torch.arange(count, dtype=torch.float64) * (360 / count)


def around(model: Model, template: Template, elevation: float) -> Tensor:
    """Calibrated similarities (VIEWS,) of a template to views of a model at about an elevation.

    The views fill the canvas, instead of the box of an object: they do not depend on the photograph.
    """
    assert template.whitener is not None
    rounded = STEP * round(elevation / STEP)
    views = _views(model, template.spec, template.whitener, template.shrink, rounded)
    return (views @ template.weights.flatten()).double()


@lru_cache(maxsize=_KEPT)
def _views(model: Model, spec: HOGSpec, whitener: Whitener, shrink: int, elevation: float) -> Tensor:
    """Descriptors (VIEWS, N) of a model's views, each in standard deviations of the score it gives photographs."""
    poses = place(upright(azimuths(), elevation), model.hull, model.camera, FILL)
    renderer = model.renderer(detail=DETAIL, shrink=shrink)
    compiled, background = renderer.compiled, white(renderer.camera)

    def work(some: Tensor) -> Tensor:
        descriptors = describe(compiled.render(some, background, False).image[:, None], spec)
        return descriptors.flatten(1) / deviations(whitener.energies(descriptors))[:, None]

    return torch.cat(in_batches(work, smaller_poses(poses, shrink)))
