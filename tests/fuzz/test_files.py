"""No damaged file crashes a reader, takes long or much memory, or is refused without a reason."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

import pytest
from hypothesis import strategies as st

from tests.render.mesh_files import VERTICES_OBJ

from .file_mutations import mutated
from .file_seeds import seeds
from .harness import check_sentence, examine, parts
from .reading import Answer, Reader

SECONDS = 5.0  # of the processor until a file is refused
BYTES = 1_500_000_000  # beyond the process at the start, until a file is refused: decoders take 8 for each pixel
CORPUS = sorted(Path(__file__).parent.joinpath("corpus", "files").iterdir())
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


# meshes that are large for their content: tests/render/test_mesh_refused.py
LARGE: dict[str, Callable[[], tuple[str, str, bytes]]] = {
    "folders": lambda: ("mesh", ".obj", ("mtllib " + "a/" * 400_000 + "\n" + VERTICES_OBJ).encode()),
    "columns": lambda: ("viewpoints", ".csv", b"azimuth,elevation" + b",a" * 100_000 + b"\n" + b"1,2\n" * 1000),
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


@pytest.mark.slow
@parts
def test_damaged_files(part: int) -> None:
    outcomes = examine(check_mutated, cases, 300, part)
    assert min(outcomes["read"], outcomes["refused"]) > 30


def test_a_process_that_ends_is_a_crash() -> None:
    assert read("viewpoints", ".csv", b"azimuth,elevation\n1,2\n").outcome == "read"
    reader().process.kill()
    assert read("viewpoints", ".csv", b"azimuth,elevation\n1,2\n").outcome == "crashed"
