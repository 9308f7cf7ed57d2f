"""The option ``--viewpoint-prior``."""

from __future__ import annotations

from pathlib import Path

from ...pose.viewpoint_evidence import ViewpointChoice
from ...pose.viewpoint_network import ViewpointPrior

NO_PRIOR = Path("none")


def viewpoint_choice(file: Path | None) -> ViewpointChoice:
    """The prior in a file; without a file the one that comes with the package, and for :data:`NO_PRIOR` none.

    Raises:
        OSError, ValueError: it is no such file.
    """
    if file is None:
        return "default"
    return None if file == NO_PRIOR else ViewpointPrior.load(file)
