"""Errors of the user, in one sentence; inputs that are skipped."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from ..requests.inversion import GlyphRequest, InvertRequest
from ..requests.options import list_options, words
from ..requests.pose import PoseRequest
from ..runtime.errors import InputError, explain
from ..runtime.text import MOST_ERROR_CHARACTERS, one_line

if TYPE_CHECKING:
    from ..requests.arrays import Suggestion

WRONG_ARGUMENTS = 2  # exit status: as argparse's own, also of arguments that do not go together
SOME_SKIPPED = 3  # exit status: some inputs were skipped, the others done
REFUSED = 4  # exit status: there is a result, but it is less sure than was asked for
_REMEDIES = {
    "array": ": --key NAME chooses one",
    "image size": ": expected --image-size HxW",
    "preset": ": expected --preset NAME",
}
"""The options that help, by what an error is about."""
OPTIONS = {option.name: option.flag for request in (InvertRequest, PoseRequest) for option in list_options(request)}
"""The options of the command by the names of arguments."""


class WrongArguments(ValueError):
    """Arguments that do not go together, whatever the inputs hold."""


@contextmanager
def blaming_arguments() -> Iterator[None]:
    """Turns a ValueError in the block, which reads no input, into WrongArguments."""
    try:
        yield
    except InputError:
        raise
    except ValueError as error:
        raise WrongArguments(str(error)) from None


def tell(command: str, message: str) -> None:
    """Prints a line on stderr; ``command`` is its name without ``nablahog``."""
    print(f"nablahog {command}: {one_line(name_options(message), MOST_ERROR_CHARACTERS)}", file=sys.stderr)


def name_options(sentence: str) -> str:
    """A sentence of the library with the options of the command for the arguments that it names, in backticks."""
    return re.sub(r"`(\w+)`", lambda match: OPTIONS.get(match[1], match[1]), sentence)


def word_error(error: Exception) -> str:
    """The sentence of an error, with the options that help."""
    if not isinstance(error, InputError):
        return name_options(explain(error))
    if error.facts.get("weights") and error.about == "preset":
        return (
            f"{error}, and many entries are negative, as in the weights of a detector: expected --template; of a "
            "standardised descriptor v, undo a StandardScaler first: v * scale_ + mean_"
        )
    suggestions = error.facts.get("fitting", [])
    if error.facts.get("decided"):
        return f"{error}: write {_as_options(suggestions)}"
    if error.about in ("preset", "image size") and suggestions and not suggestions[0].is_detector:
        return f"{error}{_undecided(suggestions)}"
    return f"{error}{_REMEDIES.get(error.about, '')}{_that_fit(suggestions)}"


def _that_fit(suggestions: Sequence[Suggestion]) -> str:
    """What fits an array, as options."""
    if suggestions and suggestions[0].is_detector:
        return f"; with --template, a detector's weights would fit {_as_options(suggestions)}"
    return f"; this fits {_as_options(suggestions)}" if suggestions else ""


def _undecided(suggestions: Sequence[Suggestion]) -> str:
    return f", and its numbers do not tell which: write one of these, the likeliest first: {_as_options(suggestions)}"


def _as_options(suggestions: Sequence[Suggestion]) -> str:
    return ", or ".join(" ".join(words(each.request, GlyphRequest)) for each in suggestions)


class Skipping:
    """Skips inputs that cannot be used, with a line on stderr for each.

    Attributes:
        skipped: input and error of those skipped so far, ready for JSON.
    """

    def __init__(self, command: str, count: int) -> None:
        """For a command with ``count`` inputs; a single input is not skipped: its error ends the command."""
        self.command, self.count = command, count
        self.skipped: list[dict[str, str]] = []

    @contextmanager
    def guard(self, path: str) -> Iterator[None]:
        """Skips the input ``path`` if the block raises ValueError or OSError."""
        try:
            yield
        except (ValueError, OSError) as error:
            message = word_error(error)
            if path not in message and str(Path(path)) not in message:
                message = f"{path}: {message}"
            if self.count == 1:
                raise ValueError(message) from None
            self.skipped.append(
                {"input": path, "error": message.removeprefix(f"{path}: ").removeprefix(f"{Path(path)}: ")}
            )
            tell(self.command, f"skipped: {message}")

    def check(self) -> None:
        """Raises ValueError if all inputs were skipped."""
        if len(self.skipped) == self.count:
            raise ValueError(f"none of the {self.count} inputs can be used")

    @property
    def status(self) -> int:
        return SOME_SKIPPED if self.skipped else 0
