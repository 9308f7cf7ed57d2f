"""From an object to a pose, and from poses to tables: what tells work apart, how poses are counted, formats."""

from __future__ import annotations

import csv
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from nablahog.jobs import store
from nablahog.jobs.store import JobResult
from nablahog.jobs.worker import attempt
from nablahog.paper.pose_methods import POSE_METHODS, PoseMethod, Table2Settings
from nablahog.paper.scenes import CHAIRS
from nablahog.paper.table2 import PoseJob, Table2, error_of_azimuth, error_of_rotation, run_table2, write_table2
from nablahog.paper.tables import Failure
from nablahog.render.models import Model

from .fakes import ENDLESS, FAR, MODELS, NEAR, OTHER, examples

AZIMUTHS = [0, 90, 40, 350]
FILES = ["failures.csv", "per_object.csv", "summary.csv"]


def _made(folder: Path, *methods: PoseMethod, seed: int = 0) -> Table2:
    return run_table2(folder, examples(AZIMUTHS), methods, Table2Settings(seed), workers=1)


def _rows(path: Path) -> list[dict[str, str]]:
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_how_they_are_counted(tmp_path: Path, calls: list[str]) -> None:
    """8° more: 40° leaves the first of 4 views, whose edge is 45°, and all but 40° leave theirs of 24, 15° wide."""
    table = _made(tmp_path, NEAR)
    (paper,) = table.table_rows()
    assert paper.paper == {4: 58.85, 8: 40.74, 16: 22.22, 24: 16.87}
    means = {of: paper.accuracy[of].mean for of in paper.accuracy}
    assert [means["interval", views] for views in (4, 8, 16, 24)] == [75, 100, 100, 25]
    assert [means["threshold", views] for views in (4, 8, 16, 24)] == [100] * 4
    assert paper.error.median == pytest.approx(8, abs=1e-4)
    assert 8 < (paper.rotation.median or 0) < 10  # with 5° of elevation and 1° in the image plane
    assert {angle: of.mean for angle, of in paper.within.items()} == {30: 100, 10: 100}
    accuracy = paper.accuracy["interval", 4]
    assert accuracy.low is not None
    assert accuracy.high is not None
    assert 0 <= accuracy.low < 75 < accuracy.high <= 100


@pytest.mark.parametrize(("off", "right"), [(30, (100, 0)), (10, (100, 100)), (30.01, (0, 0)), (10.01, (100, 0))])
def test_rotations_exactly_at_the_limits_are_right(
    off: float, right: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    of = examples([0])
    table = Table2({"best": {"0": {"azimuth": 0.0}}}, {"best": {}}, [], {}, [POSE_METHODS["best"]], of)
    monkeypatch.setattr("nablahog.paper.table2.error_of_rotation", lambda pose, one: off)
    (line,) = table.table_rows()
    assert tuple(line.within[angle].mean for angle in (30, 10)) == right


def test_no_pose_is_wrong(tmp_path: Path, calls: list[str]) -> None:
    table = _made(tmp_path, FAR)
    assert table.failures == [Failure("0", "exemplar", "no element")]
    poses = table.figures["exemplar"]
    each = [(poses.get(one.name), one) for one in table.examples.objects]
    assert [error_of_azimuth(*one) for one in each] == pytest.approx([180, 100, 100, 100], abs=1e-4)
    assert error_of_rotation(*each[0]) == 180
    assert all(error_of_rotation(*one) > 90 for one in each)
    line = {line.method: line for line in table.table_rows()}["exemplar"]
    assert line.accuracy["threshold", 4].n == 4
    assert line.accuracy["threshold", 4].mean == 0


def test_files(tmp_path: Path, calls: list[str]) -> None:
    table = _made(tmp_path, FAR, NEAR)
    write_table2(tmp_path, table)
    assert sorted(os.listdir(tmp_path)) == [*FILES, "work"]

    rows = _rows(tmp_path / "per_object.csv")
    assert [(row["method"], row["object"]) for row in rows] == [
        *(("exemplar", each) for each in "123"),
        *(("paper", each) for each in "0123"),
    ]
    first = rows[3]
    assert float(first["azimuth"]) == table.figures["paper"]["0"]["azimuth"]  # to the last bit
    assert [first[name] for name in ("true_azimuth", "true_theta", "elevation", "model", "found_model")] == [
        *("0", "1.0", "15.0", "chair-01", "chair-02")
    ]
    turn = Rotation.from_euler("ZXZ", [[0, 105, -8], [-1, 110, 0]], degrees=True)
    expected = np.degrees((turn[0] * turn[1].inv()).magnitude())
    assert float(first["rotation_error"]) == pytest.approx(expected, abs=1e-4)

    rows = _rows(tmp_path / "summary.csv")
    assert list(rows[0]) == ["condition", "method", "objects", "figure", "value", "low", "high", "paper"]
    of = {(row["method"], row["figure"]): row for row in rows}
    assert len(of) == len(rows) == 2 * 12
    assert [of["paper", "interval_4"][name] for name in ("objects", "value", "paper")] == ["4", "75.0", "58.85"]
    assert of["paper", "threshold_4"]["paper"] == ""
    assert float(of["exemplar", "median_error"]["value"]) == pytest.approx(100, abs=1e-4)
    assert float(of["paper", "rotation_median_error"]["value"]) == pytest.approx(expected, abs=1)
    assert of["paper", "rotation_within_10_degrees"]["value"] == "100.0"
    assert (tmp_path / "failures.csv").read_text() == "object,method,reason\n0,exemplar,no element\n"


def test_a_method_that_is_not_published(tmp_path: Path, calls: list[str]) -> None:
    table = _made(tmp_path, OTHER)
    write_table2(tmp_path, table)
    assert [line.method for line in table.table_rows()] == ["other"]
    summary = _rows(tmp_path / "summary.csv")
    assert {row["paper"] for row in summary} == {""}


def _harder(folder: Path, *methods: PoseMethod) -> Table2:
    conditions = {"sides-5": examples([40, 350], prefix="sides-5/"), "no-box": examples([90], prefix="no-box/")}
    return run_table2(folder, examples(AZIMUTHS), methods, Table2Settings(), conditions, workers=1)


def test_conditions_have_tables_of_their_own(tmp_path: Path, calls: list[str]) -> None:
    """8° more: 40° leaves the first of 4 views, 350° does not."""
    table, plain = _harder(tmp_path, NEAR), _made(tmp_path / "plain", NEAR)
    assert [line.accuracy for line in table.table_rows()] == [line.accuracy for line in plain.table_rows()]
    (line,) = table.under("sides-5").table_rows()
    assert (line.accuracy["interval", 4].mean, line.accuracy["interval", 8].mean, line.error.n) == (50, 100, 2)
    assert table.under("no-box").table_rows()[0].error.median == pytest.approx(8, abs=1e-4)
    assert table.under("no-box").table_rows()[0].seconds == table.seconds["paper"]["no-box/0"]
    assert set(table.pictures["paper"]) == set("0123")  # the page shows those of the table


def test_files_of_conditions(tmp_path: Path, calls: list[str]) -> None:
    write_table2(tmp_path, _harder(tmp_path, FAR, NEAR))
    rows = _rows(tmp_path / "summary.csv")
    of = {(row["condition"], row["method"], row["figure"]): row["value"] for row in rows}
    assert len(of) == len(rows) == 3 * 2 * 12
    assert of["sides-5", "paper", "interval_4"] == "50.0"
    assert of["no-box", "paper", "threshold_24"] == "100.0"
    assert float(of["no-box", "exemplar", "median_error"]) == pytest.approx(100, abs=1e-4)
    objects = [row["object"] for row in _rows(tmp_path / "per_object.csv") if row["method"] == "paper"]
    assert objects == ["0", "1", "2", "3", "sides-5/0", "sides-5/1", "no-box/0"]


def test_conditions_are_resumed(tmp_path: Path, calls: list[str]) -> None:
    first = _harder(tmp_path, NEAR)
    assert calls == ["paper"] * 7
    calls.clear()
    again = _harder(tmp_path, NEAR)
    assert calls == []
    assert again.figures == first.figures


# --- one method on one object


def _job(method: PoseMethod = NEAR, azimuth: float = 90, seed: int = 0) -> PoseJob:
    (each,) = examples([azimuth]).objects
    return PoseJob(method, each.image.numpy(), each.box, each.candidates, each.initial, Table2Settings(seed))


def test_a_pose(tmp_path: Path) -> None:
    result = attempt(_job())
    assert isinstance(result, JobResult)
    (pose,) = result.figures
    assert pose["azimuth"] == pytest.approx(98, abs=1e-4)
    assert (pose["elevation"], pose["model"], pose["similarity"]) == (15, "chair-02", 0.5)
    assert result.pictures.shape == (1, 16, 16)
    assert (result.pictures[0, 8, 8] > 0, result.pictures[0, 0, 0]) == (True, 0)
    assert result.seconds > 0
    store.save(tmp_path / "a.npz", result)
    output = store.load(tmp_path / "a.npz", _job())
    assert output is not None
    assert output.figures == result.figures
    assert np.array_equal(output.pictures, result.pictures)


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
