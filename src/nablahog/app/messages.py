"""What the page sends and gets as JSON: requests, with types and ranges; errors, a sentence and a status; pictures."""

from __future__ import annotations

import base64
import dataclasses
import io
import logging
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeAlias, TypeVar

import msgspec
from PIL import Image
from torch import Tensor

from ..hog import HOGSpec
from ..inputs.numbers import as_number, as_numbers, check_choice, shortened
from ..io.images import Picture, to_pil
from ..requests.inversion import HogRequest, InvertRequest
from ..requests.options import FLAG, TEXT, Kind, choice, integer, list_options, option
from ..requests.pose import BOX, CAMERA_NUMBERS, DISTORTION, FOCAL, POINT, PoseRequest, Sides
from ..runtime.errors import InputError, explain
from ..runtime.text import MOST_ERROR_CHARACTERS, did_you_mean, one_line
from ..viz.pictures import cell_width, glyph_image

GONE = "the server no longer has this file, as after a restart: open it again"
_REMEDIES = {"image size": ": give the size of the image"}
"""What a reader can do on the page, by what an error is about."""
logger = logging.getLogger(__name__)
SEE_SIZE, INVERT_SIZE = 1024, 512  # the longer side of photographs to describe, and to invert, in pixels
LARGEST_NUMBER = 1e6  # of a pose that is turned
LEAST_CELL = 5  # pixels of a cell's height in glyphs


class RequestError(Exception):
    """An error that the user of the page can correct: an HTTP status, and an answer with a sentence."""

    def __init__(self, status: int, sentence: str, **more: Any) -> None:
        super().__init__(sentence)
        self.status = status
        self.answer: dict[str, Any] = {"error": one_line(sentence, MOST_ERROR_CHARACTERS), **more}


@contextmanager
def as_request_error() -> Iterator[None]:
    """Turns what bad input raises in the block into a RequestError."""
    try:
        yield
    except RequestError:
        raise
    except InputError as error:
        sentence = f"{error}{_REMEDIES.get(error.about, '')}"
        raise RequestError(422, sentence, **_question(error.facts)) from None
    except (ValueError, TypeError, OSError) as error:
        raise RequestError(422, explain(error)) from None
    except (MemoryError, RuntimeError) as error:
        if not isinstance(error, MemoryError) and "memory" not in str(error):
            raise
        raise RequestError(503, "not enough memory: a smaller size needs less") from None


def _question(facts: Mapping[str, Any]) -> dict[str, Any]:
    """What the page asks about a file: which of its arrays, or of which preset that fits, the likeliest first."""
    if not facts:
        return {}
    fitting = facts.get("fitting", ())
    return {
        "question": {
            "keys": facts.get("keys"),
            "shape": facts.get("shape"),
            "weights": bool(facts.get("weights") or (fitting and fitting[0].is_detector)),
            "fitting": [
                {name: getattr(preset.request, name) for name in ("preset", "settings", "image_size")}
                for preset in fitting
            ],
        }
    }


def as_answer(error: Exception) -> RequestError:
    """An error as the page is told; one of the program's own is logged."""
    if isinstance(error, RequestError):
        return error
    logger.error("%s: %s", type(error).__name__, one_line(error), exc_info=logger.isEnabledFor(logging.DEBUG))
    return RequestError(500, f"an error in the program, please report it: {type(error).__name__}: {one_line(error)}")


Pose: TypeAlias = tuple[float, float, float, float, float, float]


def _as_pose(name: str, pose: object) -> tuple[float, ...]:
    values = as_numbers(name, pose, "azimuth, elevation, distance, theta, x, y")
    return tuple(as_number(f"each of {name}", value, -LARGEST_NUMBER, LARGEST_NUMBER) for value in values)


def field_of(kind: Kind, default: Any = dataclasses.MISSING) -> Any:
    """A field of a message that is no option; it must be there if it has no default."""
    return dataclasses.field(default=default, metadata={"kind": kind})


POSE = Kind("POSE", _as_pose)


@dataclass(frozen=True, kw_only=True)
class HogMessage(HogRequest):
    """The descriptor of a photograph, or one that was uploaded."""

    photo: str | None = field_of(TEXT, None)
    descriptor: str | None = field_of(TEXT, None)
    size: int = option(512, "pixels on the longer side", integer(8, SEE_SIZE), on_page=True)


@dataclass(frozen=True, kw_only=True)
class InvertMessage(InvertRequest):
    """An image with the descriptor of a photograph, or with one that was uploaded."""

    photo: str | None = field_of(TEXT, None)
    descriptor: str | None = field_of(TEXT, None)
    start: str | None = field_of(TEXT, None)
    size: int = option(256, "pixels on the longer side", integer(8, INVERT_SIZE), on_page=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.template and self.start is not None:
            raise ValueError("template and start exclude each other: leave out one of them")


@dataclass(frozen=True, kw_only=True)
class PoseMessage(PoseRequest):
    """The pose of the object in a box of a photograph."""

    photo: str = field_of(TEXT)
    mesh: str = field_of(TEXT)  # an id
    intrinsics: Any = field_of(CAMERA_NUMBERS, None)  # no name of a file: a request is no path


@dataclass(frozen=True, kw_only=True)
class Open:
    """A photograph's object and a mesh, to be turned; with the camera's numbers in pixels, if they are known."""

    photo: str = field_of(TEXT)
    mesh: str = field_of(TEXT)
    box: Sides | None = field_of(BOX, None)
    focal: Any = field_of(FOCAL, None)
    principal_point: tuple[float, float] | None = field_of(POINT, None)
    intrinsics: tuple[float, ...] | None = field_of(CAMERA_NUMBERS, None)
    distortion: tuple[float, ...] | None = field_of(DISTORTION, None)


@dataclass(frozen=True, kw_only=True)
class Turn:
    """A pose to render, moved until it fills the box with ``place``; ``width`` is that of the chart in pixels."""

    n: int = field_of(integer(0))
    pose: Pose = field_of(POSE)
    place: bool = field_of(FLAG, False)
    width: int = field_of(integer(0), 480)


@dataclass(frozen=True, kw_only=True)
class Curve:
    """The similarity over all azimuths, with the other parameters of a pose."""

    pose: Pose = field_of(POSE)


@dataclass(frozen=True, kw_only=True)
class Fit(PoseRequest):
    """The search for the pose in the box that was opened, with its camera."""

    box: None = None
    focal: None = None
    principal_point: None = None
    intrinsics: None = None
    distortion: None = None


@dataclass(frozen=True, kw_only=True)
class Stop:
    """Ends a curve or a search."""


FitMessage: TypeAlias = Open | Turn | Curve | Fit | Stop
FIT_MESSAGES: dict[str, type[FitMessage]] = {"open": Open, "pose": Turn, "curve": Curve, "fit": Fit, "stop": Stop}
Message = TypeVar("Message")


def decode(data: bytes | str, message: type[Message]) -> Message:
    """JSON as a message; the sentence of a RequestError says what was expected."""
    return _build(message, decode_json(data, dict[str, Any]))


def decode_fit_message(data: str) -> FitMessage:
    """The same for one of :data:`FIT_MESSAGES`, whose ``type`` says which."""
    fields = decode_json(data, dict[str, Any])
    name = fields.pop("type", None)
    with as_request_error():
        check_choice("type", name, FIT_MESSAGES)
    return _build(FIT_MESSAGES[name], fields)


def decode_json(data: bytes | str, kind: Any) -> Any:
    """JSON as a type of msgspec."""
    try:
        return msgspec.json.decode(data, type=kind)
    except msgspec.ValidationError as error:
        raise RequestError(422, f"the request does not fit: {error}") from None
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise RequestError(400, f"expected JSON: {error}") from None


def _build(message: type[Message], values: Mapping[str, Any]) -> Message:
    """The message with these values, converted by the kinds of their fields."""
    fields = {field.name: field for field in dataclasses.fields(message)}  # type: ignore[arg-type]
    kinds = _kinds(message)  # type: ignore[arg-type]  # mypy takes no class for hashable
    with as_request_error():
        for name in values:
            if name not in kinds:
                meant = did_you_mean(name, kinds)
                raise ValueError(f"there is no field {shortened(name)}; there are {', '.join(kinds)}{meant}")
        for name in kinds:
            if name not in values and fields[name].default is fields[name].default_factory is dataclasses.MISSING:
                raise ValueError(f"expected the field {name}, got none")
        return message(
            **{
                name: None if value is None and fields[name].default is None else _convert(kinds[name], name, value)
                for name, value in values.items()
            }
        )


def _convert(kind: Kind, name: str, value: Any) -> Any:
    if kind.collect is dict and isinstance(value, dict):
        return dict(kind.convert(name, item) for item in value.items())
    return kind.convert(name, value)


@cache
def _kinds(message: type) -> dict[str, Kind]:
    """The kinds of the fields that the page has."""
    own = {field.name: field.metadata["kind"] for field in dataclasses.fields(message) if "kind" in field.metadata}
    options = [option for option in list_options(message) if option.on_page]
    return own | {each.name: choice(each.page_choices) if each.page_choices else each.kind for each in options}


def encode_png(picture: Picture | Image.Image, opacity: Picture | None = None) -> bytes:
    """A picture in 0…1, with its opacity (H, W) if it is gray, or an image, as a PNG file."""
    file, image = io.BytesIO(), picture if isinstance(picture, Image.Image) else to_pil(picture)
    if opacity is not None:
        image.putalpha(to_pil(opacity))
    image.save(file, format="PNG", compress_level=1, compress_type=zlib.Z_RLE)  # for the loopback: fast, not small
    return file.getvalue()


def png(picture: Picture | Image.Image, opacity: Picture | None = None) -> str:
    """The same in base64, for JSON."""
    return base64.b64encode(encode_png(picture, opacity)).decode("ascii")


def glyphs(descriptor: Tensor, spec: HOGSpec, side: int) -> dict[str, Any]:
    """The glyphs of a descriptor (rows, cols, channels), about ``side`` pixels long, and their rows and columns."""
    height, width = spec.cell_size
    rows, cols, _ = descriptor.shape
    pixels = max(LEAST_CELL, round(side * height / max(rows * height, cols * width)))
    image = glyph_image(descriptor, spec, pixels)
    return {
        "rows": image.height // pixels,
        "cols": image.width // cell_width(spec, pixels),
        "cell": list(spec.cell_size),
        "image": png(image),
    }
