"""Errors that a front end words: the command names an option, the page a field."""

from __future__ import annotations

import os
from typing import Any, Literal

Topic = Literal["array", "descriptor", "image size", "preset"]


def explain(error: Exception) -> str:
    """The sentence of an error; of one of the system, the file and the reason, without its number."""
    if not isinstance(error, OSError) or error.strerror is None or type(error).__str__ is not OSError.__str__:
        return str(error)
    reason, file = error.strerror[:1].lower() + error.strerror[1:], error.filename
    return reason if file is None else f"{os.fsdecode(file) if isinstance(file, bytes) else file}: {reason}"


class InputError(ValueError):
    """Input that cannot be used as it is, and what it is about, so that each front end can say what to do.

    Attributes:
        about: what is missing or wrong.
        facts: what else is known, such as the names of the arrays in a file.
    """

    def __init__(self, sentence: str, about: Topic, facts: dict[str, Any] | None = None) -> None:
        self.about, self.facts = about, facts or {}
        super().__init__(sentence, about, self.facts)  # so that it can be pickled

    def __str__(self) -> str:
        """The sentence, which names no option of the command and no field of the page."""
        return str(self.args[0])

    def reworded(self, sentence: str) -> InputError:
        """The same error with another sentence, such as one that begins with the name of a file."""
        return InputError(sentence, self.about, self.facts)
