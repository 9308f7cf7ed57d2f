"""Errors of the user, in one sentence."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path


class UserError(Exception):
    """An error that the user can correct; its message is one sentence."""


@contextmanager
def as_user_error(prefix: str = "") -> Iterator[None]:
    """Turns a ValueError of the block into a UserError with a prefix."""
    try:
        yield
    except ValueError as error:
        raise UserError(f"{prefix}{error}") from None


def forbid_overwrite(inputs: Iterable[str | os.PathLike[str]], targets: Iterable[Path]) -> None:
    """Raises UserError if a result would be written to an input file."""
    read = {os.path.realpath(path) for path in inputs}
    for target in targets:
        if os.path.realpath(target) in read:
            raise UserError(f"the result {target} would overwrite an input: expected another -o")
