"""What the command refuses, in one sentence."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path


class UserError(Exception):
    """Something the user can mend; its message is one sentence."""


@contextmanager
def as_user_error(prefix: str = "") -> Iterator[None]:
    """What the block raises because of its inputs is the user's to mend."""
    try:
        yield
    except ValueError as error:
        raise UserError(f"{prefix}{error}") from None


def forbid_overwrite(inputs: Iterable[str | os.PathLike[str]], targets: Iterable[Path]) -> None:
    """Refuses, if a file that is to be written is one that is read."""
    read = {os.path.realpath(path) for path in inputs}
    for target in targets:
        if os.path.realpath(target) in read:
            raise UserError(f"the result {target} would overwrite an input: expected another -o")
