"""Harder conditions: the same each time, and as hard as they say."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from nablahog.hog.box import Box
from nablahog.paper import names
from nablahog.paper.annotations import AnnotatedObject
from nablahog.paper.examples import CONDITIONS, PLAIN
from nablahog.paper.scenes import scene

from .test_scenes import MODELS, NOISE, RAMP, VIEWS

COUNT = 5


def _made(name: str, index: int = 0, seed: int = 0) -> AnnotatedObject:
    return CONDITIONS[name].scene(index, MODELS, VIEWS, [RAMP, NOISE], seed=seed)


def _pose(one: AnnotatedObject) -> tuple[float, ...]:
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


def test_another_look_changes_the_image_only() -> None:
    plain, shaded = _made("exact", 2), _made("renderer", 2)
    assert (_pose(shaded), shaded.box, shaded.initial) == (_pose(plain), plain.box, plain.initial)
    assert not torch.equal(shaded.image, plain.image)


def test_photographs() -> None:
    """What changes only the box is there for photographs, too."""
    suited = {name for name, condition in CONDITIONS.items() if condition.of_photographs}
    assert suited == {"exact", "sides-5", "sides-10", "larger-20", "cut-15", "cut-30", "no-box"}
    original = AnnotatedObject("a", torch.rand(1, 100, 120), Box(20.0, 10.0, 80.0, 90.0), 0, 0, 0, None, (10.0, 5.0))
    one, same, other = (CONDITIONS["sides-10"].applied(original, 0, index) for index in (0, 0, 1))
    assert one.box == same.box != other.box
    assert one.image is original.image
