"""The paper's methods of Table 2, from the baseline's detection to the pose."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import pytest

from nablahog.inputs.boxes import Box
from nablahog.metrics import rotation_error
from nablahog.paper.pose_methods import POSE_METHODS, PoseInput, Table2Settings, coverage, detection
from tests.pose.common import model, photographed

TRUTH = 40.0, 22.0, 0.0


@lru_cache
def problem() -> PoseInput:
    image, box = photographed(model(), *TRUTH[:2], behind="coffee")
    return PoseInput(image, box, {"wooden": model()}, (190.0, 70.0))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper", "paper-edges"])
def test_the_papers_methods_begin_where_the_baseline_ends(name: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    settings = Table2Settings(exemplars=Path(tmp_path_factory.getbasetemp()) / "exemplars")
    start = detection(problem(), settings)
    assert start.model == "wooden"
    outcome = POSE_METHODS[name].run(problem(), settings)
    assert outcome.model == "wooden"
    assert outcome.elevation == start.elevation != problem().initial[1]
    assert outcome.theta == 0
    assert rotation_error([outcome.azimuth, outcome.elevation, outcome.theta], TRUTH) < 8
    assert 0 < outcome.similarity < 25  # of so many patches, whose descriptors are of length 1
    assert coverage(problem(), outcome).sum() > 1000


@pytest.mark.slow
def test_without_a_box_and_an_initial_pose(tmp_path_factory: pytest.TempPathFactory) -> None:
    """The baseline takes the whole image; `best` searches for the object."""
    settings = Table2Settings(exemplars=Path(tmp_path_factory.getbasetemp()) / "exemplars")
    nothing = replace(problem(), box=None, initial=None)
    height, width = nothing.image.shape[1:]
    whole = replace(nothing, box=Box(0.0, 0.0, width, height))
    assert detection(nothing, settings) == detection(whole, settings)
    exemplar = POSE_METHODS["exemplar"]
    assert exemplar.run(nothing, settings) == exemplar.run(whole, settings)
    best = POSE_METHODS["best"].run(nothing, settings)
    assert rotation_error([best.azimuth, best.elevation, best.theta], TRUTH) < 10
