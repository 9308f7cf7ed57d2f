"""The script of the pages: the order in which it sorts rows.  Whether it moves them only a browser can tell."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from nablahog.viz import html

SCRIPT = Path(html.__file__).with_name("templates").joinpath("page.js").read_text()


@pytest.mark.skipif(shutil.which("node") is None, reason="no program here that runs JavaScript")
@pytest.mark.parametrize(
    ("values", "numeric", "down", "order"),
    [
        (["10", "", "9.5", "-1", "1e-07"], True, True, ["10", "9.5", "1e-07", "-1", ""]),
        (["10", "", "9.5", "-1", "1e-07"], True, False, ["-1", "1e-07", "9.5", "10", ""]),
        (["b", "", "a"], False, False, ["", "a", "b"]),
        (["b", "", "a"], False, True, ["b", "a", ""]),
    ],
)
def test_the_order_of_rows(values: list[str], numeric: bool, down: bool, order: list[str]) -> None:
    of = f"{json.dumps(values)}.sort((x, y) => compared(x, y, {json.dumps(numeric)}, {json.dumps(down)}))"
    program = f"const document = {{querySelectorAll: () => []}};\n{SCRIPT}\nconsole.log(JSON.stringify({of}));"
    ran = subprocess.run(["node", "-"], input=program, capture_output=True, text=True, check=True)
    assert json.loads(ran.stdout) == order
