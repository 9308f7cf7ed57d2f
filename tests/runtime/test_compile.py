"""A compiled function is compiled again when something it depends on in another file changes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

INNER = """
from nablahog.runtime.compile import compiled

@compiled
def inner(x):
    return {body}
"""
OUTER = """
from nablahog.runtime.compile import compiled
from inner import inner

@compiled
def outer(x):
    \"\"\"Twice.\"\"\"
    return 2 * inner(x)
"""


TUPLE = """
from typing import NamedTuple

class Pair(NamedTuple):
    {fields}
"""
MAKER = """
from nablahog.runtime.compile import compiled
from pair import Pair

@compiled
def first(x):
    return Pair(x, 2 * x).first

print(first(5.0))
"""


def ask(folder: Path) -> str:
    program = "from outer import outer; print(outer.__doc__, outer(5.0))"
    ran = subprocess.run([sys.executable, "-c", program], cwd=folder, capture_output=True, text=True, check=True)
    return ran.stdout.strip()


def test_of_functions_that_it_calls(tmp_path: Path) -> None:
    (tmp_path / "outer.py").write_text(OUTER)
    (tmp_path / "inner.py").write_text(INNER.format(body="x + 1"))
    assert ask(tmp_path) == "Twice. 12.0"
    cached = list((tmp_path / "__pycache__").glob("outer.outer*.nbi"))
    assert len(cached) == 1
    assert ask(tmp_path) == "Twice. 12.0"
    assert list((tmp_path / "__pycache__").glob("outer.outer*.nbi")) == cached
    (tmp_path / "inner.py").write_text(INNER.format(body="x + 10"))
    assert ask(tmp_path) == "Twice. 30.0"


TAKER = """
from nablahog.runtime.compile import compiled
from pair import Pair

@compiled
def take(pair: Pair) -> float:
    return pair.first

print(take(Pair(5.0, 10.0)))
"""


def test_of_tuples_that_it_takes(tmp_path: Path) -> None:
    """They have the same types in another order."""
    (tmp_path / "taker.py").write_text(TAKER)
    for fields, expected in (("first: float; second: float", "5.0\n"), ("second: float; first: float", "10.0\n")):
        (tmp_path / "pair.py").write_text(TUPLE.format(fields=fields))
        program = [sys.executable, "-B", "-c", "import taker"]
        assert subprocess.run(program, cwd=tmp_path, capture_output=True, text=True, check=True).stdout == expected


def test_what_cannot_be_read_is_compiled_again(tmp_path: Path) -> None:
    (tmp_path / "outer.py").write_text(OUTER)
    (tmp_path / "inner.py").write_text(INNER.format(body="x + 1"))
    assert ask(tmp_path) == "Twice. 12.0"
    for pattern in ("*.nbi", "*.nbc"):
        (damaged,) = (tmp_path / "__pycache__").glob(f"outer.outer{pattern}")
        damaged.write_bytes(damaged.read_bytes()[:-9])
        assert ask(tmp_path) == "Twice. 12.0"


def test_of_tuples_that_it_makes(tmp_path: Path) -> None:
    (tmp_path / "maker.py").write_text(MAKER)
    for fields, expected in (("first: float; second: float", "5.0\n"), ("second: float; first: float", "10.0\n")):
        (tmp_path / "pair.py").write_text(TUPLE.format(fields=fields))
        program = [sys.executable, "-B", "maker.py"]
        assert subprocess.run(program, cwd=tmp_path, capture_output=True, text=True, check=True).stdout == expected
