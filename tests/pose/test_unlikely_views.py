"""What photographs seldom show loses some of its similarity, and a view that fits badly is searched all the same."""

from __future__ import annotations

import pytest
import torch

from nablahog.pose.crop import crop_object, typical_camera
from nablahog.pose.prepared import PreparedPhotograph, prepared_model
from nablahog.pose.problem import SMALL, STEEP, TURNED, PoseProblem, unlikely_view
from nablahog.pose.search import Search

from .common import model

IMAGE = torch.rand(1, 120, 160, generator=torch.Generator().manual_seed(0))
BOX = (40.0, 20.0, 120.0, 100.0)  # half of the photograph's longer side


def problem(*, boxes: bool = False, initial: tuple[float, float] | None = None) -> PoseProblem:
    return PoseProblem(
        IMAGE,
        PreparedPhotograph(crop_object(IMAGE, BOX)),
        {"": prepared_model(model(), typical_camera())},
        () if boxes else None,
        initial,
        180.0,
        None,
        "quadratic",
        None,
        torch.Generator(),
        lambda done, total, what: None,
    )


def test_usual_views_lose_nothing_steep_and_tilted_ones_do() -> None:
    lost = unlikely_view(torch.tensor([0.0, 40, 60, -15]), torch.tensor([0.0, 0, 10, 0]))
    assert lost.tolist() == pytest.approx([0, 0, 20 * STEEP + 10 * TURNED, 5 * STEEP])


def test_what_is_given_is_not_unlikely() -> None:
    poses = torch.tensor([[0.0, 80, 3, 30, 0, 0]], dtype=torch.float64)
    given, unknown = problem(initial=(0.0, 80.0)), problem()
    assert float(given.unlikely(poses, given.photograph)) == 0
    assert float(unknown.unlikely(poses, unknown.photograph)) == pytest.approx(40 * STEEP + 30 * TURNED)


def test_an_object_anywhere_loses_with_each_halving_of_its_size() -> None:
    anywhere = problem(boxes=True, initial=(0.0, 10.0))
    level = torch.tensor([[0.0, 10, 3, 0, 0, 0]], dtype=torch.float64)
    assert float(anywhere.unlikely(level, anywhere.photograph)) == pytest.approx(SMALL)
    assert float(anywhere.unlikely(level, anywhere.cropped((0, 0, 160, 120)))) == pytest.approx(0, abs=1e-9)


def test_the_best_view_is_searched_however_bad_it_is() -> None:
    search = Search(problem(initial=(0.0, 10.0)))
    (view,) = search.look_around()[:1]
    bad = view.refined(view.pose, -1.0, -1.0)
    assert search.promising([bad, view.refined(view.pose, -5.0, -5.0)]) == [bad]


def test_there_may_be_no_views_elsewhere() -> None:
    search = Search(problem(initial=(0.0, 10.0)))
    assert search.tilt_each(search.promising([])) == []
