"""Models by name: folders of files, and the chairs that come with the package."""

from __future__ import annotations

import importlib
import os
from pathlib import Path

import numpy as np
import pytest
import torch

from nablahog import Mesh, sample_chairs
from nablahog.paper.scenes import CHAIRS
from nablahog.render.models import (
    SAMPLE_CHAIRS,
    Model,
    archived_models,
    check_models,
    load_meshes,
    read_models,
    save_meshes,
)

TRIANGLE = "OFF 3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
TETRAHEDRON = "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 {height}\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n"
OBJ = "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
EXAMPLES = Path(__file__).parents[2] / "examples"


def _fill(folder: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


def test_models_here_and_below(tmp_path: Path) -> None:
    shapenet = "03001627/1006be/models/model_normalized"
    files = {
        "02.off": TRIANGLE,
        "01.off": TRIANGLE,
        "chair/b.OFF": TRIANGLE,
        f"{shapenet}.obj": OBJ,
        "1/2/3/4/5/c.off": OBJ,
    }
    models, ignored = read_models(_fill(tmp_path, {**files, ".hidden/d.off": TRIANGLE, "notes": ""}))
    assert [model.name for model in models] == ["01", "02", shapenet, "chair/b"]
    assert models[3].file == tmp_path / "chair" / "b.OFF"
    assert ignored == ["notes"]
    assert [len(model.mesh().faces) for model in models] == [1] * 4


def test_materials_belong_to_their_model(tmp_path: Path) -> None:
    white = "newmtl m\nKd 1 1 1\n"
    files = {"a/a.obj": OBJ, "a/a.mtl": white, "a/wood.jpg": "", "a/read.me": ""}
    (model,), ignored = read_models(_fill(tmp_path, files))
    assert (model.name, ignored) == ("a/a", ["a/read.me"])
    assert float(model.mesh().brightness.min()) == pytest.approx(1)


def test_same_names_keep_their_endings(tmp_path: Path) -> None:
    _fill(tmp_path, {"a.off": TRIANGLE, "a.obj": OBJ, "b.off": TRIANGLE})
    assert [model.name for model in read_models(tmp_path)[0]] == ["a.obj", "a.off", "b"]


def test_no_models(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="no such folder"):
        read_models(tmp_path / "none")
    with pytest.raises(ValueError, match="but it holds none"):
        read_models(tmp_path)
    _fill(tmp_path, {"bad.off": "hello"})
    _fill(tmp_path, {"worse.off": "hello"})
    with pytest.raises(ValueError, match=r"no model can be read; the first: .*bad\.off: "):
        check_models(read_models(tmp_path)[0])


def test_files_are_read_again_when_they_change(tmp_path: Path) -> None:
    heights = {"a": 2, "b": 1}
    _fill(tmp_path, {f"{name}.off": TETRAHEDRON.format(height=height) for name, height in heights.items()})
    _fill(tmp_path, {"c.off": "hello"})
    models, failed = check_models(read_models(tmp_path)[0])
    assert models == [Model("a", tmp_path / "a.off"), Model("b", tmp_path / "b.off")]
    assert list(failed) == ["c"]
    mesh = models[1].mesh()
    assert models[1].mesh() is mesh
    _fill(tmp_path, {"b.off": TETRAHEDRON.format(height=3)})
    os.utime(tmp_path / "b.off", (0, 0))
    assert models[1].mesh() is not mesh


def test_axes_of_a_file(tmp_path: Path) -> None:
    (model,), _ = read_models(_fill(tmp_path, {"a.off": TETRAHEDRON.format(height=2)}), up="y", front="+z")
    assert not torch.equal(model.mesh().vertices, Model("a", model.file).mesh().vertices)


def test_chairs_that_come_with_the_package() -> None:
    chairs = sample_chairs()
    assert [model.name for model in archived_models(SAMPLE_CHAIRS)] == list(chairs)
    assert archived_models(SAMPLE_CHAIRS)[5].mesh() is chairs["wooden-5"]
    with pytest.raises(ValueError, match="expected a mesh archive that has x"):
        Model("x", SAMPLE_CHAIRS).mesh()
    for name, mesh in chairs.items():
        low, high = mesh.vertices.amin(0), mesh.vertices.amax(0)
        torch.testing.assert_close(low, -high, atol=1e-6, rtol=0)
        assert float((high - low).norm()) == pytest.approx(1)
        top = mesh.vertices[mesh.vertices[:, 2] > 0.42 * float((high - low)[2])]
        if not name.startswith(("stool", "bench")):
            assert float(top[:, 1].mean()) > 0.05, name  # the back is behind


@pytest.mark.parametrize(
    ("name", "file", "seed", "kind"), [("swivel-2", SAMPLE_CHAIRS, 2, "swivel"), ("chair-03", CHAIRS, 3, None)]
)
def test_they_are_those_of_the_generator(
    name: str, file: Path, seed: int, kind: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(EXAMPLES / "chairs")
    expected = importlib.import_module("chairs").chair(seed, kind)
    mesh = Model(name, file).mesh()
    torch.testing.assert_close(mesh.vertices, expected.vertices, atol=1e-7, rtol=0)
    torch.testing.assert_close(mesh.brightness, expected.brightness, atol=1e-7, rtol=0)
    assert torch.equal(mesh.faces, expected.faces)


def test_archives_of_meshes(tmp_path: Path) -> None:
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1], [0.5, 0, 2]])
    meshes = {"a": Mesh(corners[:3], [[0, 1, 2]], [0.5] * 3), "b": Mesh(corners, [[0, 1, 2], [1, 2, 3]], [0.25] * 4)}
    save_meshes(tmp_path / "m.npz", meshes)
    for name, mesh in load_meshes(tmp_path / "m.npz").items():
        assert all(torch.equal(getattr(mesh, of), getattr(meshes[name], of)) for of in ("vertices", "faces"))
    most, many = (Mesh(np.resize(corners, (n, 3)), [[0, 1, n - 1]], np.zeros(n)) for n in (2**16, 2**16 + 1))
    save_meshes(tmp_path / "most.npz", {"a": most})
    assert torch.equal(load_meshes(tmp_path / "most.npz")["a"].faces, most.faces)
    with pytest.raises(OverflowError, match="at most 65,536 vertices"):
        save_meshes(tmp_path / "many.npz", {"a": many})
    (tmp_path / "bad.npz").write_bytes((tmp_path / "m.npz").read_bytes()[:200])
    with pytest.raises(ValueError, match=r"bad\.npz: expected a mesh archive"):
        load_meshes(tmp_path / "bad.npz")
