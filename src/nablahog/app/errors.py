"""Errors as the page shows them: one sentence, with the status of HTTP."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from ..cli.errors import MOST_CHARACTERS, UserError
from ..runtime.text import one_line

GONE = "the server no longer has this upload: drop it again"


logger = logging.getLogger(__name__)


class RequestError(Exception):
    """An error that the user of the page can correct.

    Attributes:
        status: of HTTP.
        answer: the JSON, with the sentence as its ``error``.
    """

    def __init__(self, status: int, sentence: str, **more: Any) -> None:
        super().__init__(sentence)
        self.status = status
        self.answer: dict[str, Any] = {"error": one_line(sentence, MOST_CHARACTERS), **more}


@contextmanager
def as_request_error() -> Iterator[None]:
    """Turns what bad input raises in the block into a RequestError."""
    try:
        yield
    except RequestError:
        raise
    except (ValueError, TypeError, UserError, OSError) as error:
        raise RequestError(422, str(error)) from None
    except (MemoryError, RuntimeError) as error:
        if not isinstance(error, MemoryError) and "memory" not in str(error):
            raise
        raise RequestError(503, "not enough memory: a smaller size needs less") from None


@contextmanager
def named(path: str, name: str) -> Iterator[None]:
    """As :func:`as_request_error`; the sentence calls the file ``path`` by the user's own ``name``."""
    try:
        with as_request_error():
            yield
    except RequestError as error:
        error.answer["error"] = error.answer["error"].replace(path, name)
        raise


def internal_error(error: Exception) -> RequestError:
    """An error of the program's own as the page is told; it is logged."""
    logger.error("%s: %s", type(error).__name__, one_line(error), exc_info=logger.isEnabledFor(logging.DEBUG))
    return RequestError(
        500, f"an error of the program, which is worth a report: {type(error).__name__}: {one_line(error)}"
    )
