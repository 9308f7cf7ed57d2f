"""What the table is made from: candidates, boxes, and initial poses that give nothing away."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from nablahog.hog.box import Box
from nablahog.paper.annotations import AnnotatedObject
from nablahog.paper.examples import PHOTOGRAPHED_FROM, Examples, photographed, rendered
from nablahog.paper.models import Model, scene_chairs

CADS = [Model(name, Path(f"{name}.off")) for name in ("01", "02", "03")]
BOX = Box(10.0, 20.0, 60.0, 80.0)


def _photographed(*models: str | None, unknown_model: bool = False, seed: int = 0, condition: str = "") -> Examples:
    image = torch.full((3, 100, 120), 0.5)
    objects = [AnnotatedObject(f"a#{k}", image, BOX, 10.0 * k, 5.0, 2.0, model) for k, model in enumerate(models)]
    options = {"origin": "Mine.", "unknown_model": unknown_model, "seed": seed, "condition": condition}
    return photographed(objects, CADS, **options, failed={"b": "no image"})  # type: ignore[arg-type]


def test_photographs() -> None:
    result = _photographed("02", None)
    assert [(one.name, one.model, one.azimuth, one.box) for one in result.objects] == [
        ("a#0", "02", 0, BOX),
        ("a#1", None, 10, BOX),
    ]
    assert result.objects[0].candidates == tuple(CADS)
    assert result.origin.startswith("Mine. Each is looked for by all of 3 models, from a random azimuth")
    assert result.failed == {"b": "no image"}


def test_without_the_own_model() -> None:
    result = _photographed("02", None, unknown_model=True)
    assert [[model.name for model in each.candidates] for each in result.objects] == [["01", "03"], ["01", "02", "03"]]
    with pytest.raises(ValueError, match="a#0: there is no candidate model"):
        photographed(result.objects[:1], [CADS[1]], origin="", unknown_model=True, seed=0)


def test_initial_poses_do_not_depend_on_the_truth() -> None:
    begins = [each.initial for seed in (0, 1) for each in _photographed("02", None, seed=seed).objects]
    assert len(set(begins)) == 4
    assert all(0 <= azimuth < 360 and elevation == PHOTOGRAPHED_FROM for azimuth, elevation in begins)
    assert _photographed("03", unknown_model=True).objects[0].initial == begins[0]


def test_photographs_under_a_condition() -> None:
    plain, rough = _photographed("02", None), _photographed("02", None, condition="sides-10")
    assert [each.name for each in rough.objects] == ["sides-10/a#0", "sides-10/a#1"]
    assert [each.initial for each in rough.objects] == [each.initial for each in plain.objects]
    assert len({each.box for each in rough.objects} | {BOX}) == 3


def _rendered(unknown_model: bool = False, seed: int = 0, condition: str = "") -> Examples:
    viewpoints, clutter = np.array([[10.0, 20.0, 4.0], [200.0, 5.0, -3.0]]), [torch.full((1, 40, 40), 0.5)]
    options = {"origin": "mine", "unknown_model": unknown_model, "seed": seed, "condition": condition}
    return rendered(3, scene_chairs()[:3], viewpoints, clutter, **options)  # type: ignore[arg-type]


def test_scenes() -> None:
    result = _rendered()
    assert [each.name for each in result.objects] == ["0000", "0001", "0002"]
    for each in result.objects:
        assert (each.azimuth, each.elevation, each.theta) in ((10, 20, 4), (200, 5, -3))
        assert [model.name for model in each.candidates] == [each.model]
        assert each.initial is not None
        assert abs(each.initial[1] - each.elevation) <= 5
    assert result.origin.startswith("3 scenes of mine. Each object is looked for by its own model, from")
    assert len({each.initial for each in [*result.objects, *_rendered(seed=1).objects]}) == 6


def test_the_same_scenes_by_other_models_and_without_a_box() -> None:
    known, unknown, boxless = _rendered(), _rendered(unknown_model=True), _rendered(condition="no-box")
    for one, other, harder in zip(known.objects, unknown.objects, boxless.objects, strict=True):
        assert torch.equal(one.image, other.image)
        assert torch.equal(one.image, harder.image)
        assert one.initial == other.initial == harder.initial
        names = {model.name for model in other.candidates}
        assert len(names) == 2
        assert other.model == one.model not in names
        assert (harder.name, harder.box) == (f"no-box/{one.name}", None)
    with pytest.raises(ValueError, match="needs at least 2 models to leave one out, got 1"):
        rendered(1, scene_chairs()[:1], np.zeros((1, 3)), [], origin="", unknown_model=True, seed=0)
