"""Lines about what failed or was passed over."""

from __future__ import annotations

from ...paper.photographs import Photographs
from ...paper.tables import Results
from ..terminal import say


def say_failures(results: Results) -> None:
    """A line for each result that is missing from a table."""
    for failure in results.failures:
        say(f"Failed: {failure.image}, {failure.method or 'all methods'}: {failure.reason}")


def say_ignored(photographs: Photographs) -> None:
    """A line about the files of the folder that are no images, if any."""
    if photographs.ignored:
        say(f"Passed over, as no images by their endings: {', '.join(photographs.ignored)}")
