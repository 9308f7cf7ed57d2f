"""`nablahog table2` on scenes and on files as PASCAL3D+ has them, with methods that need no time."""

from __future__ import annotations

import csv
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from torch import Tensor

from nablahog.cli.main import main
from nablahog.jobs import runner
from nablahog.paper import table2
from nablahog.paper.examples import CONDITIONS
from nablahog.paper.pose_methods import POSE_METHODS, PoseInput, PoseMethod, PoseOutcome, Table2Settings
from nablahog.paper.table2 import PoseJob

from ...paper import test_pascal3d
from ...paper.common import ThisProcess
from ..common import TETRAHEDRON, names

TABLES = ["failures.csv", "index.html", "per_object.csv", "summary.csv", "work"]


NONE = ["--conditions", "none"]
HEADS = "image,x0,y0,x1,y1,azimuth,elevation,theta,model"


def _guess(problem: PoseInput, settings: Table2Settings) -> PoseOutcome:
    azimuth, elevation = problem.initial or (0.0, 0.0)
    return PoseOutcome(azimuth, elevation, 3.0, 0.0, 0.0, 0.0, 100.0, ",".join(problem.models), 0.5)


def _none(problem: PoseInput, settings: Table2Settings) -> PoseOutcome:
    raise ValueError("no detection")


def _box(problem: PoseInput, result: PoseOutcome) -> Tensor:
    covered = torch.zeros(problem.image.shape[1:])
    if problem.box is not None:
        x0, y0, x1, y1 = (max(0, round(side)) for side in problem.box)
        covered[y0:y1, x0:x1] = 1
    return covered


@pytest.fixture(autouse=True)
def fast(here: None, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, method in list(POSE_METHODS.items()):
        run = _none if name == "exemplar" else _guess
        monkeypatch.setitem(POSE_METHODS, name, PoseMethod(name, method.about, run))
    monkeypatch.setattr(table2, "coverage", _box)


@pytest.fixture
def models(tmp_path: Path) -> str:
    folder = tmp_path / "my models"
    folder.mkdir()
    for name in "abc":
        (folder / f"{name}.off").write_text(TETRAHEDRON)
    (folder / "bad.off").write_text("hello")
    return str(folder)


def _rows(path: Path) -> list[dict[str, str]]:
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
def test_scenes_of_procedural_chairs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert main(["table2", "-o", str(out), "--objects", "3", "--methods", "paper,exemplar", "--workers", "1"]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    for text in ("Ran: exemplar, paper", "3 scenes of 24 procedural chairs", "Failed: 0000, exemplar: no detection"):
        assert text in printed.out
    assert str(out / "index.html") in printed.out
    assert names(out) == TABLES
    rows = [row for row in _rows(out / "per_object.csv") if "/" not in row["object"]]
    assert [row["object"] for row in rows] == ["0000", "0001", "0002"]
    assert all(row["model"] == row["found_model"] for row in rows)
    assert all(abs(float(row["true_elevation"]) - float(row["elevation"])) <= 5 for row in rows)
    assert len(_rows(out / "failures.csv")) == 3 + 3 * len(CONDITIONS)


def test_models_and_viewpoints_of_mine(tmp_path: Path, models: str, capsys: pytest.CaptureFixture[str]) -> None:
    viewpoints = tmp_path / "mine.csv"
    viewpoints.write_text("azimuth,elevation\n10,5\n200,6\n")
    options = ["--models", models, "--viewpoints", str(viewpoints), "--objects", "4", "--methods", "best"]
    assert main(["table2", "-o", str(tmp_path / "out"), *options, "--unknown-model", *NONE]) == 0
    printed = capsys.readouterr().out
    assert "4 scenes of 3 models of the folder my models, seen from 2 viewpoints of mine.csv" in printed
    assert "compared with all models but its own" in printed
    assert "Skipped: bad: " in printed
    for row in _rows(tmp_path / "out" / "per_object.csv"):
        assert row["found_model"] == ",".join(sorted({*"abc"} - {row["model"]}))
        assert (row["true_azimuth"], row["true_elevation"]) in (("10.0", "5.0"), ("200.0", "6.0"))


def test_on_a_cluster(tmp_path: Path, models: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Workers get the files of the models, and find the folder that they share."""
    out, files, shared = tmp_path / "out", [tmp_path], []

    def begin(job: PoseJob) -> None:
        files[:] = job.files()
        shared.append((out / "exemplars").is_dir())

    monkeypatch.setattr(runner, "open_executor", lambda *_: nullcontext(ThisProcess(begin)))
    command = ["table2", "-o", str(out), "--models", models, "--objects", "1", "--methods", "paper", "--unknown-model"]
    for _ in range(2):  # the second time nothing is left to do
        assert main([*command, *NONE, "--cluster", "tcp://of-these-tests:1"]) == 0
    assert [path.name for path in files] == ["a.off", "b.off"]  # it is a scene of the third
    assert shared == [True]


voc_and_pascal3d = test_pascal3d.published


@pytest.fixture
def published(voc_and_pascal3d: tuple[Path, Path]) -> list[str]:
    """Photographs of chairs, two of which are selected, and their CAD models."""
    voc, pascal3d = voc_and_pascal3d
    (pascal3d / "CAD" / "chair").mkdir(parents=True)
    for name in ("03", "11"):
        (pascal3d / "CAD" / "chair" / f"{name}.off").write_text(TETRAHEDRON)
    return ["--pascal3d", str(voc), str(pascal3d)]


def test_photographs(tmp_path: Path, published: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["table2", "-o", str(tmp_path / "out"), *published, "--methods", "paper"]) == 0
    printed = capsys.readouterr().out
    assert "2 objects of 1 photograph" in printed
    assert "Failed: e, all methods: e.mat: expected a MATLAB file" in printed
    rows = _rows(tmp_path / "out" / "per_object.csv")
    assert [(row["object"], row["model"], row["found_model"], row["true_azimuth"]) for row in rows] == [
        ("a#1", "03", "03,11", "317.5"),
        ("a#3", "11", "03,11", "315.0"),
    ]
    options = [*published, "--methods", "paper", "--unknown-model", "--objects", "1"]
    assert main(["table2", "-o", str(tmp_path / "out"), *options]) == 0
    (row,) = _rows(tmp_path / "out" / "per_object.csv")
    assert row["found_model"] == "11"


@pytest.fixture
def own(tmp_path: Path) -> str:
    """A file with three objects in two photographs."""
    folder = tmp_path / "my photos"
    folder.mkdir()
    for name in ("one.png", "two.jpg"):
        Image.fromarray(np.full((60, 80, 3), 99, np.uint8)).save(folder / name)
    lines = ["one.png,0,0,40,60,30,10,0,a", "one.png,40,5,80,60,200,20,-3,", "two.jpg,10,10,70,50,-10,5,1,b"]
    (folder / "objects.csv").write_text("\n".join([HEADS, *lines]))
    return str(folder / "objects.csv")


def test_photographs_of_mine(tmp_path: Path, own: str, models: str, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    command = ["table2", own, "-o", str(out), "--methods", "paper"]
    assert main([*command, "--models", models, "--unknown-model", "--conditions", "all"]) == 0
    printed = capsys.readouterr().out
    assert "3 objects in photographs of the folder my photos" in printed
    assert "3 models, without its own" in printed
    rows = {row["object"]: row for row in _rows(out / "per_object.csv")}
    assert [rows[name]["found_model"] for name in ("one.png#1", "one.png#2", "two.jpg#3")] == ["b,c", "a,b,c", "a,c"]
    assert [rows[name]["true_azimuth"] for name in ("one.png#1", "two.jpg#3")] == ["30.0", "350.0"]
    conditions = {row["condition"] for row in _rows(out / "summary.csv")} - {""}
    assert {row["condition"] for row in _rows(out / "summary.csv") if row["paper"]} == {""}
    assert conditions == {name for name in CONDITIONS if CONDITIONS[name].of_photographs} - {"exact"}
    assert "cut-30/two.jpg#3" in rows

    Path(own).write_text(f"{HEADS}\none.png,0,0,40,60,30,10,0,\n")
    assert main(command) == 0
    [row] = _rows(out / "per_object.csv")  # harder conditions only if asked for
    assert len(row["found_model"].split(",")) == 40
    assert names(out) == TABLES


@pytest.mark.slow
def test_conditions_and_a_repeated_run(tmp_path: Path, models: str) -> None:
    out = tmp_path / "out"
    options = ["--models", models, "--conditions", "tilted,exact", "--objects", "2"]
    command = ["table2", "-o", str(out), *options, "--methods", "best"]
    assert main(command) == 0
    rows = _rows(out / "per_object.csv")
    objects = ["0000", "0001", "tilted/0000", "tilted/0001", "exact/0000", "exact/0001"]
    assert [row["object"] for row in rows] == objects
    assert 12 <= abs(float(rows[2]["true_theta"])) <= 45
    before = {path.name: path.stat().st_mtime_ns for path in (out / "work" / "best").iterdir()}
    assert main(command) == 0  # nothing is done again
    assert {path.name: path.stat().st_mtime_ns for path in (out / "work" / "best").iterdir()} == before


def test_refusals(tmp_path: Path, models: str, own: str, published: list[str], refused: Callable[..., None]) -> None:
    to = ["table2", "-o", str(tmp_path / "out")]
    refused(*to, *published, "--viewpoints", "v.csv", message="--viewpoints is for rendered scenes", status=2)
    refused(*to, "--pascal3d", models, published[2], message="expected the folder VOC2012 of PASCAL VOC")
    refused(*to, "--models", f"{models}x", message="no such folder")
    (tmp_path / "few").mkdir()
    (tmp_path / "few" / "a.off").write_text(TETRAHEDRON)
    refused(*to, "--models", str(tmp_path / "few"), "--unknown-model", message="at least 2 models to leave one out")
    refused(*to, "--methods", "hog", message="expected methods such as ", status=2)
    refused(*to, "--conditions", "fog", message="expected conditions such as ", status=2)
    refused(
        *to,
        *published,
        "--conditions",
        "exact",
        message="objects of --pascal3d are cut out along their boxes",
        status=2,
    )
    refused(*to, own, *published, message="got both", status=2)
    refused(*to, own, "--models", models, "--conditions", "steep", message="steep is for rendered scenes", status=2)
    refused(*to, str(tmp_path / "no.csv"), message="no.csv: no such file")


def test_no_pose_at_all(tmp_path: Path, models: str, refused: Callable[..., None]) -> None:
    options = ["--models", models, "--objects", "1", "--methods", "exemplar"]
    message = "no object has a pose; the first: 0000: no detection"
    refused("table2", "-o", str(tmp_path / "out"), *options, message=message)
