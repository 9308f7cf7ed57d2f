"""A compiled function is compiled again when something it depends on in another file changes."""

from __future__ import annotations

import os
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


def run(folder: Path, program: str) -> str:
    """What a program prints whose modules and machine code are in a folder."""
    environment = os.environ | {"NABLAHOG_CACHE_DIR": str(folder)}
    command = [sys.executable, "-B", "-c", program]
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=True
    ).stdout.strip()


def ask(folder: Path) -> str:
    return run(folder, "from outer import outer; print(outer.__doc__, outer(5.0))")


def test_of_functions_that_it_calls(tmp_path: Path) -> None:
    (tmp_path / "outer.py").write_text(OUTER)
    (tmp_path / "inner.py").write_text(INNER.format(body="x + 1"))
    assert ask(tmp_path) == "Twice. 12.0"
    cached = list((tmp_path / "machine-code").glob("outer-*.code"))
    assert len(cached) == 1
    when = cached[0].stat().st_mtime_ns
    assert ask(tmp_path) == "Twice. 12.0"
    assert list((tmp_path / "machine-code").glob("outer-*.code")) == cached
    assert cached[0].stat().st_mtime_ns == when
    for body, expected in (("x + 10", "30.0"), ("abs(x - 10)", "10.0"), ("float(x - 10)", "-10.0")):
        (tmp_path / "inner.py").write_text(INNER.format(body=body))
        assert ask(tmp_path) == f"Twice. {expected}"


TAKER = """
from nablahog.runtime.compile import compiled
from pair import Pair

@compiled
def take(pairs: tuple[Pair, ...]) -> float:
    return pairs[0].first

print(take((Pair(5.0, 10.0), Pair(0.0, 0.0))))
"""


def test_of_tuples_that_it_takes(tmp_path: Path) -> None:
    """They have the same types in another order."""
    (tmp_path / "taker.py").write_text(TAKER)
    for fields, expected in (("first: float; second: float", "5.0"), ("second: float; first: float", "10.0")):
        (tmp_path / "pair.py").write_text(TUPLE.format(fields=fields))
        assert run(tmp_path, "import taker") == expected


def test_of_tuples_that_it_makes(tmp_path: Path) -> None:
    (tmp_path / "maker.py").write_text(MAKER)
    for fields, expected in (("first: float; second: float", "5.0"), ("second: float; first: float", "10.0")):
        (tmp_path / "pair.py").write_text(TUPLE.format(fields=fields))
        assert run(tmp_path, "import maker") == expected
