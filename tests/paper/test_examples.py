"""What Table 2 is made from: candidates, boxes, initial poses that give nothing away; and harder conditions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from nablahog.inputs.boxes import Box
from nablahog.paper import names
from nablahog.paper.annotations import Example
from nablahog.paper.examples import CONDITIONS, PLAIN, Examples, photograph_examples, render_examples
from nablahog.paper.scenes import CHAIRS, scene
from nablahog.render.models import Model, archived_models

from .test_scenes import MODELS, NOISE, RAMP, VIEWS

CADS = [Model(name, Path(f"{name}.off")) for name in ("01", "02", "03")]
BOX = Box(10.0, 20.0, 60.0, 80.0)


def _photographed(*models: str | None, unknown_model: bool = False, seed: int = 0, condition: str = "") -> Examples:
    image = torch.full((3, 100, 120), 0.5)
    objects = [Example(f"a#{k}", image, BOX, 10.0 * k, 5.0, 2.0, model) for k, model in enumerate(models)]
    options = {"origin": "Mine.", "unknown_model": unknown_model, "seed": seed, "condition": condition}
    return photograph_examples(objects, CADS, **options, failed={"b": "no image"})  # type: ignore[arg-type]


def test_photographs() -> None:
    result = _photographed("02", None)
    described = [(one.name, one.model, one.azimuth, one.box) for one in result.objects]
    assert described == [("a#0", "02", 0, BOX), ("a#1", None, 10, BOX)]
    assert result.objects[0].candidates == tuple(CADS)
    assert result.origin.startswith("Mine. Candidates for each: 3 models; no pose is given")
    assert result.failed == {"b": "no image"}


def test_without_the_own_model() -> None:
    result = _photographed("02", None, unknown_model=True)
    assert [[model.name for model in each.candidates] for each in result.objects] == [["01", "03"], ["01", "02", "03"]]
    with pytest.raises(ValueError, match="a#0: there is no candidate model"):
        photograph_examples(result.objects[:1], [CADS[1]], origin="", unknown_model=True, seed=0)


def test_photographs_under_a_condition() -> None:
    plain, rough = _photographed("02", None), _photographed("02", None, condition="sides-10")
    assert [each.name for each in rough.objects] == ["sides-10/a#0", "sides-10/a#1"]
    assert [each.initial for each in (*rough.objects, *plain.objects)] == 4 * [None]
    assert len({each.box for each in rough.objects} | {BOX}) == 3


def _rendered(unknown_model: bool = False, seed: int = 0, condition: str = "") -> Examples:
    viewpoints, clutter = np.array([[10.0, 20.0, 4.0], [200.0, 5.0, -3.0]]), [torch.full((1, 40, 40), 0.5)]
    options = {"origin": "mine", "unknown_model": unknown_model, "seed": seed, "condition": condition}
    return render_examples(3, archived_models(CHAIRS)[:3], viewpoints, clutter, **options)  # type: ignore[arg-type]


def test_scenes() -> None:
    result = _rendered()
    assert [each.name for each in result.objects] == ["0000", "0001", "0002"]
    for each in result.objects:
        assert (each.azimuth, each.elevation, each.theta) in ((10, 20, 4), (200, 5, -3))
        assert [model.name for model in each.candidates] == [each.model]
        assert each.initial is not None
        assert abs(each.initial[1] - each.elevation) <= 5
    assert result.origin.startswith("3 scenes of mine. Each object is compared with its own model, from")
    assert len({each.initial for each in [*result.objects, *_rendered(seed=1).objects]}) == 6


def test_the_same_scenes_by_other_models_and_without_a_box() -> None:
    known, unknown, boxless = _rendered(), _rendered(unknown_model=True), _rendered(condition="no-box")
    for one, other, harder in zip(known.objects, unknown.objects, boxless.objects, strict=True):
        assert torch.equal(one.image, other.image)
        assert torch.equal(one.image, harder.image)
        assert one.initial == other.initial == harder.initial
        candidates = {model.name for model in other.candidates}
        assert len(candidates) == 2
        assert other.model == one.model not in candidates
        assert (harder.name, harder.box) == (f"no-box/{one.name}", None)
    with pytest.raises(ValueError, match="needs at least 2 models to leave one out, got 1"):
        render_examples(1, archived_models(CHAIRS)[:1], np.zeros((1, 3)), [], origin="", unknown_model=True, seed=0)


# --- conditions

COUNT = 5


def _made(name: str, index: int = 0, seed: int = 0) -> Example:
    return CONDITIONS[name].scene(index, MODELS, VIEWS, [RAMP, NOISE], seed=seed)


def _pose(one: Example) -> tuple[float, ...]:
    return one.azimuth, one.elevation, one.theta


@pytest.mark.parametrize("name", CONDITIONS)
def test_the_same_each_time(name: str) -> None:
    assert tuple(CONDITIONS) == names.CONDITIONS
    one, again, other = _made(name), _made(name), _made(name, seed=1)
    assert torch.equal(one.image, again.image)
    assert (_pose(one), one.box, one.initial, one.model) == (_pose(again), again.box, again.initial, again.model)
    assert not torch.equal(one.image, other.image)


def test_the_scenes_of_the_table() -> None:
    one, expected = PLAIN.scene(3, MODELS, VIEWS, [RAMP, NOISE]), scene(3, MODELS, VIEWS, [RAMP, NOISE])
    assert torch.equal(one.image, expected.image)
    assert (one.box, one.initial) == (expected.box, tuple(expected.initial[:2].tolist()))
    assert _pose(one) == tuple(expected.pose[[0, 1, 3]].tolist())


def _errors(name: str) -> np.ndarray:
    """By how much the sides of boxes are off, outwards, in widths and heights of the object."""
    errors = []
    for index in range(COUNT):
        box, exact = _made(name, index).box, _made("exact", index).box
        assert box is not None
        assert exact is not None
        off = (np.array(box) - np.array(exact)) / np.tile([exact.width, exact.height], 2)
        errors.append(off * (-1, -1, 1, 1))
    return np.array(errors)


@pytest.mark.parametrize(("name", "share"), [("sides-5", 0.05), ("sides-10", 0.1)])
def test_rough_boxes(name: str, share: float) -> None:
    np.testing.assert_allclose(np.abs(_errors(name)), share)
    assert {True, False} == set((_errors(name) > 0).ravel().tolist())


def test_larger_and_cut_boxes() -> None:
    np.testing.assert_allclose(_errors("larger-20"), 0.1)
    for name, share in (("cut-15", 0.15), ("cut-30", 0.3)):
        np.testing.assert_allclose(np.sort(_errors(name), axis=1), [[-share, 0, 0, 0]] * COUNT, atol=1e-12)


def test_what_is_not_given() -> None:
    assert _made("no-box").box is None
    assert _made("no-box").initial is not None
    for name in ("tilted", "steep"):
        assert _made(name).initial is None


def test_viewpoints() -> None:
    tilts = [_made("tilted", index).theta for index in range(12)]
    assert all(12 <= abs(tilt) <= 45 for tilt in tilts)
    assert {True, False} == {tilt > 0 for tilt in tilts}
    steep = [_made("steep", index).elevation for index in range(12)]
    assert all(-20 <= elevation <= 75 for elevation in steep)
    assert max(steep) > 45
    given = VIEWS.tolist()
    assert [_made("tilted").azimuth, _made("tilted").elevation] in [view[:2] for view in given]
    assert [_made("steep").azimuth, _made("steep").theta] in [view[::2] for view in given]


def test_another_look_changes_the_image_only() -> None:
    plain, shaded = _made("exact", 2), _made("renderer", 2)
    assert (_pose(shaded), shaded.box, shaded.initial) == (_pose(plain), plain.box, plain.initial)
    assert not torch.equal(shaded.image, plain.image)
    settings = CONDITIONS["renderer"].settings
    assert (settings.shadow > 0, settings.gloss > 0, settings.jpeg) == (True, True, (20, 50))


def test_conditions_of_photographs() -> None:
    """What changes only the box is there for photographs, too."""
    suited = {name for name, condition in CONDITIONS.items() if condition.of_photographs}
    assert suited == {"exact", "sides-5", "sides-10", "larger-20", "cut-15", "cut-30", "no-box"}
    original = Example("a", torch.rand(1, 100, 120), Box(20.0, 10.0, 80.0, 90.0), 0, 0, 0, None, (10.0, 5.0))
    one, same, other = (CONDITIONS["sides-10"].apply(original, 0, index) for index in (0, 0, 1))
    assert one.box == same.box != other.box
    assert one.image is original.image
