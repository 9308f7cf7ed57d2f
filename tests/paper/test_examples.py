"""What the table is made from: candidates, boxes, and initial poses that give nothing away."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import torch

from nablahog.hog.box import Box
from nablahog.paper.annotations import AnnotatedPhotograph
from nablahog.paper.examples import PHOTOGRAPHED_FROM, Examples, annotated, photographed, rendered
from nablahog.paper.models import Model, procedural_chairs
from nablahog.paper.pascal3d import AnnotatedObject, Selection, Viewpoint

CADS = [Model(name, Path(f"{name}.off")) for name in ("01", "02", "03")]


def _selection(*cads: str | None) -> Selection:
    objects = [
        AnnotatedObject(f"a#{k}", torch.full((3, 100, 120), 0.5), Viewpoint(10.0 * k, 5.0, 2.0, 7, coarse=False), cad)
        for k, cad in enumerate(cads)
    ]
    return Selection(objects, Counter({"occluded": 4}), {"b": "no image"})


def test_photographs() -> None:
    result = photographed(_selection("02", None), CADS, unknown_model=False, seed=0)
    first, second = result.objects
    assert (first.name, first.model, second.model) == ("a#0", "02", None)
    assert (first.azimuth, first.elevation, first.theta, second.azimuth) == (0, 5, 2, 10)
    assert first.box == (0, 0, 120, 100)
    assert first.models == tuple(CADS)
    assert "2 objects of 1 photographs; left out: 4 occluded" in result.origin
    assert "by all of 3 models, from" in result.origin
    assert result.failed == {"b": "no image"}


def test_without_the_model_most_like_it() -> None:
    result = photographed(_selection("02", None), CADS, unknown_model=True, seed=0)
    assert [[model.name for model in each.models] for each in result.objects] == [["01", "03"], ["01", "02", "03"]]
    with pytest.raises(ValueError, match="a#0: there is no candidate model"):
        photographed(_selection("01"), CADS[:1], unknown_model=True, seed=0)


def test_initial_poses() -> None:
    of = {seed: photographed(_selection("02", None), CADS, unknown_model=False, seed=seed) for seed in (0, 1)}
    begins = [each.initial for examples in of.values() for each in examples.objects]
    assert len(set(begins)) == 4
    assert all(0 <= azimuth < 360 and elevation == PHOTOGRAPHED_FROM for azimuth, elevation in begins)
    alone = photographed(_selection("02"), CADS, unknown_model=True, seed=0).objects[0]
    assert alone.initial == begins[0]


def _rendered(count: int = 3, *, models: int = 3, unknown_model: bool = False, seed: int = 0) -> Examples:
    viewpoints, clutter = np.array([[10.0, 20.0, 4.0], [200.0, 5.0, -3.0]]), [torch.full((1, 40, 40), 0.5)]
    chairs = procedural_chairs(models)
    return rendered(count, chairs, viewpoints, clutter, origin="chairs of mine", unknown_model=unknown_model, seed=seed)


def test_scenes() -> None:
    result = _rendered()
    assert [each.name for each in result.objects] == ["0000", "0001", "0002"]
    for each in result.objects:
        assert (each.azimuth, each.elevation, each.theta) in ((10, 20, 4), (200, 5, -3))
        assert [model.name for model in each.models] == [each.model]
        assert abs(each.initial[1] - each.elevation) <= 5
        x0, y0, x1, y1 = each.box
        assert 0 <= x0 < x1 <= each.image.shape[2]
        assert 0 <= y0 < y1 <= each.image.shape[1]
    assert result.origin.startswith("3 scenes of chairs of mine. Each object is looked for by its own model, from")
    assert len({each.initial for each in [*result.objects, *_rendered(seed=1).objects]}) == 6


def test_the_same_scenes_by_other_models() -> None:
    known, unknown = _rendered(), _rendered(unknown_model=True)
    for one, other in zip(known.objects, unknown.objects, strict=True):
        assert torch.equal(one.image, other.image)
        assert one.initial == other.initial
        names = {model.name for model in other.models}
        assert len(names) == 2
        assert other.model == one.model not in names
    with pytest.raises(ValueError, match="needs at least 2 models to leave one out, got 1"):
        _rendered(models=1, unknown_model=True)


def test_scenes_by_candidates_of_their_own() -> None:
    candidates = [Model("x", 7), Model("y", 8)]
    viewpoints, clutter = np.array([[10.0, 20.0, 4.0]]), [torch.full((1, 40, 40), 0.5)]
    given = {"origin": "chairs", "unknown_model": False, "seed": 0}
    result = rendered(2, procedural_chairs(2), viewpoints, clutter, candidates=candidates, **given)
    assert [each.models for each in result.objects] == [tuple(candidates)] * 2
    assert "looked for by 2 other models" in result.origin


def test_scenes_under_a_condition() -> None:
    viewpoints, clutter = np.array([[10.0, 20.0, 4.0], [200.0, 5.0, -3.0]]), [torch.full((1, 40, 40), 0.5)]
    given = {"origin": "chairs", "unknown_model": False, "seed": 0}
    plain, harder = (
        rendered(3, procedural_chairs(3), viewpoints, clutter, condition=condition, **given)
        for condition in ("", "no-box-no-pose")
    )
    assert [each.name for each in harder.objects] == [f"no-box-no-pose/000{index}" for index in range(3)]
    for one, other in zip(plain.objects, harder.objects, strict=True):
        assert torch.equal(one.image, other.image)
        assert (one.azimuth, one.model) == (other.azimuth, other.model)
        assert (other.box, other.initial) == (None, None)


def _annotated(*models: str | None) -> list[AnnotatedPhotograph]:
    box, image = Box(10.0, 20.0, 60.0, 80.0), torch.full((3, 100, 120), 0.5)
    return [AnnotatedPhotograph(f"a.jpg#{k}", image, box, 10.0 * k, 5.0, 2.0, of) for k, of in enumerate(models)]


def test_annotated_photographs() -> None:
    photographs = _annotated("02", None)
    result = annotated(photographs, CADS, origin="mine", unknown_model=True, seed=0)
    first, second = result.objects
    assert (first.name, first.box, first.model, first.azimuth, first.theta) == (
        "a.jpg#0",
        photographs[0].box,
        "02",
        0,
        2,
    )
    assert [[model.name for model in each.models] for each in (first, second)] == [["01", "03"], ["01", "02", "03"]]
    assert first.initial is not None
    assert first.initial[1] == PHOTOGRAPHED_FROM
    assert result.origin.startswith("2 objects of mine. Each is looked for by all of 3 models but its own, from")
    rough = annotated(photographs, CADS, origin="mine", unknown_model=True, seed=0, condition="sides-10").objects
    assert [each.name for each in rough] == ["sides-10/a.jpg#0", "sides-10/a.jpg#1"]
    assert [each.initial for each in rough] == [first.initial, second.initial]
    assert len({each.box for each in (first, *rough)}) == 3
    with pytest.raises(ValueError, match=r"a\.jpg#0: there is no candidate model"):
        annotated(_annotated("01"), CADS[:1], origin="mine", unknown_model=True, seed=0)
