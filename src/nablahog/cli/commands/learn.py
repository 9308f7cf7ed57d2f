"""``nablahog learn``: models that are learned from photographs, and views of CAD models for the baseline of Table 2."""

from __future__ import annotations

import time
from argparse import Namespace
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from ...datasets.cad import read_models
from ...evaluate.learned import LEARNED, SPEC, Learner, sample_training_photographs
from ...evaluate.photographs import Photographs, read_folder, sample_photographs
from ...hog import HOGSpec
from ...io.files import output_folder, remove_parts
from ...io.npz import naming
from ...jobs.runner import cores, run_jobs
from ...jobs.store import JobResult
from ...pose import exemplar_views
from ...pose.background import default_background, learn_background, least_size
from ...pose.exemplar_views import ExemplarLibrary
from ...pose.whitening import Background, check_spec
from ...render import load_mesh
from ..errors import UserError, as_user_error
from ..inputs.spec import SpecOptions
from ..terminal import counter, say
from .tables import say_ignored

OPTIONS = ("seed", "epochs", "fast", "order")  # of the command that are arguments of a learner


def learn(arguments: Namespace) -> None:
    """Learns a model of ``arguments.kind``; an interrupted run is resumed where the model has a checkpoint.

    Raises:
        UserError: an input is unusable.
        OSError: a file or folder is missing or cannot be written.
    """
    learner, output = _learner(arguments), Path(arguments.output)
    noun = learner.model.NOUN
    if output.suffix.lower() != ".npz" or output.is_dir():
        raise UserError(f"a {noun} is one file: expected -o FILE.npz, got {output}")
    if getattr(arguments, "threads", None) is not None:
        torch.set_num_threads(arguments.threads)
    with as_user_error():
        spec = SpecOptions.of(arguments).spec() if "descriptor" in arguments else SPEC
        learner.check(spec)  # before any image is read
        photographs = _photographs(arguments, learner, spec)
    options = {name: getattr(arguments, name) for name in OPTIONS if name in arguments}
    with output_folder(output.parent), as_user_error():
        for name, reason in photographs.failed.items():
            say(f"Passed over: {name}: {reason}")
        say_ignored(photographs)
        with counter(f"nablahog {arguments.command}") as progress:
            model = learner.learn_to(output, photographs.images, spec, progress, **options)
    say(f"{noun.capitalize()} in {output}: {model.summary}")


def _learner(arguments: Namespace) -> Learner:
    if arguments.kind == "background":
        return Learner(Background, learn_background, check_spec, lambda spec: least_size(spec, arguments.order))
    learner = LEARNED[arguments.kind]
    return replace(learner, resumes=False) if getattr(arguments, "fast", False) else learner


def _photographs(arguments: Namespace, learner: Learner, spec: HOGSpec) -> Photographs:
    """The photographs of the option ``--images``, or the sample photographs.

    Returns:
        At least one image; ``failed`` has the files that cannot be read and the images that are too small.

    Raises:
        FileNotFoundError, NotADirectoryError: there is no such folder.
        ValueError: it holds no image, or none to learn from.
    """
    folder, size = arguments.images, arguments.size
    if folder is None and learner.tile is not None:
        return Photographs(sample_training_photographs(arguments.kind))
    read = sample_photographs(size=size, whole=True) if folder is None else read_folder(Path(folder), size=size)
    least = learner.least(spec)
    for name, image in list(read.images.items()):
        height, width = image.shape
        if height < least[0] or width < least[1]:
            read.failed[name] = f"expected at least {least[0]}x{least[1]} pixels, got {height}x{width}"
            del read.images[name]
    if not read.images:
        name, reason = next(iter(read.failed.items()))
        raise ValueError(f"{folder or 'scikit-image'}: no image is usable; the first: {name}: {reason}")
    return read


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
