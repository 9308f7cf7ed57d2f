"""Views of a model from all around: what they are, and that they are made once."""

from __future__ import annotations

import pytest
import torch
from torch.testing import assert_close

from nablahog.pose.canvas import FILL, cut_out
from nablahog.pose.gallery import STEP, VIEWS, _views, around, azimuths
from nablahog.pose.matching import DETAIL, Model, Photograph, model_of
from nablahog.pose.placing import place, upright

from .common import degrees_between, model, photographed


@pytest.fixture(scope="module")
def photograph() -> Photograph:
    return Photograph(cut_out(*photographed(model(), 40, 15, behind="coffee")))


@pytest.fixture(scope="module")
def prepared(photograph: Photograph) -> Model:
    return model_of(model(), photograph.canvas.camera)


def test_azimuths_go_all_around() -> None:
    assert azimuths(4, 30).tolist() == [30, 120, 210, 300]
    assert len(azimuths()) == VIEWS


def test_they_are_the_similarities_of_renderings_that_fill_the_canvas(photograph: Photograph, prepared: Model) -> None:
    template = photograph.calibrated
    poses = place(upright(azimuths(), 15), prepared.hull, prepared.camera, FILL)
    expected = prepared.similarity(template, detail=DETAIL).values(poses)
    found = around(prepared, template, 15)
    assert_close(found, expected, rtol=1e-4, atol=1e-4)
    assert degrees_between(float(azimuths()[found.argmax()]), 40) <= 360 / VIEWS


def test_elevations_are_those_next_to_the_one_asked_for(photograph: Photograph, prepared: Model) -> None:
    template = photograph.calibrated
    assert torch.equal(around(prepared, template, 15 + 0.49 * STEP), around(prepared, template, 15))
    assert not torch.equal(around(prepared, template, 15 + 0.51 * STEP), around(prepared, template, 15))
    for elevation in (-90.0, 90.0):
        assert torch.isfinite(around(prepared, template, elevation)).all()


def test_another_photograph_asks_for_no_other_views(photograph: Photograph, prepared: Model) -> None:
    first = around(prepared, photograph.calibrated, 20)
    made = _views.cache_info().misses
    other = Photograph(cut_out(*photographed(model(), 200, 30))).calibrated
    assert not torch.equal(around(prepared, other, 20), first)
    assert torch.equal(around(prepared, photograph.calibrated, 20), first)
    assert _views.cache_info().misses == made
    around(prepared, other, 25)
    assert _views.cache_info().misses == made + 1
