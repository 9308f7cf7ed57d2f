"""Pages and drawings: complete, escaped, self-contained, in colours that can be read."""

from __future__ import annotations

import base64
import io
import re
from html.parser import HTMLParser
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

from nablahog.viz.html import COLOURS, Cell, Drawing, Section, Shown, figure, page
from nablahog.viz.pictures import Panel

TABLE = [{"input": "<b>", "CC": 0.12345, "SSIM": None}, {"input": "x", "CC": None, "SSIM": None}]
SECTIONS = [Section("A & B", "text", [Panel(np.eye(4), '"quoted"')])]


class _Balanced(HTMLParser):
    """Fails on tags that are not closed, or closed in another order."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: object) -> None:
        if tag not in ("meta", "img", "input"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_page() -> None:
    html = page("T<", "lead", TABLE, SECTIONS, {"CC": "corr <"}, "foot")
    parser = _Balanced()
    parser.feed(html)
    assert not parser.open
    for text in ("T&lt;", "&lt;b&gt;", "0.123", "A &amp; B", 'alt="&#34;quoted&#34;"', "corr &lt;", "foot"):
        assert text in html
    assert "<b>" not in html
    assert not re.search(r"(src|href)=\"(?!data:)", html)
    (encoded,) = re.findall(r"base64,([^\"]+)", html)
    assert np.asarray(Image.open(io.BytesIO(base64.b64decode(encoded)))).tolist() == (np.eye(4) * 255).tolist()


def test_figures() -> None:
    assert (figure(Shown(0.0004, "< 0.001")), Shown(0.0004, "< 0.001")) == ("< 0.001", 0.0004)
    assert [figure(v) for v in (None, 0.5, 3, "x", float("nan"))] == ["–", "0.500", "3", "x", "nan"]
    assert [figure(v) for v in (9.9994, 47.33, -123.46)] == ["9.999", "47.3", "-123.5"]


def test_remarks_and_headings_in_tables() -> None:
    table = [{"method": "group <1>"}, {"method": "a", "CC": Cell(0.5, "0.4 … 0.6 <")}, {"method": "b", "CC": None}]
    html = page("T", "", table, [], {})
    _Balanced().feed(html)
    assert '<th colspan="2" scope="rowgroup">group &lt;1&gt;</th>' in html
    assert '<td class="number" data-value="0.5">0.500<small>0.4 … 0.6 &lt;</small></td>' in html
    assert '<td class="number" data-value="">–</td>' in html
    counts = [html.count(tag) for tag in ("<tbody>", '<th scope="row">', '<th scope="col"')]
    assert counts == [1, 2, 2]  # rows are sorted within the one body


def test_links() -> None:
    row = {"input": Cell("x <", link="x_1.html"), "CC": Cell(2, link="y.html")}
    html = page("T", "", [row], [], {}, back=("index.html", "all <"))
    _Balanced().feed(html)
    for text in ('<a href="x_1.html">x &lt;</a></th>', 'data-value="2"><a href="y.html">2</a></td>', '">all &lt;</a>'):
        assert text in html


def test_tables_of_pictures() -> None:
    row = {"image": Cell(Panel(np.eye(4), "x <"), "x <"), "found": None}
    html = page("T", "", [], [Section("Pictures", "text", table=[row, {"image": "more"}, row])], {})
    _Balanced().feed(html)
    assert html.count("data:image/png;base64,") == 2
    assert 'alt="x &lt;"' in html
    assert "<small>x &lt;</small>" in html
    assert 'class="grid"' in html
    assert 'class="pictures"' not in html
    assert "<caption>text</caption>" in html


def test_two_pictures_with_a_slider() -> None:
    first = Section("", "drag", compared=(Panel(np.eye(4), "before"), Panel(1 - np.eye(4), "after")))
    html = page("T", "lead", TABLE, [], {}, first=first)
    _Balanced().feed(html)
    assert html.index("lead") < html.index('type="range"') < html.index("<table")
    before, after = re.findall(r"base64,([^\"]+)", html)
    assert before != after
    assert "--at" in html


def test_a_drawing() -> None:
    drawing = Drawing(100, 50, "Title <", "what it shows")
    drawing.line([(0, 1), (2.345, 6)], "curve", 2)
    drawing.dot((5, 5), "path", 3, ringed=True)
    drawing.note((1, 2), "a < b", anchor="end")
    svg = drawing.svg()
    root = ElementTree.fromstring(svg)
    shapes = {element.tag.rpartition("}")[2]: element for element in root}
    assert (root.get("viewBox"), root.get("role")) == ("0 0 100 50", "img")
    assert [shapes[name].text for name in ("title", "desc", "text")] == ["Title <", "what it shows", "a < b"]
    assert [float(n) for n in re.split("[, ]", shapes["polyline"].get("points", "").strip())] == [0, 1, 2.35, 6]
    light, dark = COLOURS["curve"]
    assert shapes["polyline"].get("stroke") == light
    assert f".l-curve {{ stroke: {dark}; }}" in svg[svg.index("prefers-color-scheme: dark") :]
    assert shapes["circle"].get("fill") == COLOURS["ground"][0]
    assert svg in page("T", "", [], [Section("A", "", drawings=[drawing])], {})


def _luminance(colour: np.ndarray) -> float:
    """Relative luminance, as WCAG 2 defines it, of a colour (3,) in 0…255."""
    linear = np.where(colour <= 10, colour / 255 / 12.92, ((colour / 255 + 0.055) / 1.055) ** 2.4)
    return float(linear @ (0.2126, 0.7152, 0.0722))


def _contrast(one: np.ndarray, other: np.ndarray) -> float:
    low, high = sorted((_luminance(one), _luminance(other)))
    return (high + 0.05) / (low + 0.05)


def _colours(mode: int) -> dict[str, np.ndarray]:
    return {name: np.array([int(pair[mode][k : k + 2], 16) for k in (1, 3, 5)]) for name, pair in COLOURS.items()}


@pytest.mark.parametrize("mode", [0, 1])
def test_texts_can_be_read(mode: int) -> None:
    """With the contrast of 4.5 that WCAG 2 asks for, in light and dark mode."""
    colours = _colours(mode)
    for name in ("text", "faint", "curve", "path", "mark"):
        assert _contrast(colours[name], colours["ground"]) >= 4.5, name
