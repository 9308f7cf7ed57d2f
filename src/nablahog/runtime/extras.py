"""Packages that only a few uses need: the extras of ``pyproject.toml``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


class MissingExtra(ModuleNotFoundError, ValueError):
    """A package of an extra is not installed; the message says how to install it."""


@contextmanager
def extra(name: str, use: str) -> Iterator[None]:
    """Turns a failed import in the block into a :class:`MissingExtra`, for a use such as "a cluster"."""
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("nablahog"):
            raise
        raise MissingExtra(f"{use} needs {error.name}: pip install 'nablahog[{name}]'", name=error.name) from None
