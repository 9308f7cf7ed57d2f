"""The second answer of a pose: in the tables of nablahog pose, and on the page of a pose."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from nablahog import estimate_pose, sample_chairs
from nablahog.cli.results.pose_files import PosedObject, rows
from nablahog.cli.results.pose_page import pose_page
from nablahog.io.lists import AnnotatedObject
from nablahog.pose import PoseEstimate
from nablahog.pose.result import pose_figures
from nablahog.render import Camera, render

MESHES = dict(list(sample_chairs().items())[:1])


@pytest.fixture(scope="module")
def photograph() -> Tensor:
    (mesh,) = MESHES.values()
    pose = torch.tensor([[180.0, 10, 2, 0, 0, 0]])
    return render(mesh, pose, Camera.from_field_of_view(30, 128, 128))[0]


@pytest.fixture(scope="module")
def found(photograph: Tensor) -> PoseEstimate:
    estimate = estimate_pose(photograph, MESHES, box=(28, 12, 95, 125), initial=(180, 10))
    assert estimate.runners_up
    return estimate


def with_second(found: PoseEstimate, confidence: float) -> PoseEstimate:
    rival = replace(found.runners_up[0], azimuth=1.6, elevation=12.4, confidence=confidence)
    return replace(found, runners_up=(rival,))


@pytest.mark.parametrize(("confidence", "shown"), [(0.31, "2°, 12° (0.31)"), (0.14, None)])
def test_the_table_has_it_where_it_is_likely(found: PoseEstimate, confidence: float, shown: str | None) -> None:
    listed = AnnotatedObject(1, "a.png", None, None)
    posed = PosedObject(listed, pose_figures(with_second(found, confidence)))
    failed = PosedObject(listed, failure="no such file")
    assert [row["second"] for row in rows([posed, failed])] == [shown, None]


def test_the_page_has_a_picture_of_it(found: PoseEstimate, photograph: Tensor) -> None:
    with_it, without = (
        pose_page("a.png", photograph, with_second(found, confidence), MESHES, "best") for confidence in (0.31, 0.14)
    )
    assert "second answer: azimuth 2°, confidence 0.31" in with_it
    assert "second answer: azimuth 2°" not in without
    assert with_it.count("data:image/png") == without.count("data:image/png") + 1
