"""``nablahog learn exemplars``: views of CAD models, for the baseline of Table 2."""

from __future__ import annotations

import tempfile
from argparse import Namespace
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from ...io.files import output_folder, replacing
from ...io.npz import naming
from ...jobs.job_files import local_path
from ...jobs.resume import run_anywhere
from ...jobs.runner import cores
from ...paper import exemplar_views
from ...paper.exemplar_views import ExemplarLibrary, ExemplarViews
from ...paper.models import read_models
from ...pose.background import default_background
from ...pose.whitening import Background
from ...render import load_mesh
from ..errors import UserError, as_user_error
from ..terminal import counter, say


@dataclass(frozen=True)
class ExemplarJob:
    """Views of the model in a file.

    Attributes:
        model: the file of a mesh.
        background: the file of a background; None for the default.
        stored: keys of views that need not be learned.
    """

    model: Path
    background: Path | None
    stored: frozenset[str]

    def files(self) -> list[Path]:
        """The model and the background."""
        return [path for path in (self.model, self.background) if path is not None]

    def run(self) -> tuple[str, bytes]:
        """The key of the views, and their file; nothing of those that are stored.

        Raises:
            ValueError, OSError: the model or the background cannot be read.
        """
        mesh = load_mesh(local_path(self.model))
        library = ExemplarLibrary(None, _background(self.background and local_path(self.background)))
        key = library.key(mesh)
        if key in self.stored:
            return key, b""
        with tempfile.TemporaryDirectory(prefix="nablahog-") as folder:
            file = Path(folder, "views.npz")
            library.views(mesh).save(file)
            return key, file.read_bytes()


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
        stored = {path.stem: path for path in folder.glob("*.npz") if _elements(path) is not None}
        jobs = {name: ExemplarJob(path, background, frozenset(stored)) for name, path in models.paths.items()}
        names, failed, elements = list(jobs), {}, 0
        with counter("nablahog learn exemplars") as progress, as_user_error():
            progress(0, len(jobs), "")
            workers = arguments.workers or cores()
            with closing(run_anywhere(list(jobs.values()), workers, arguments.cluster)) as outcomes:
                for done, (index, outcome) in enumerate(outcomes, start=1):
                    progress(done, len(jobs), names[index])
                    if isinstance(outcome, str):
                        failed[names[index]] = outcome
                        continue
                    key, contents = outcome
                    path = folder / f"{key}.npz"
                    if contents:
                        with replacing(path) as file:
                            file.write(contents)
                    elements += _elements(path) or 0
        if len(failed) == len(jobs):
            name, reason = next(iter(failed.items()))
            raise UserError(f"{arguments.models}: no model is usable; the first: {name}: {reason}")
    for name, reason in sorted(failed.items()):
        say(f"Passed over: {name}: {reason}")
    if models.ignored:
        say(f"Passed over, as no models by their endings: {', '.join(models.ignored)}")
    say(f"Exemplars of {len(jobs) - len(failed)} models in {folder}: {elements:,} elements")


def _elements(path: Path) -> int | None:
    """How many elements the views in a file have; None if it is damaged."""
    try:
        return len(ExemplarViews.load(path).scale)
    except (OSError, ValueError):
        return None
