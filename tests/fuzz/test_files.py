"""No damaged file crashes a reader, takes long or much memory, or is refused in words that say nothing."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

import pytest
from hypothesis import strategies as st

from tests.render.mesh_files import CUBE_OFF, TRIANGLE, VERTICES_OBJ, glb

from .file_mutations import mutated
from .file_seeds import seeds
from .harness import check_sentence, examine, parts
from .reading import Answer, Reader

SECONDS = 5.0  # of the processor until a file is refused
BYTES = 2**30  # beyond the process at the start, until a file is refused
CORPUS = sorted(Path(__file__).parent.joinpath("corpus", "files").iterdir())
LINES = 100_000
NODES = 10_000
cases = st.deferred(lambda: st.tuples(st.integers(0, len(seeds()) - 1), st.integers(0, 2**48)))
reader = cache(Reader)
folder = cache(TemporaryDirectory)


def read(kind: str, ending: str, data: bytes) -> Answer:
    path = Path(folder().name, f"case{ending}")
    path.write_bytes(data)
    return reader().read(kind, path)


def check(kind: str, ending: str, data: bytes) -> str:
    """Reads a file: ``read`` or ``refused``, in a sentence, in little time and memory."""
    answer = read(kind, ending, data)
    assert answer.outcome in ("read", "refused"), answer.message
    if answer.outcome == "refused":
        check_sentence(answer.message)
        assert answer.seconds <= SECONDS
        assert answer.bytes <= BYTES
    return answer.outcome


def check_mutated(case: tuple[int, int]) -> str:
    """A damaged copy of the seed of one number, by the random numbers of another."""
    seed = seeds()[case[0]]
    return check(seed.reader, seed.ending, mutated(seed, Random(case[1])))


def _many_nodes() -> bytes:
    """A mesh of many vertices without bytes, in many places."""
    return glb(
        {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": list(range(NODES))}],
            "nodes": [{"mesh": 0}] * NODES,
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
            "accessors": [
                {"componentType": 5126, "type": "VEC3", "count": 50_000},
                {"componentType": 5121, "type": "SCALAR", "bufferView": 0, "count": 3},
            ],
            "bufferViews": [{"buffer": 0, "byteLength": 36}],
            "buffers": [{"byteLength": 36}],
        },
        bytes(36),
    )


LARGE: dict[str, Callable[[], tuple[str, str, bytes]]] = {
    "blank lines": lambda: ("mesh", ".obj", (TRIANGLE + "\n" * LINES + "f -1 -2 -3\n").encode()),
    "spaces": lambda: ("mesh", ".obj", (TRIANGLE + "f " + " " * LINES + "x\n").encode()),
    "folders": lambda: ("mesh", ".obj", ("mtllib " + "a/" * 4 * LINES + "\n" + VERTICES_OBJ).encode()),
    "comments": lambda: ("mesh", ".off", ("#\n" * LINES + "x" + CUBE_OFF).encode()),
    "solids": lambda: ("mesh", ".stl", b"solid a\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendsolid\n" * 16_000),
    "instances": lambda: ("mesh", ".glb", _many_nodes()),
    "columns": lambda: ("viewpoints", ".csv", b"azimuth,elevation" + b",a" * LINES + b"\n" + b"1,2\n" * 1000),
}


@pytest.mark.parametrize("path", CORPUS, ids=lambda path: path.name)
def test_what_found_something(path: Path) -> None:
    assert check(path.name.partition("-")[0], path.suffix, path.read_bytes()) == "refused"


@pytest.mark.parametrize("name", LARGE)
def test_large_files(name: str) -> None:
    check(*LARGE[name]())


@pytest.mark.parametrize("name", ["image.png", "descriptor.npz", "descriptor.npy", "mesh.off", "viewpoints.csv"])
def test_a_pipe_is_refused_at_once(name: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / name)
    assert reader().read(name.partition(".")[0], tmp_path / name).outcome == "refused"


@parts
def test_damaged_files(part: int) -> None:
    outcomes = examine(check_mutated, cases, 300, part)
    assert min(outcomes["read"], outcomes["refused"]) > 30


def test_a_process_that_ends_is_a_crash() -> None:
    assert read("viewpoints", ".csv", b"azimuth,elevation\n1,2\n").outcome == "read"
    reader().process.kill()
    assert read("viewpoints", ".csv", b"azimuth,elevation\n1,2\n").outcome == "crashed"
