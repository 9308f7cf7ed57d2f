"""Views all around a model at one elevation: the templates of the coarse search, made once for all photographs.

They are kept on disk, too (:mod:`nablahog.io.array_cache`): a later process reads what an earlier one has rendered.
"""

from __future__ import annotations

import hashlib
from functools import cache, lru_cache

import torch
from torch import Tensor

from ..hog import HOGSpec
from ..io.array_cache import cached_array
from ..runtime.source import code_key
from .crop import FILL
from .placement import equidistant_azimuths, fit_to_box, level_poses
from .prepared import DETAIL, PreparedModel
from .similarity import ElementTemplate, describe, deviations, downsampled_poses, in_batches, white_background
from .whitener import Whitener

VIEW_COUNT = 48  # azimuths around an object
ELEVATION_STEP = 5.0  # degrees between the elevations that there are views of
_CACHED = 2048  # sets of views, of half a megabyte: those of 256 models


def view_similarities(model: PreparedModel, template: ElementTemplate, elevation: float) -> Tensor:
    """Calibrated similarities (VIEW_COUNT,) of a template to views of a model at about an elevation, degrees.

    The views fill the crop, instead of the box of an object, so that they do not depend on the photograph.
    """
    assert template.whitener is not None
    views = view_descriptors(model, template.spec, template.whitener, template.shrink, elevation)
    return (views @ template.weights.flatten()).double()


def view_descriptors(model: PreparedModel, spec: HOGSpec, whitener: Whitener, shrink: int, elevation: float) -> Tensor:
    """Descriptors (VIEW_COUNT, N) of views, each divided by the standard deviation of its score over photographs.

    Args:
        model: it is seen from all around, and fills the crop.
        spec: of the descriptor, of N numbers.
        whitener: of its size.
        shrink: factor by which the crop is made smaller before it is described.
        elevation: of the views, rounded to a multiple of :data:`ELEVATION_STEP`, degrees.
    """
    return _view_descriptors(model, spec, whitener, shrink, ELEVATION_STEP * round(elevation / ELEVATION_STEP))


@lru_cache(maxsize=_CACHED)
def _view_descriptors(model: PreparedModel, spec: HOGSpec, whitener: Whitener, shrink: int, elevation: float) -> Tensor:
    numbers = spec.channels * whitener.rows * whitener.cols
    facts = (model.digest, spec.to_json(), whitener.digest, shrink, elevation, _code(), torch.__version__)
    key = hashlib.sha256(repr(facts).encode()).hexdigest()
    made = cached_array(
        "views", key, (VIEW_COUNT, numbers), lambda: _described(model, spec, whitener, shrink, elevation).numpy()
    )
    return torch.from_numpy(made)


@cache
def _code() -> str:
    return code_key(_described)


def _described(model: PreparedModel, spec: HOGSpec, whitener: Whitener, shrink: int, elevation: float) -> Tensor:
    """What :func:`view_descriptors` returns, rendered."""
    poses = fit_to_box(level_poses(equidistant_azimuths(VIEW_COUNT), elevation), model.hull, model.camera, FILL)
    renderer = model.renderer(detail=DETAIL, shrink=shrink)
    background = white_background(renderer.camera)

    def describe_views(some: Tensor) -> Tensor:
        descriptors = describe(renderer.render(some, background, derivative=False).image[:, None], spec)
        return descriptors.flatten(1) / deviations(whitener.energies(descriptors))[:, None]

    return torch.cat(in_batches(describe_views, downsampled_poses(poses, shrink)))
