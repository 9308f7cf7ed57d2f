"""``nablahog learn exemplars``: views of CAD models for the baseline of Table 2."""

from __future__ import annotations

from argparse import Namespace
from contextlib import closing
from pathlib import Path

from ...datasets.cad import read_models
from ...evaluate.exemplar_job import ExemplarJob, read_background
from ...io.files import output_folder, remove_parts
from ...jobs.runner import cores, run_jobs
from ..errors import UserError, as_user_error
from ..terminal import counter, say


def learn_exemplars(arguments: Namespace) -> None:
    """Learns the views of all models of a folder; views that an earlier run has stored are reused.

    Raises:
        UserError: no model is usable, or the background is not.
        OSError: a file or folder is missing or cannot be written.
    """
    background = None if arguments.background is None else Path(arguments.background)
    with as_user_error():
        models = read_models(arguments.models)
        read_background(background)
    with output_folder(arguments.output) as folder:
        remove_parts(folder, older_than=60)
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
