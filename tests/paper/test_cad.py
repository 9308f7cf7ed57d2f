"""Folders of CAD models: which files count, what they are called, what fails."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from nablahog.paper.cad import read_models

TRIANGLE = "OFF 3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
OBJ = "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def _fill(folder: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


def test_models_here_and_one_folder_below(tmp_path: Path) -> None:
    _fill(tmp_path, {"02.off": TRIANGLE, "01.off": TRIANGLE, "chair/b.OFF": TRIANGLE, "chair/deep/c.off": TRIANGLE})
    models = read_models(tmp_path)
    assert list(models.paths) == ["01", "02", "chair/b"]
    assert models.paths["chair/b"] == tmp_path / "chair" / "b.OFF"
    assert models.ignored == ["chair/deep"]
    assert [(name, len(mesh.faces)) for name, mesh in models.meshes()] == [("01", 1), ("02", 1), ("chair/b", 1)]


def test_materials_belong_to_their_model(tmp_path: Path) -> None:
    _fill(
        tmp_path, {"a/a.obj": OBJ, "a/a.mtl": "newmtl m\nKd 1 1 1\n", "a/wood.jpg": "", "a/read.me": "", ".h.off": ""}
    )
    models = read_models(tmp_path)
    assert list(models.paths) == ["a/a"]
    assert models.ignored == ["a/read.me"]
    [(_, mesh)] = models.meshes()
    assert float(mesh.brightness.min()) == pytest.approx(1)


def test_same_names_keep_their_endings(tmp_path: Path) -> None:
    _fill(tmp_path, {"a.off": TRIANGLE, "a.obj": OBJ, "b.off": TRIANGLE})
    assert list(read_models(tmp_path).paths) == ["a.obj", "a.off", "b"]


def test_what_fails_is_noted_and_passed_over(tmp_path: Path) -> None:
    _fill(tmp_path, {"a.off": "OFF 3 1 0\n", "b.off": TRIANGLE})
    models = read_models(tmp_path)
    assert models.failed == {}
    assert [name for name, _ in models.meshes()] == ["b"]
    assert list(models.failed) == ["a"]
    assert models.failed["a"].startswith("expected a mesh in the format OFF")


def test_names_of_any_bytes(tmp_path: Path) -> None:
    try:
        (Path(os.fsdecode(os.fsencode(tmp_path) + b"/si\xe8ge.off"))).write_text(TRIANGLE)
    except OSError:
        pytest.skip("this file system takes UTF-8 names only")
    [name] = read_models(tmp_path).paths
    assert name == "si\\xe8ge"


def test_no_models(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="no such folder"):
        read_models(tmp_path / "none")
    path = tmp_path / "a.off"
    path.write_text(TRIANGLE)
    with pytest.raises(NotADirectoryError, match="got a file"):
        read_models(path)
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / "folder.off").mkdir()
    with pytest.raises(ValueError, match="but it holds none"):
        read_models(tmp_path / "empty")
