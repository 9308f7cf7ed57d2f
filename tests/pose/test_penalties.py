"""Penalties of what photographs seldom show, and that a view that fits badly is searched all the same."""

from __future__ import annotations

import pytest
import torch

from nablahog.hog.box import Box
from nablahog.pose import best_search
from nablahog.pose.best_search import BestSearch
from nablahog.pose.crop import crop_object, typical_camera
from nablahog.pose.model import prepared_model
from nablahog.pose.photograph import PreparedPhotograph
from nablahog.pose.problem import SMALL, STEEP, TURNED, PoseProblem, view_penalty
from nablahog.pose.similarity import Similarity

from .common import model

IMAGE = torch.rand(1, 120, 160, generator=torch.Generator().manual_seed(0))
BOX = (40.0, 20.0, 120.0, 100.0)  # half of the photograph's longer side


def problem(*, boxes: bool = False, initial: tuple[float, float] | None = None) -> PoseProblem:
    return PoseProblem(
        IMAGE,
        PreparedPhotograph(crop_object(IMAGE, BOX)),
        Box.of(BOX),
        () if boxes else None,
        {"": prepared_model(model(), typical_camera())},
        initial,
    )


def test_steep_and_tilted_views_have_a_penalty_usual_ones_none() -> None:
    penalties = view_penalty(torch.tensor([0.0, 40, 60, -15]), torch.tensor([0.0, 0, 10, 0]))
    assert penalties.tolist() == pytest.approx([0, 0, 20 * STEEP + 10 * TURNED, 5 * STEEP])


def test_a_pose_that_is_given_has_no_penalty() -> None:
    poses = torch.tensor([[0.0, 80, 3, 30, 0, 0]], dtype=torch.float64)
    given, unknown = problem(initial=(0.0, 80.0)), problem()
    assert float(given.penalty(poses, given.photograph)) == 0
    assert float(unknown.penalty(poses, unknown.photograph)) == pytest.approx(40 * STEEP + 30 * TURNED)


def test_an_object_anywhere_loses_with_each_halving_of_its_size() -> None:
    anywhere = problem(boxes=True, initial=(0.0, 10.0))
    level = torch.tensor([[0.0, 10, 3, 0, 0, 0]], dtype=torch.float64)
    assert float(anywhere.penalty(level, anywhere.photograph)) == pytest.approx(SMALL)
    assert float(anywhere.penalty(level, anywhere.cropped((0, 0, 160, 120)))) == pytest.approx(0, abs=1e-9)


def test_the_best_view_is_searched_however_bad_it_is() -> None:
    search = BestSearch(problem(initial=(0.0, 10.0)))
    (view,) = search.look_around()[:1]
    bad = view.moved(view.pose, -1.0, -1.0)
    assert search.promising([bad, view.moved(view.pose, -5.0, -5.0)]) == [bad]


def test_there_may_be_no_views_elsewhere() -> None:
    search = BestSearch(problem(initial=(0.0, 10.0)))
    assert search.tilt_each(search.promising([])) == []


def test_of_equally_similar_views_those_without_a_penalty_are_preferred(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(best_search, "view_descriptors", lambda *_: torch.zeros(48, 9, 16, 16))
    monkeypatch.setattr(Similarity, "values", lambda self, poses: torch.zeros(len(poses), dtype=torch.float64))
    search = BestSearch(problem())
    views = search.look_around()
    assert {float(view.pose[1]) for view in views} <= {0.0, 15.0, 30.0}
    assert all(view.pose[3] == 0 for view in search.tilt_each(views))
