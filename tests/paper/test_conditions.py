"""Harder conditions: the same each time, and as hard as they say."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from nablahog.hog.box import Box
from nablahog.paper import names
from nablahog.paper.conditions import CONDITIONS, LANDSCAPE, Case
from nablahog.paper.scenes import Scene, scene

from .test_scenes import MODELS, NOISE, RAMP, VIEWS

COUNT = 5


def _made(name: str, index: int = 0, seed: int = 0) -> tuple[Case, Scene]:
    return CONDITIONS[name].scene(index, MODELS, VIEWS, [RAMP, NOISE], seed=seed)


def test_names_are_those_of_the_command() -> None:
    assert tuple(CONDITIONS) == names.CONDITIONS
    assert set(names.DEFAULT_CONDITIONS) <= set(CONDITIONS)


@pytest.mark.parametrize("name", CONDITIONS)
def test_the_same_each_time(name: str) -> None:
    (case, truth), (again, same), (other, _) = _made(name), _made(name), _made(name, seed=1)
    assert torch.equal(case.image, again.image)
    assert torch.equal(truth.pose, same.pose)
    assert (case.box, case.initial, truth.model) == (again.box, again.initial, same.model)
    assert case.image.shape != other.image.shape or not torch.equal(case.image, other.image)


def test_as_table2() -> None:
    (case, truth), expected = _made("as-table2", 3), scene(3, MODELS, VIEWS, [RAMP, NOISE])
    assert torch.equal(case.image, expected.image)
    assert (case.box, case.initial) == (expected.box, tuple(expected.initial[:2].tolist()))
    assert torch.equal(truth.pose, expected.pose)


def _errors(name: str) -> np.ndarray:
    """By how much the sides of boxes are off, outwards, in widths and heights of the object."""
    errors = []
    for index in range(COUNT):
        box, exact = _made(name, index)[0].box, _made("exact", index)[0].box
        assert box is not None
        assert exact is not None
        off = (np.array(box) - np.array(exact)) / np.tile([exact.width, exact.height], 2)
        errors.append(off * (-1, -1, 1, 1))
    return np.array(errors)


@pytest.mark.parametrize(("name", "share"), [("sides-5", 0.05), ("sides-10", 0.1), ("sides-10-tilted", 0.1)])
def test_rough_boxes(name: str, share: float) -> None:
    if "tilted" not in name:  # whose boxes are others
        np.testing.assert_allclose(np.abs(_errors(name)), share)
        assert {True, False} == set((_errors(name) > 0).ravel().tolist())
    for index in range(COUNT):
        box, truth = _made(name, index)[0].box, _made(name, index)[1].box
        assert box is not None
        sides = np.tile([truth.width, truth.height], 2)
        np.testing.assert_allclose(np.abs(np.array(box) - np.array(truth)) / sides, share)


@pytest.mark.parametrize(("name", "share"), [("larger-20", 0.1), ("larger-40", 0.2)])
def test_larger_boxes(name: str, share: float) -> None:
    np.testing.assert_allclose(_errors(name), share)


@pytest.mark.parametrize(("name", "share"), [("cut-15", 0.15), ("cut-30", 0.3)])
def test_cut_boxes(name: str, share: float) -> None:
    np.testing.assert_allclose(np.sort(_errors(name), axis=1), [[-share, 0, 0, 0]] * COUNT, atol=1e-12)


def test_cut_photographs() -> None:
    for index in range(COUNT):
        (case, truth), whole = _made("photograph-cut-30", index), _made("exact", index)[0]
        assert case.box is not None
        assert case.image.numel() < whole.image.numel()
        height, width = case.image.shape[1:]
        inside = case.box.width * case.box.height / (truth.box.width * truth.box.height)
        assert inside == pytest.approx(0.7)
        borders = [case.box.x0, case.box.y0, width - case.box.x1, height - case.box.y1]
        assert min(np.abs(borders)) <= 0.5


def test_what_is_not_given() -> None:
    assert _made("no-box")[0].box is None
    assert _made("no-box")[0].initial is not None
    assert (_made("no-box-no-pose")[0].box, _made("no-box-no-pose")[0].initial) == (None, None)
    assert _made("exact-no-pose")[0].box == _made("exact")[0].box
    for name in ("exact-no-pose", "tilted", "steep"):
        assert _made(name)[0].initial is None


def test_landscapes_hold_the_object() -> None:
    case, truth = _made("landscape")
    assert case.image.shape == (3, LANDSCAPE, 640)
    assert truth.box.height < LANDSCAPE


def test_viewpoints() -> None:
    tilts = [float(_made("tilted", index)[1].pose[3]) for index in range(12)]
    assert all(12 <= abs(tilt) <= 45 for tilt in tilts)
    assert {True, False} == {tilt > 0 for tilt in tilts}
    steep = [float(_made("steep", index)[1].pose[1]) for index in range(12)]
    assert all(-20 <= elevation <= 75 for elevation in steep)
    assert max(steep) > 45


def test_looks_change_the_image_only() -> None:
    plain, truth = _made("exact", 2)
    for name in ("highlights", "jpeg"):
        case, same = _made(name, 2)
        assert torch.equal(truth.pose, same.pose)
        assert (case.box, case.initial) == (plain.box, plain.initial)
        assert not torch.equal(case.image, plain.image)
        assert 0 <= float(case.image.min()) <= float(case.image.max()) <= 1


def test_photographs() -> None:
    """What changes the box only, is there for photographs, too."""
    suited = {name for name, condition in CONDITIONS.items() if condition.of_photographs}
    assert {"sides-5", "larger-40", "cut-30", "photograph-cut-15", "no-box-no-pose"} <= suited
    assert suited.isdisjoint({"as-table2", "landscape", "tilted", "steep", "renderer", "jpeg"})
    case = Case(torch.rand(1, 100, 120), Box(20.0, 10.0, 80.0, 90.0), (10.0, 5.0))
    one, same, other = (CONDITIONS["sides-10"].case(case, 0, index) for index in (0, 0, 1))
    assert one.box == same.box != other.box
    assert one.image is case.image
    assert CONDITIONS["exact-no-pose"].case(case, 0, 0).initial is None
