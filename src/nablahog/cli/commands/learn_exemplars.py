"""``nablahog learn exemplars``: views of CAD models, for the baseline of Table 2."""

from __future__ import annotations

import time
from argparse import Namespace
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...datasets.cad import read_models
from ...io.files import output_folder
from ...io.npz import naming
from ...jobs.runner import cores, run_jobs
from ...jobs.store import JobResult
from ...pose import exemplar_views
from ...pose.background import default_background
from ...pose.exemplar_views import ExemplarLibrary
from ...pose.whitening import Background
from ...render import load_mesh
from ..errors import UserError, as_user_error
from ..terminal import counter, say


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
        views = ExemplarLibrary(self.folder, _background(self.background)).views(load_mesh(self.model))
        figures = {"views": len(views.viewpoints), "elements": len(views.scale)}
        return JobResult([figures], np.empty(0, np.uint8), time.perf_counter() - began)


def _background(path: Path | None) -> Background:
    """The background in a file, of the baseline's dialect and templates; None for the default.

    Raises:
        FileNotFoundError, ValueError: there is none in it, or of another dialect.
    """
    if path is None:
        return default_background(exemplar_views.SPEC)
    background = Background.load(path)
    with naming(path):
        background.check(exemplar_views.SPEC)
    return background


def learn_exemplars(arguments: Namespace) -> None:
    """Learns the views of all models of a folder; views that an earlier run has stored are reused.

    Raises:
        UserError: no model is usable, or the background is not.
        OSError: a file or folder is missing or cannot be written.
    """
    background = None if arguments.background is None else Path(arguments.background)
    with as_user_error():
        models = read_models(arguments.models)
        _background(background)
    with output_folder(arguments.output) as folder:
        jobs = {name: ExemplarJob(path, folder, background) for name, path in models.paths.items()}
        names, failed, elements = list(jobs), {}, 0
        workers = arguments.workers or cores()
        with counter("nablahog learn exemplars") as progress:
            progress(0, len(jobs), "")
            with closing(run_jobs(list(jobs.values()), workers=workers)) as outcomes:
                for done, (index, outcome) in enumerate(outcomes, start=1):
                    progress(done, len(jobs), names[index])
                    if isinstance(outcome, str):
                        failed[names[index]] = outcome
                    else:
                        elements += int(outcome.figures[0]["elements"])
        if len(failed) == len(jobs):
            name, reason = next(iter(failed.items()))
            raise UserError(f"{arguments.models}: no model is usable; the first: {name}: {reason}")
    for name, reason in sorted(failed.items()):
        say(f"Passed over: {name}: {reason}")
    if models.ignored:
        say(f"Passed over, as no models by their endings: {', '.join(models.ignored)}")
    say(f"Exemplars of {len(jobs) - len(failed)} models in {folder}: {elements:,} elements")
