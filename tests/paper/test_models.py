"""Models by name: files and procedural chairs, read once while they are the same."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from nablahog.paper.chairs import library
from nablahog.paper.models import Meshes, Model, chair_library, models_in, procedural_chairs

TETRAHEDRON = "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 {height}\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n"


def test_files(tmp_path: Path) -> None:
    path = tmp_path / "b.off"
    path.write_text(TETRAHEDRON.format(height=1))
    (tmp_path / "a.off").write_text(TETRAHEDRON.format(height=2))
    (tmp_path / "c.off").write_text("hello")
    models, failed = models_in(tmp_path)
    assert models == [Model("a", tmp_path / "a.off"), Model("b", path)]
    assert list(failed) == ["c"]
    mesh, digest = models[1].mesh(), models[1].digest()
    assert mesh.faces.shape == (4, 3)
    assert models[1].mesh() is mesh
    path.write_text(TETRAHEDRON.format(height=3))
    os.utime(path, (0, 0))
    assert models[1].digest() != digest
    assert models[1].mesh() is not mesh


def test_chairs() -> None:
    models = procedural_chairs(2)
    assert [(model.name, model.digest()) for model in models] == [("chair-00", "0"), ("chair-01", "1")]
    assert models[0].mesh() is models[0].mesh()
    assert models[0].mesh().vertices.shape != models[1].mesh().vertices.shape


def test_library() -> None:
    models, meshes = chair_library(), library()
    assert [model.name for model in models] == list(meshes)
    for model in models[::9]:
        assert model.mesh().vertices.equal(meshes[model.name].vertices)
    assert len({model.digest() for model in models}) == len(models)


def test_failures(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="gone"):
        Model("gone", tmp_path / "gone.off").mesh()
    (tmp_path / "bad.off").write_text("hello")
    with pytest.raises(ValueError, match="bad"):
        Model("bad", tmp_path / "bad.off").mesh()
    with pytest.raises(ValueError, match="no model can be read; the first: bad: "):
        models_in(tmp_path)


def test_meshes(tmp_path: Path) -> None:
    """Nothing is read before it is asked for."""
    path = tmp_path / "later.off"
    meshes = Meshes([Model("later", path), Model("chair", 3)])
    assert (list(meshes), len(meshes), "chair" in meshes) == (["later", "chair"], 2, True)
    path.write_text(TETRAHEDRON.format(height=1))
    assert meshes["later"].faces.shape == (4, 3)
