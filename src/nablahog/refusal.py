"""What the command refuses, in one sentence."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


class UserError(Exception):
    """Something the user can mend; its message is one sentence."""


@contextmanager
def refusing(prefix: str = "") -> Iterator[None]:
    """What the block raises because of its inputs is the user's to mend."""
    try:
        yield
    except ValueError as error:
        raise UserError(f"{prefix}{error}") from None
