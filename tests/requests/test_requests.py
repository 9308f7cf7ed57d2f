"""What can be asked: the command, the page and the functions of the package agree on it."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import nablahog
from nablahog.app.messages import Fit, HogMessage, InvertMessage, PoseMessage, RequestError, decode
from nablahog.cli.arguments.options import build_request
from nablahog.cli.main import parser
from nablahog.requests.inversion import GlyphRequest, HogRequest, InvertRequest
from nablahog.requests.options import FLAG, Option, list_options, number, words
from nablahog.requests.pose import PoseRequest

COMMANDS = {"hog": HogRequest, "glyph": GlyphRequest, "invert": InvertRequest, "pose": PoseRequest}
TEXTS = {
    "DEGREES": "20",
    "FILE": "a b.npz",
    "FILE_or_fx,fy,cx,cy": "500,510,320,240.5",
    "FILE_or_DIR": "chairs",
    "HxW": "64x48",
    "KEY=VALUE": "orientations=8",
    "N": "9",
    "NAME": "left",
    "P": "0.5",
    "PIXELS": "400.5",
    "az,el": "-30,10",
    "k1,k2,p1,p2[,k3]": "-0.3,0.1,0,0,0",
    "x,y": "10,12",
    "x0,y0,x1,y1": "1.5,2,30,40",
}
"""A text of each kind of values."""
NOT_AS_IT_IS = {"image_size", "prior", "mask"}
"""Options of which the functions get what is read by them: of a descriptor, a prior and an image."""


def other(option: Option) -> Any:
    """A value of an option that is not its default."""
    kind = option.kind
    if kind is FLAG:
        return True
    if option.page_choices or kind.choices:
        return next(name for name in (option.page_choices or kind.choices) if name != option.default)
    value = kind.read(option.name, TEXTS[kind.name])
    return value if kind.collect is None else kind.collect([value])


@pytest.mark.parametrize(
    ("command", "option"), [(command, each) for command, kind in COMMANDS.items() for each in list_options(kind)]
)
def test_options_of_the_command_ask_for_the_same(command: str, option: Option) -> None:
    asked = COMMANDS[command](**{option.name: other(option)})
    arguments = parser().parse_args([command, "photo.png", "-o", "out", *words(asked, COMMANDS[command])])
    assert build_request(COMMANDS[command], arguments) == asked
    assert getattr(asked, option.name) != option.default


@pytest.mark.parametrize("command", COMMANDS)
def test_nothing_is_asked_for_by_no_options(command: str) -> None:
    arguments = parser().parse_args([command, "photo.png", "-o", "out"])
    assert build_request(COMMANDS[command], arguments) == COMMANDS[command]()
    assert words(COMMANDS[command](), COMMANDS[command]) == []


@pytest.mark.parametrize(
    ("command", "name", "default", "least", "most"),
    [
        ("hog", "size", 0, (0, -1), (10**18 - 1, 10**18)),
        ("glyph", "size", 256, (0, -1), None),
        ("glyph", "row", None, (0, -1), None),
        ("invert", "samples", None, (2, 1), (64, 65)),
        ("invert", "seed", 0, (0, -1), None),
        ("pose", "within", 180, (0.001, 0), (180, 180.001)),
        ("pose", "least_confidence", 0.3, (0, -0.001), (1, 1.001)),
        ("pose", "seed", 0, (0, -1), None),
    ],
)
def test_ranges_and_defaults(command: str, name: str, default: Any, least: Any, most: Any) -> None:
    """Of each range the last number that is taken, and the first that is not."""
    [option] = [option for option in list_options(COMMANDS[command]) if option.name == name]
    assert option.default == default
    for taken, refused in (limit for limit in (least, most) if limit is not None):
        assert option.kind.read(name, str(taken)) == taken
        with pytest.raises(ValueError, match=f"^{name} must be "):
            option.kind.read(name, str(refused))


@pytest.mark.parametrize(
    ("name", "text"),
    [("initial", "0,91"), ("focal", "-3"), ("distortion", "0.1,0.2"), ("intrinsics", "300,300"), ("up", "up")],
)
def test_what_is_refused_when_it_is_read(name: str, text: str) -> None:
    [option] = [option for option in list_options(PoseRequest) if option.name == name]
    with pytest.raises(ValueError, match="must be"):
        option.kind.read(name, text)


@pytest.mark.parametrize("command", COMMANDS)
def test_flags_are_off_without_being_asked_for(command: str) -> None:
    assert not any(option.default for option in list_options(COMMANDS[command]) if option.kind is FLAG)


def test_what_is_passed_on() -> None:
    assert PoseRequest(initial=(20, 10), within=30.0, page=True).keywords() == {"initial": (20, 10), "within": 30.0}
    assert PoseRequest(method="paper", seed=3, box=(1, 2, 30, 40)).keywords() == {
        "method": "paper", "seed": 3, "box": (1, 2, 30, 40)
    }  # fmt: skip
    assert InvertRequest(prior="none", quality="fast", size=64).keywords() == {"quality": "fast", "prior": None}


def test_a_focal_length_is_in_pixels() -> None:
    assert PoseRequest(focal=500).focal == 500
    [focal] = [option for option in list_options(PoseRequest) if option.name == "focal"]
    assert [focal.kind.read("focal", text) for text in ("400", "exif", "unknown")] == [400, "exif", "unknown"]
    assert type(focal.kind.convert("focal", np.int64(400))) is float
    for text in ("50mm", "50MM"):
        with pytest.raises(ValueError, match=r"must be in pixels, got '50.*43\.3mm"):
            focal.kind.read("focal", text)


@pytest.mark.parametrize(
    ("request_type", "function"), [(InvertRequest, nablahog.reconstruct), (PoseRequest, nablahog.estimate_pose)]
)
def test_keywords_are_those_of_the_function(request_type: type, function: Callable[..., Any]) -> None:
    parameters = inspect.signature(function).parameters
    for each in list_options(request_type):
        assert each.keyword == (each.name in {*parameters} - NOT_AS_IT_IS), f"{each.name}: is it passed on?"
        if each.keyword:
            field = f"{request_type.__name__}.{each.name}"
            keyword = f"keyword `{each.name}`, default {each.default!r}"
            assert each.name in parameters, f"give {function.__name__} the {keyword}, or take keyword=True from {field}"
            assert parameters[each.name].default == each.default, f"{function.__name__} and {field} need one default"


@pytest.mark.parametrize(
    ("message", "offered"),
    [
        (HogMessage, "preset settings size"),
        (InvertMessage, "preset settings size quality method prior seed"),
        (PoseMessage, "box initial focal principal_point distortion method seed"),
        (Fit, "initial method seed"),
    ],
)
def test_the_page_has_what_it_offers_and_nothing_else(message: type, offered: str) -> None:
    ids = {"photo": "p", "mesh": "m"} if message is PoseMessage else {}
    assert [each.name for each in list_options(message) if each.on_page] == offered.split()
    for each in list_options(message):
        value = other(each)
        text = json.dumps({**ids, each.name: value})
        if each.on_page:
            assert getattr(decode(text, message), each.name) == value
        elif each.name not in ids:
            with pytest.raises(RequestError, match=f"there is no field '{each.name}'"):
                decode(text, message)


@pytest.mark.parametrize(("message", "most"), [(HogMessage, 1024), (InvertMessage, 512)])
def test_sizes_on_the_page(message: type, most: int) -> None:
    for size in (8, most):
        assert getattr(decode(json.dumps({"size": size}), message), "size") == size  # noqa: B009
    for size in (7, most + 1):
        with pytest.raises(RequestError, match=f"^size must be an integer in 8 … {most:,}, got"):
            decode(json.dumps({"size": size}), message)


@pytest.mark.parametrize("text", ['{"prior": "/etc/passwd"}', '{"seed": -1}', '{"seed": 0.5}', '{"size": 100000}'])
def test_the_page_keeps_ranges_and_choices(text: str) -> None:
    with pytest.raises(RequestError, match="must be"):
        decode(text, InvertMessage)


def test_numbers_say_from_where_on_they_are() -> None:
    assert (number("X", least=2, most=3).least, number("X", above=-1).least, number("X").least) == (2, -1, None)
