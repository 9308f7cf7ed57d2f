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
from types import UnionType
from typing import Annotated, Any, Literal, TypeAlias, TypeVar, Union, get_args, get_origin, get_type_hints

import msgspec
from msgspec import Meta, Struct
from PIL import Image
from torch import Tensor

from ..hog import HOGSpec
from ..io.images import Picture, to_pil
from ..requests.inversion import HogRequest, InvertRequest
from ..requests.options import integer, list_options, number, option
from ..requests.pose import PoseRequest, Sides
from ..runtime.errors import InputError
from ..runtime.text import MOST_ERROR_CHARACTERS, one_line
from ..viz.pictures import cell_width, glyph_image

GONE = "the server no longer has this file, as after a restart: open it again"
_REMEDIES = {"image size": ": give the size of the image"}
"""What a reader can do on the page, by what an error is about."""
logger = logging.getLogger(__name__)
SEE_SIZE, INVERT_SIZE = 1024, 512  # the longer side of photographs to describe, and to invert, in pixels
LARGEST_INTEGER, LARGEST_NUMBER = 2**53, 1e6
LONGEST_TEXT, MOST_SETTINGS = 200, 32
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
        raise RequestError(422, str(error)) from None
    except (MemoryError, RuntimeError) as error:
        if not isinstance(error, MemoryError) and "memory" not in str(error):
            raise
        raise RequestError(503, "not enough memory: a smaller size needs less") from None


def _question(facts: Mapping[str, Any]) -> dict[str, Any]:
    """What the page asks about a file: which of its arrays, or of which preset that fits, the likeliest first."""
    if not facts:
        return {}
    fitting = [preset.request for preset in facts.get("fitting", ()) if not preset.is_detector]
    return {
        "question": {
            "keys": facts.get("keys"),
            "shape": facts.get("shape"),
            "fitting": [
                {"preset": asked.preset, "settings": asked.settings, "image_size": asked.image_size}
                for asked in fitting
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


@dataclass(frozen=True, kw_only=True)
class HogMessage(HogRequest):
    """The descriptor of a photograph, or one that was uploaded."""

    photo: str | None = None
    descriptor: str | None = None
    size: int = option(512, "pixels on the longer side", integer(8, SEE_SIZE), on_page=True)


@dataclass(frozen=True, kw_only=True)
class InvertMessage(InvertRequest):
    """An image with the descriptor of a photograph, or with one that was uploaded."""

    photo: str | None = None
    descriptor: str | None = None
    start: str | None = None
    size: int = option(256, "pixels on the longer side", integer(8, INVERT_SIZE), on_page=True)


@dataclass(frozen=True, kw_only=True)
class PoseMessage(PoseRequest):
    """The pose of the object in a box of a photograph."""

    photo: str
    mesh: str = dataclasses.field()  # an id
    focal: float | None = option(
        None, "focal length, pixels", number("PIXELS", "a number above 0", 0, above=True), on_page=True
    )


@dataclass(frozen=True, kw_only=True)
class Open:
    """A photograph's object and a mesh, to be turned; with the focal length of the camera in pixels, if it is known."""

    photo: str
    mesh: str
    box: Sides | None = None
    focal: float | None = None


@dataclass(frozen=True, kw_only=True)
class Turn:
    """A pose to render, moved until it fills the box with ``place``; ``width`` is that of the chart in pixels."""

    n: int
    pose: Pose
    place: bool = False
    width: int = 480


@dataclass(frozen=True, kw_only=True)
class Curve:
    """The similarity over all azimuths, with the other parameters of a pose."""

    pose: Pose


@dataclass(frozen=True, kw_only=True)
class Fit(PoseRequest):
    """The search for the pose in the box that was opened, with its focal length."""

    box: None = None
    focal: None = None


@dataclass(frozen=True, kw_only=True)
class Stop:
    """Ends a curve or a search."""


FitMessage: TypeAlias = Open | Turn | Curve | Fit | Stop
FIT_MESSAGES: dict[str, type[FitMessage]] = {"open": Open, "pose": Turn, "curve": Curve, "fit": Fit, "stop": Stop}
Message = TypeVar("Message")


def decode(data: bytes | str, message: type[Message]) -> Message:
    """JSON as a message; the sentence of a RequestError says what was expected where."""
    return _as_message(decode_json(data, _struct(message)), message)  # type: ignore[arg-type]


def decode_fit_message(data: str) -> FitMessage:
    """The same for one of :data:`FIT_MESSAGES`, whose ``type`` says which."""
    structs = tuple(_struct(message, tag) for tag, message in FIT_MESSAGES.items())  # type: ignore[arg-type]
    struct = decode_json(data, Union[structs])  # noqa: UP007
    return _as_message(struct, FIT_MESSAGES[struct.__struct_config__.tag])


def decode_json(data: bytes | str, kind: Any) -> Any:
    """JSON as a type of msgspec."""
    try:
        return msgspec.json.decode(data, type=kind)
    except msgspec.ValidationError as error:
        raise RequestError(422, f"the request does not fit: {error}") from None
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise RequestError(400, f"expected JSON: {error}") from None


def _as_message(struct: Any, message: type[Message]) -> Message:
    with as_request_error():
        return message(**{name: getattr(struct, name) for name in struct.__struct_fields__})


@cache
def _struct(message: type, tag: str | None = None) -> type[Struct]:
    """The type of a message in JSON: the fields of its request that the page has, in their ranges, and its own."""
    options, hints = {option.name: option for option in list_options(message)}, get_type_hints(message)
    fields: list[Any] = []
    for field in dataclasses.fields(message):
        declared = options.get(field.name)
        if declared is None:
            kind, default = _bounded(hints[field.name]), field.default
        elif declared.on_page:
            least, most = declared.kind.least, declared.kind.most
            kind, default = _bounded(declared.hint, least, most, above=declared.kind.above), declared.default
            kind = Literal[declared.page_choices] if declared.page_choices and declared.hint is str else kind
        else:
            continue
        fields.append((field.name, kind) if default is dataclasses.MISSING else (field.name, kind, default))
    struct: type[Struct] = msgspec.defstruct(
        message.__name__, fields, tag=tag, forbid_unknown_fields=True, kw_only=True
    )
    return struct


def _bounded(hint: Any, least: float | None = None, most: float | None = None, *, above: bool = False) -> Any:
    """A type whose numbers are in a range, and whose texts are short."""
    if hint in (int, float):
        largest = LARGEST_INTEGER if hint is int else LARGEST_NUMBER
        least, most = -largest if least is None else hint(least), largest if most is None else min(hint(most), largest)
        return Annotated[hint, Meta(gt=least, le=most) if above else Meta(ge=least, le=most)]
    if hint is str:
        return Annotated[str, Meta(max_length=LONGEST_TEXT)]
    origin, inner = get_origin(hint), [_bounded(part, least, most, above=above) for part in get_args(hint)]
    if origin in (UnionType, Union):
        return Union[tuple(inner)]  # noqa: UP007
    if origin is tuple:
        return tuple.__class_getitem__(tuple(inner))
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return Annotated[dict[inner[0], inner[1]], Meta(max_length=MOST_SETTINGS)]  # type: ignore[valid-type]
    return hint


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
