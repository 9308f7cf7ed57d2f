"""Errors of the user, in one sentence; inputs that are skipped."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from ..runtime.text import one_line

MOST_CHARACTERS = 900  # of an error: with the name of the command, a line has at most 1000
SOME_SKIPPED = 3  # exit status: some inputs were skipped, the others done
REFUSED = 4  # exit status: there is a result, but it is less sure than was asked for


def tell(command: str, message: str) -> None:
    """Prints a line on stderr; ``command`` is its name without ``nablahog``."""
    print(f"nablahog {command}: {one_line(message, MOST_CHARACTERS)}", file=sys.stderr)


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
    def each(self, path: str) -> Iterator[None]:
        """Skips the input ``path`` if the block raises ValueError or OSError."""
        try:
            yield
        except (ValueError, OSError) as error:
            named = path in str(error) or str(Path(path)) in str(error)
            message = str(error) if named else f"{path}: {error}"
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


def forbid_overwrite(inputs: Iterable[str | os.PathLike[str]], targets: Iterable[Path]) -> None:
    """Raises ValueError if a result would be written to an input file."""
    read = {os.path.realpath(path) for path in inputs}
    for target in targets:
        if os.path.realpath(target) in read:
            raise ValueError(f"the result {target} would overwrite an input: expected another -o")
