"""Compiled functions that include others are compiled again when those change, though their own file has not."""

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


def ask(folder: Path) -> str:
    program = "from outer import outer; print(outer.__doc__, outer(5.0))"
    ran = subprocess.run([sys.executable, "-c", program], cwd=folder, capture_output=True, text=True, check=True)
    return ran.stdout.strip()


def test_what_is_kept_follows_what_is_included(tmp_path: Path) -> None:
    (tmp_path / "outer.py").write_text(OUTER)
    (tmp_path / "inner.py").write_text(INNER.format(body="x + 1"))
    assert ask(tmp_path) == "Twice. 12.0"
    kept = list((tmp_path / "__pycache__").glob("outer.outer*.nbi"))
    assert len(kept) == 1
    assert ask(tmp_path) == "Twice. 12.0"
    assert list((tmp_path / "__pycache__").glob("outer.outer*.nbi")) == kept
    (tmp_path / "inner.py").write_text(INNER.format(body="x + 10"))
    assert ask(tmp_path) == "Twice. 30.0"
