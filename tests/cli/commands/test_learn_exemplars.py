"""`nablahog learn exemplars` as people use, misuse and repeat it."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from pathlib import Path
from typing import Any

import pytest
import trimesh

from nablahog.cli.commands import learn_exemplars
from nablahog.cli.commands.learn_exemplars import ExemplarJob
from nablahog.cli.main import main
from nablahog.io.sample_photographs import sample_photograph
from nablahog.jobs.store import Work
from nablahog.jobs.worker import attempt
from nablahog.paper import exemplar_views as learning
from nablahog.paper.exemplar_views import SPEC, ExemplarLibrary, ViewSampling
from nablahog.pose.background import default_background, learn_background
from nablahog.render import load_mesh

from ...chairs import chair
from ..common import names

POSES = ViewSampling(azimuths=(0, 75), elevations=(20,)).poses()


@pytest.fixture
def models(tmp_path: Path) -> str:
    """Two procedural chairs."""
    folder = tmp_path / "models"
    folder.mkdir()
    for seed in (1, 4):
        mesh = chair(seed)
        trimesh.Trimesh(mesh.vertices.numpy(), mesh.faces.numpy(), process=False).export(folder / f"{seed}.off")
    return str(folder)


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """In this process, two views of each model."""

    def run(jobs: Sequence[Work[Any]], workers: int, cluster: str | None) -> Generator[tuple[int, Any], None, None]:
        yield from ((index, attempt(job)) for index, job in enumerate(jobs))

    monkeypatch.setattr(learn_exemplars, "run_anywhere", run)
    monkeypatch.setattr(learning.ViewSampling, "poses", lambda self: POSES)


def test_learning(tmp_path: Path, models: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path(models, "3.off").write_text("OFF\n3 1 0\n")
    Path(models, "notes.txt").touch()
    out = tmp_path / "new" / "exemplars"
    command = ["learn", "exemplars", "--models", models, "-o", str(out)]
    assert main(command) == 0
    printed = capsys.readouterr()
    library = ExemplarLibrary(out, default_background(SPEC))
    views = [library.views(load_mesh(Path(models, f"{seed}.off"))) for seed in (1, 4)]
    assert len(names(out)) == 2  # these
    assert [len(each.viewpoints) for each in views] == [2, 2]
    assert printed.err == ""
    lines = printed.out.splitlines()
    assert lines[0].startswith("Passed over: 3: ")
    assert lines[1:] == [
        "Passed over, as no models by their endings: notes.txt",
        f"Exemplars of 2 models in {out}: {sum(len(each.scale) for each in views)} elements",
    ]


def test_repeated(tmp_path: Path, models: str, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "out"
    command = ["learn", "exemplars", "--models", models, "-o", str(out)]
    assert main(command) == 0
    made = {path.name: path.stat().st_mtime_ns for path in out.iterdir()}
    assert main(command) == 0
    assert {path.name: path.stat().st_mtime_ns for path in out.iterdir()} == made

    def interrupted(*of: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(learning, "learn_views", interrupted)
    (out / sorted(made)[0]).unlink()
    assert main(command) == 130
    assert names(out) == sorted(made)[1:]


def test_another_background(tmp_path: Path, models: str) -> None:
    photograph = sample_photograph("camera")[0]
    path = tmp_path / "b.npz"
    background = learn_background({"camera": photograph}, SPEC)
    background.save(path)
    out = tmp_path / "out"
    assert main(["learn", "exemplars", "--models", models, "-o", str(out), "--background", str(path)]) == 0
    before = names(out)
    ExemplarLibrary(out, background).views(load_mesh(Path(models, "1.off")))
    assert names(out) == before


def test_bad_inputs(tmp_path: Path, models: str, refused: Callable[..., None]) -> None:
    learn = ["learn", "exemplars", "--models"]
    to = ["-o", str(tmp_path / "out")]
    refused(*learn, f"{models}x", *to, message=f"{models}x: no such folder")
    refused(*learn, f"{models}/1.off", *to, message="expected a folder of CAD models, got a file")
    refused(*learn, str(tmp_path), *to, "--workers", "0", message="at least 1, got '0'", status=2)
    refused("learn", "exemplars", *to, message="required: --models", status=2)
    refused(*learn, models, "-o", f"{models}/1.off", message="is not a folder")
    refused(*learn, models, *to, "--background", f"{models}/b.npz", message="b.npz: no such file")
    other = tmp_path / "b.npz"
    learn_background({"": sample_photograph("camera")[0]}, learning.aubry(8)).save(other)
    refused(*learn, models, *to, "--background", str(other), message=f"{other}: the background was learned for another")
    for file in Path(models).iterdir():
        file.write_text("OFF\n3 1 0\n")
    refused(*learn, models, *to, message=f"{models}: no model is usable; the first: 1: ")


def test_the_result_of_a_job(tmp_path: Path, models: str) -> None:
    """The file of the views; nothing of those that are stored already."""
    mesh = load_mesh(Path(models, "1.off"))
    library = ExemplarLibrary(tmp_path, default_background(SPEC))
    key, contents = ExemplarJob(Path(models, "1.off"), None, frozenset()).run()
    library.views(mesh)
    assert contents == (tmp_path / f"{key}.npz").read_bytes()
    assert ExemplarJob(Path(models, "1.off"), None, frozenset([key])).run() == (library.key(mesh), b"")
