"""No damaged file crashes a reader, takes long or much memory, or is refused in words that say nothing."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.render.mesh_files import CUBE_OFF, TRIANGLE, VERTICES_OBJ, glb

from . import files
from .files import FileCase
from .harness import Fault, campaign

CORPUS = files.corpus()
LINES = 100_000
NODES = 10_000


def _many_nodes(count: int) -> bytes:
    """A mesh of so many vertices without bytes, in many places."""
    return glb(
        {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": list(range(NODES))}],
            "nodes": [{"mesh": 0}] * NODES,
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
            "accessors": [
                {"componentType": 5126, "type": "VEC3", "count": count},
                {"componentType": 5121, "type": "SCALAR", "bufferView": 0, "count": 3},
            ],
            "bufferViews": [{"buffer": 0, "byteLength": 36}],
            "buffers": [{"byteLength": 36}],
        },
        bytes(36),
    )


LARGE: dict[str, Callable[[], FileCase]] = {
    "blank lines": lambda: FileCase("mesh", ".obj", (TRIANGLE + "\n" * LINES + "f -1 -2 -3\n").encode()),
    "spaces": lambda: FileCase("mesh", ".obj", (TRIANGLE + "f " + " " * LINES + "x\n").encode()),
    "folders": lambda: FileCase("mesh", ".obj", ("mtllib " + "a/" * 4 * LINES + "\n" + VERTICES_OBJ).encode()),
    "comments": lambda: FileCase("mesh", ".off", ("#\n" * LINES + "x" + CUBE_OFF).encode()),
    "solids": lambda: FileCase(
        "mesh", ".stl", b"solid a\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendsolid\n" * 16_000
    ),
    "instances": lambda: FileCase("mesh", ".glb", _many_nodes(50_000)),
    "columns": lambda: FileCase("viewpoints", ".csv", b"azimuth,elevation" + b",a" * LINES + b"\n" + b"1,2\n" * 1000),
}


@pytest.mark.parametrize("name", CORPUS)
def test_what_found_something(name: str) -> None:
    assert files.check(CORPUS[name]) == "refused"


@pytest.mark.parametrize("name", LARGE)
def test_large_files(name: str) -> None:
    files.check(LARGE[name]())


def test_a_pipe_is_refused_at_once(tmp_path: Path) -> None:
    for reader, name in (("image", "a.png"), ("descriptor", "a.npz"), ("descriptor", "a.npy"), ("descriptor", "a")):
        os.mkfifo(tmp_path / name)
        assert "special file" in files.server().read_path(reader, tmp_path / name)["message"]
        (tmp_path / name).unlink()
    for reader in ("template", "record", "mesh", "prior", "viewpoints", "annotation"):
        os.mkfifo(tmp_path / "a.off")
        answer = files.server().read_path(reader, tmp_path / "a.off")
        assert answer["outcome"] == "refused"
        (tmp_path / "a.off").unlink()


def test_damaged_files() -> None:
    report = campaign(files.check, files.cases, 300, 0)
    assert not report.faults
    assert min(report.outcomes["read"], report.outcomes["refused"]) > 30


def test_the_corpus_is_small() -> None:
    assert all(len(case.data) <= 10_000 for case in CORPUS.values())


def test_a_process_that_ends_is_a_crash() -> None:
    server, case = files.server(), FileCase("viewpoints", ".csv", b"azimuth,elevation\n1,2\n")
    assert files.check(case) == "read"
    assert server.process is not None
    server.process.kill()
    with pytest.raises(Fault, match="the process ended"):
        files.check(case)
