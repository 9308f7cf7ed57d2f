"""The job of ``nablahog learn exemplars``: the views of one model."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..jobs.store import JobResult
from ..pose.background import default_background
from ..pose.exemplar_views import SPEC, ExemplarLibrary
from ..pose.whitening import Background
from ..render import load_mesh


@dataclass(frozen=True)
class ExemplarJob:
    """Views of the model in a file, stored in a folder.

    Attributes:
        model: the file of a mesh.
        folder: of the :class:`~nablahog.pose.exemplar_views.ExemplarLibrary`.
        background: the file of a background; None for the default.
    """

    model: Path
    folder: Path
    background: Path | None

    def run(self) -> JobResult:
        """Learns the views, or reads them if they are stored.

        Raises:
            ValueError, OSError: the model or the background cannot be read, or the views not be written.
        """
        began = time.perf_counter()
        views = ExemplarLibrary(self.folder, read_background(self.background)).views(load_mesh(self.model))
        figures = {"views": len(views.viewpoints), "elements": len(views.scale)}
        return JobResult([figures], np.empty(0, np.uint8), time.perf_counter() - began)


def read_background(path: Path | None) -> Background:
    """The background in a file, of the baseline's dialect and templates; None for the default.

    Raises:
        FileNotFoundError, ValueError: there is none in it, or of another dialect.
    """
    if path is None:
        return default_background(SPEC)
    background = Background.load(path)
    try:
        background.check(SPEC)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return background
