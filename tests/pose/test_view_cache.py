"""ExemplarViews of a model from all around: what they are, and that they are made once."""

from __future__ import annotations

import pytest
import torch
from torch.testing import assert_close

from nablahog.pose.crop import FILL, crop_object
from nablahog.pose.placement import equidistant_azimuths, fit_to_box, level_poses
from nablahog.pose.prepared import DETAIL, PreparedModel, PreparedPhotograph, prepared_model
from nablahog.pose.views import ELEVATION_STEP, VIEW_COUNT, _view_descriptors, view_similarities

from .common import degrees_between, model, photographed


@pytest.fixture(scope="module")
def photograph() -> PreparedPhotograph:
    return PreparedPhotograph(crop_object(*photographed(model(), 40, 15, behind="coffee")))


@pytest.fixture(scope="module")
def prepared(photograph: PreparedPhotograph) -> PreparedModel:
    return prepared_model(model(), photograph.crop.camera)


def test_they_are_the_similarities_of_renderings_that_fill_the_crop(
    photograph: PreparedPhotograph, prepared: PreparedModel
) -> None:
    template = photograph.calibrated
    poses = fit_to_box(level_poses(equidistant_azimuths(VIEW_COUNT), 15), prepared.hull, prepared.camera, FILL)
    expected = prepared.similarity(template, detail=DETAIL).values(poses)
    result = view_similarities(prepared, template, 15)
    assert_close(result, expected, rtol=1e-4, atol=1e-4)
    assert degrees_between(float(equidistant_azimuths(VIEW_COUNT)[result.argmax()]), 40) <= 360 / VIEW_COUNT


def test_elevations_are_those_next_to_the_one_asked_for(
    photograph: PreparedPhotograph, prepared: PreparedModel
) -> None:
    template = photograph.calibrated
    expected = view_similarities(prepared, template, 15)
    assert torch.equal(view_similarities(prepared, template, 15 + 0.49 * ELEVATION_STEP), expected)
    assert not torch.equal(view_similarities(prepared, template, 15 + 0.51 * ELEVATION_STEP), expected)
    for elevation in (-90.0, 90.0):
        assert torch.isfinite(view_similarities(prepared, template, elevation)).all()


def test_another_photograph_needs_no_other_views(photograph: PreparedPhotograph, prepared: PreparedModel) -> None:
    first = view_similarities(prepared, photograph.calibrated, 20)
    made = _view_descriptors.cache_info().misses
    other = PreparedPhotograph(crop_object(*photographed(model(), 200, 30))).calibrated
    assert not torch.equal(view_similarities(prepared, other, 20), first)
    assert torch.equal(view_similarities(prepared, photograph.calibrated, 20), first)
    assert _view_descriptors.cache_info().misses == made
    view_similarities(prepared, other, 25)
    assert _view_descriptors.cache_info().misses == made + 1
