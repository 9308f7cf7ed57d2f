"""Drawings: well-formed, in colours of both modes, for those who cannot see them, too."""

from __future__ import annotations

import re
from xml.etree import ElementTree

import numpy as np
import pytest

from nablahog.viz.html import Section, page
from nablahog.viz.svg import COLOURS, Drawing


def test_a_drawing() -> None:
    drawing = Drawing(100, 50, "Title <", "what it shows")
    drawing.line([(0, 1), (2.345, 6)], "curve", 2)
    drawing.dot((5, 5), "path", 3, ringed=True)
    drawing.note((1, 2), "a < b", anchor="end")
    drawing.rectangle((1, 2), 30, 40, "curve")
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
    sides = [shapes["rect"].get(name) for name in ("x", "y", "width", "height")]
    assert sides == ["1", "2", "30", "40"]
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
