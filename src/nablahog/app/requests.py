"""The page's requests as JSON, with fields, types and ranges; its errors: one sentence and an HTTP status."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Any, Literal, TypeVar

import msgspec
from msgspec import Meta, Struct, field

from ..cli.arguments.presets import PRESETS, SpecOptions
from ..cli.errors import MOST_CHARACTERS
from ..hog import HOGSpec
from ..invert.choices import QualityName
from ..pose.options import SearchMethod
from ..runtime.text import one_line

GONE = "the server no longer has this file, as after a restart: open it again"
_OPTIONS = (
    ("(; this fits|; its shape fits|; by the error of|: expected --preset) .*", ""),
    (": expected --image-size HxW", ": enter the size of the image"),
    ("expected one array or --key NAME", "expected one array"),
    ("expected one descriptor in a file, got .*", r"\g<0>; save one of them in a file of its own"),
    ("--key goes with", "a name of an array goes with"),
    ("--image-size (\\S+)", "the image size \\1"),
    ("--set (?=\\w)|--set: ", ""),
)
"""Options of the command in sentences that it shares with the page, and what the page says in their place."""
logger = logging.getLogger(__name__)
SEE_SIZE, INVERT_SIZE = 1024, 512  # the longer side of photographs to describe, and to invert, in pixels


def _for_the_page(sentence: str) -> str:
    """A sentence without the options of the command."""
    for option, said in _OPTIONS:
        sentence = re.sub(option, said, sentence)
    return sentence


class RequestError(Exception):
    """An error that the user of the page can correct: an HTTP status, and an answer with a sentence."""

    def __init__(self, status: int, sentence: str, **more: Any) -> None:
        super().__init__(sentence)
        self.status = status
        self.answer: dict[str, Any] = {"error": one_line(_for_the_page(sentence), MOST_CHARACTERS), **more}


@contextmanager
def as_request_error() -> Iterator[None]:
    """Turns what bad input raises in the block into a RequestError."""
    try:
        yield
    except RequestError:
        raise
    except (ValueError, TypeError, OSError) as error:
        raise RequestError(422, str(error)) from None
    except (MemoryError, RuntimeError) as error:
        if not isinstance(error, MemoryError) and "memory" not in str(error):
            raise
        raise RequestError(503, "not enough memory: a smaller size needs less") from None


def as_answer(error: Exception) -> RequestError:
    """An error as the page is told; one of the program's own is logged."""
    if isinstance(error, RequestError):
        return error
    logger.error("%s: %s", type(error).__name__, one_line(error), exc_info=logger.isEnabledFor(logging.DEBUG))
    return RequestError(500, f"an error in the program, please report it: {type(error).__name__}: {one_line(error)}")


Name = Annotated[str, Meta(max_length=64)]
Text = Annotated[str, Meta(max_length=200)]
Id = Annotated[str, Meta(min_length=1, max_length=64)]
Seed = Annotated[int, Meta(ge=0, le=2**31 - 1)]
Number = Annotated[float, Meta(ge=-1e6, le=1e6)]
Pose = Annotated[list[Number], Meta(min_length=6, max_length=6)]
Box = Annotated[list[Number], Meta(min_length=4, max_length=4)]
Settings = Annotated[dict[Name, Text], Meta(max_length=32)]
Method = Literal["prior", "no-prior", "paper"]


class Dialect(Struct, forbid_unknown_fields=True):
    """A preset with its parameters, as texts of the command line."""

    preset: Name = "uoctti"
    settings: Settings = field(default_factory=dict)

    def spec(self) -> HOGSpec:
        """The spec; RequestError if there is no such preset or parameter, or its value is out of range."""
        return spec_options(self.preset, self.settings).spec()


def spec_options(preset: str | None, settings: dict[str, str]) -> SpecOptions:
    """The same as options of the command line; without a preset, none."""
    if preset is not None and preset not in PRESETS:
        raise RequestError(422, f"there is no preset {preset!r}; there are {', '.join(PRESETS)}")
    with as_request_error():
        return SpecOptions(preset, settings=tuple(settings.items()))


class HogRequest(Dialect):
    """The descriptor of a photograph, or one that was uploaded."""

    photo: Id | None = None
    descriptor: Id | None = None
    size: Annotated[int, Meta(ge=8, le=SEE_SIZE)] = 512


class InvertRequest(Dialect):
    """An image with the descriptor of a photograph, or with one that was uploaded."""

    photo: Id | None = None
    descriptor: Id | None = None
    size: Annotated[int, Meta(ge=8, le=INVERT_SIZE)] = 256
    method: Method = "prior"
    quality: QualityName = "best"
    seed: Seed = 0
    start: Id | None = None


class PoseRequest(Struct, forbid_unknown_fields=True):
    """The pose of the object in a box of a photograph."""

    photo: Id
    mesh: Id
    box: Box | None = None
    method: SearchMethod = "best"
    initial: Annotated[list[Number], Meta(min_length=2, max_length=2)] | None = None
    seed: Seed = 0
    focal: Number | None = None


class Open(Struct, forbid_unknown_fields=True, tag="open"):
    """A photograph's object and a mesh, to be turned; with the focal length of the camera in pixels, if it is known."""

    photo: Id
    mesh: Id
    box: Box | None = None
    focal: Number | None = None


class Turn(Struct, forbid_unknown_fields=True, tag="pose"):
    """A pose to render; with ``place`` the model is moved until it fills the box."""

    n: Annotated[int, Meta(ge=0, le=2**53)]
    pose: Pose
    place: bool = False


class Curve(Struct, forbid_unknown_fields=True, tag="curve"):
    """The similarity over all azimuths, with the other parameters of a pose."""

    pose: Pose


class Fit(Struct, forbid_unknown_fields=True, tag="fit"):
    """The search for a pose; it begins at ``pose`` if ``from_here``."""

    method: SearchMethod = "best"
    seed: Seed = 0
    from_here: bool = False
    pose: Pose | None = None


class Stop(Struct, forbid_unknown_fields=True, tag="stop"):
    """Ends a curve or a search."""


FitMessage = Open | Turn | Curve | Fit | Stop
Decoded = TypeVar("Decoded")


def decoded(data: bytes | str, kind: type[Decoded] | Any) -> Decoded:
    """JSON as a request; the sentence of a RequestError says what was expected where."""
    try:
        request: Decoded = msgspec.json.decode(data, type=kind)
    except msgspec.ValidationError as error:
        raise RequestError(422, f"the request does not fit: {error}") from None
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise RequestError(400, f"expected JSON: {error}") from None
    return request
