"""The script of the pages: what it looks for is there, and the order in which it sorts rows.

Whether it moves them, and the slider, only a browser can tell.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from nablahog.viz import html
from nablahog.viz.pictures import Panel
from nablahog.viz.svg import Drawing

TEMPLATES = Path(html.__file__).with_name("templates")
SCRIPT = (TEMPLATES / "page.js").read_text()

Element = tuple[str, frozenset[str]]


class _Elements(HTMLParser):
    """All elements of a page, each as the path to it: tags with their classes."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.path: list[Element] = []
        self.paths: list[list[Element]] = []
        self.values: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.path.append((tag, frozenset((given.get("class") or "").split())))
        self.paths.append([*self.path])
        if "number" in self.path[-1][1] and "data-value" in given:
            self.values.append(given["data-value"] or "")
        if tag in ("meta", "img", "input"):
            self.path.pop()

    def handle_endtag(self, tag: str) -> None:
        self.path.pop()

    def has(self, selector: str) -> bool:
        """Whether an element matches a selector of tags, classes, ``:not(.class)`` and ancestors."""
        *ancestors, last = selector.split()
        return any(
            _matches(path[-1], last) and all(any(_matches(each, one) for each in path[:-1]) for one in ancestors)
            for path in self.paths
        )


def _matches(element: Element, selector: str) -> bool:
    tag, classes = element
    wanted, unwanted = re.fullmatch(r"([\w.]+)(?::not\(\.(\w+)\))?", selector).groups()  # type: ignore[union-attr]
    of_tag, *of_class = wanted.split(".")
    return of_tag in ("", tag) and classes.issuperset(of_class) and unwanted not in classes


@pytest.fixture(scope="module")
def page() -> str:
    picture = Panel(np.eye(4), "picture")
    sections = [
        html.Section("", "", drawings=[Drawing(9, 9, "", "")]),
        html.Section("", "", table=[{"image": picture, "x": None}]),
    ]
    rows = [{"name": "group"}, {"name": "a", "x": 1e-7}, {"name": "b", "x": float("nan")}, {"name": "c", "x": None}]
    return html.page("", "", rows, sections, {}, first=html.Section("", "", compared=(picture, picture)))


def test_what_the_script_looks_for_is_there(page: str) -> None:
    elements = _Elements(page)
    selectors = [
        part.strip() for group in re.findall(r'querySelector(?:All)?\("([^"]+)"\)', SCRIPT) for part in group.split(",")
    ]
    assert {".wipe", "table:not(.grid)", "thead th", ".table", ".drawings figure"} <= {*selectors}
    for selector in selectors:
        assert elements.has(selector), selector
    for name in re.findall(r'classList\.contains\("(\w+)"\)', SCRIPT):
        assert elements.has(f".{name}"), name
    style = (TEMPLATES / "page.css").read_text()
    for name in re.findall(r'(?:className = |classList\.toggle\()"(\w+)"', SCRIPT):
        assert f".{name}" in style, name
    assert "var(--at)" in style
    assert 'setProperty("--at"' in SCRIPT


def test_numbers_are_sorted_by_their_values(page: str) -> None:
    assert _Elements(page).values == ["1e-07", "", "", ""]


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
