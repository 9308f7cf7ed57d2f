"""What can be asked: the command, the page and the functions of the package agree on it."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable
from typing import Any

import pytest

import nablahog
from nablahog.app.messages import Fit, HogMessage, InvertMessage, PoseMessage, RequestError, decoded
from nablahog.cli.arguments.options import request_of
from nablahog.cli.main import parser
from nablahog.requests.inversion import GlyphRequest, HogRequest, InvertRequest
from nablahog.requests.options import options_of, words
from nablahog.requests.pose import PoseRequest

COMMANDS = {"hog": HogRequest, "glyph": GlyphRequest, "invert": InvertRequest, "pose": PoseRequest}
OTHER: dict[str, Any] = {
    "preset": "skimage",
    "settings": {"cells_per_block": "2x2", "orientations": "8"},
    "size": 0,
    "image_size": (64, 48),
    "key": "left",
    "template": True,
    "quality": "fast",
    "method": "paper",
    "prior": "my prior.npz",
    "samples": 3,
    "seed": 5,
    "mesh": "chairs",
    "up": "-z",
    "front": "+x",
    "box": (1.5, 2.0, 30.0, 40.0),
    "mask": "mask.png",
    "annotations": "objects.csv",
    "initial": (-30.0, 10.0),
    "within": 20.0,
    "focal": 400.5,
    "principal_point": (10.0, 12.0),
    "least_confidence": 0.5,
    "page": True,
}
"""A value of each field that is not its default."""


def fields() -> list[tuple[str, str]]:
    return [(command, each.name) for command, kind in COMMANDS.items() for each in options_of(kind)]


@pytest.mark.parametrize(("command", "name"), fields())
def test_options_of_the_command_ask_for_the_same(command: str, name: str) -> None:
    preset = {"preset": "skimage"} if name == "settings" else {}
    asked = COMMANDS[command](**{**preset, name: OTHER[name]})
    arguments = parser().parse_args([command, "photo.png", "-o", "out", *words(asked, COMMANDS[command])])
    assert request_of(COMMANDS[command], arguments) == asked
    assert getattr(asked, name) != getattr(COMMANDS[command](), name)


@pytest.mark.parametrize("command", COMMANDS)
def test_nothing_is_asked_for_by_no_options(command: str) -> None:
    arguments = parser().parse_args([command, "photo.png", "-o", "out"])
    assert request_of(COMMANDS[command], arguments) == COMMANDS[command]()
    assert words(COMMANDS[command](), COMMANDS[command]) == []


@pytest.mark.parametrize(
    ("request_type", "function"), [(InvertRequest, nablahog.reconstruct), (PoseRequest, nablahog.estimate_pose)]
)
def test_keywords_are_those_of_the_function(request_type: type, function: Callable[..., Any]) -> None:
    parameters = inspect.signature(function).parameters
    for each in options_of(request_type):
        if each.keyword:
            assert parameters[each.name].default == each.default


@pytest.mark.parametrize("message", [HogMessage, InvertMessage, PoseMessage, Fit])
def test_the_page_has_what_it_offers_and_nothing_else(message: type) -> None:
    ids = {"photo": "p", "mesh": "m"} if message is PoseMessage else {}
    for each in options_of(message):
        value = each.page_choices[-1] if each.page_choices else 8 if each.name == "size" else OTHER[each.name]
        if each.name == "settings":
            value = {"cell_size": "4"}
        text = json.dumps({**ids, each.name: value})
        if each.on_page:
            assert getattr(decoded(text, message), each.name) == value
        elif each.name not in ids:
            with pytest.raises(RequestError, match=f"unknown field `{each.name}`"):
                decoded(text, message)


@pytest.mark.parametrize("text", ['{"prior": "/etc/passwd"}', '{"seed": -1}', '{"seed": 0.5}', '{"size": 100000}'])
def test_the_page_keeps_ranges_and_choices(text: str) -> None:
    with pytest.raises(RequestError, match="the request does not fit"):
        decoded(text, InvertMessage)
