"""From an object to a pose, and from poses to tables: what tells work apart, and how poses are counted."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nablahog.jobs import store
from nablahog.jobs.store import JobResult
from nablahog.jobs.worker import attempt
from nablahog.paper.pose_methods import POSE_METHODS, PoseInput, PoseMethod, PoseOutcome, Table2Settings
from nablahog.paper.scenes import CHAIRS
from nablahog.paper.table2 import PoseJob, Table2, run_table2
from nablahog.render.models import Model

from .fakes import ENDLESS, FAR, MODELS, NEAR, OTHER, examples


def test_how_they_are_counted(tmp_path: Path, calls: list[str]) -> None:
    """8° more: 40° leaves the first of 4 views, whose edge is 45°, and all but 40° leave theirs of 24, 15° wide."""
    table = run_table2(tmp_path, examples([0, 90, 40, 350]), [NEAR], Table2Settings(), workers=1)
    (paper,) = table.table_rows()
    assert paper.paper == {4: 58.85, 8: 40.74, 16: 22.22, 24: 16.87}
    means = {of: paper.accuracy[of].mean for of in paper.accuracy}
    assert [means["interval", views] for views in (4, 8, 16, 24)] == [75, 100, 100, 25]
    assert [means["threshold", views] for views in (4, 8, 16, 24)] == [100] * 4
    assert paper.error.median == pytest.approx(8, abs=1e-4)
    assert 8 < (paper.rotation.median or 0) < 10  # with 5° of elevation and 1° in the image plane
    assert {angle: of.mean for angle, of in paper.within.items()} == {30: 100, 10: 100}


@pytest.mark.parametrize(("off", "right"), [(30, (100, 0)), (10, (100, 100)), (30.01, (0, 0)), (10.01, (100, 0))])
def test_rotations_exactly_at_the_limits_are_right(
    off: float, right: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    of = examples([0])
    table = Table2({"best": {"0": {"azimuth": 0.0}}}, {"best": {}}, [], {}, [POSE_METHODS["best"]], of)
    monkeypatch.setattr("nablahog.paper.table2.error_of_rotation", lambda pose, one: off)
    (line,) = table.table_rows()
    assert tuple(line.within[angle].mean for angle in (30, 10)) == right


# --- one method on one object


def _job(method: PoseMethod = NEAR, azimuth: float = 90, seed: int = 0) -> PoseJob:
    (each,) = examples([azimuth]).objects
    return PoseJob(method, each.image.numpy(), each.box, each.candidates, each.initial, Table2Settings(seed))


def test_a_pose(tmp_path: Path) -> None:
    began = time.perf_counter()
    result = attempt(_job())
    assert isinstance(result, JobResult)
    assert 0 < result.seconds < time.perf_counter() - began
    (pose,) = result.figures
    assert pose["azimuth"] == pytest.approx(98, abs=1e-4)
    assert (pose["elevation"], pose["model"], pose["similarity"]) == (15, "chair-02", 0.5)
    assert result.pictures.shape == (1, 16, 16)
    assert (result.pictures[0, 8, 8] > 0, result.pictures[0, 0, 0]) == (True, 0)
    store.save(tmp_path / "a.npz", result)
    output = store.load(tmp_path / "a.npz", _job())
    assert output is not None
    assert output.figures == result.figures
    assert np.array_equal(output.pictures, result.pictures)


def test_a_method_is_prepared_with_the_same_problem_first() -> None:
    asked: list[tuple[PoseInput, Table2Settings]] = []

    def run(problem: PoseInput, settings: Table2Settings) -> PoseOutcome:
        assert asked == [(problem, settings)]
        return NEAR.run(problem, settings)

    prepared = _job(replace(NEAR, run=run, prepare=lambda *about: asked.append(about)), seed=3)
    assert isinstance(attempt(prepared), JobResult)


def test_reasons() -> None:
    assert attempt(_job(FAR, 0)) == "no element"
    assert str(attempt(_job(ENDLESS))).startswith("the pose is not finite: {'azimuth': inf")


def test_what_does_not_fit() -> None:
    whole = attempt(_job())
    assert isinstance(whole, JobResult)
    assert _job().fits(whole)
    assert not _job().fits(replace(whole, pictures=whole.pictures[:, 1:]))
    assert not _job().fits(replace(whole, figures=[]))
    assert not _job().fits(replace(whole, figures=[{"azimuth": 1.0}]))


def test_keys_tell_work_apart(tmp_path: Path) -> None:
    files = [tmp_path / name for name in ("a.off", "b.off", "c.off")]
    for path, text in zip(files, ("OFF 1", "OFF 1", "OFF 2"), strict=True):
        path.write_text(text)
    base = _job()
    brighter = base.image.copy()
    brighter[0, 3, 3] = np.nextafter(brighter[0, 3, 3], 2)
    jobs = [
        base,
        _job(OTHER),
        _job(seed=1),
        replace(base, image=brighter),
        replace(base, image=base.image.reshape(1, 8, 32)),
        replace(base, box=(0, 0, 16, 15)),
        replace(base, models=MODELS[:1]),
        replace(base, models=MODELS[::-1]),
        replace(base, models=(Model("chair-03", CHAIRS), MODELS[1])),
        replace(base, initial=(0, 16)),
        *(replace(base, models=(Model("one", path),)) for path in files),
    ]
    keys = {each.key() for each in jobs}
    assert jobs[-1].key() != jobs[-2].key() == jobs[-3].key()  # files that hold the same
    assert len(keys) == len(jobs) - 1
    assert _job().key() == base.key()
    files[0].write_text("OFF 33")
    assert jobs[-3].key() not in keys
