"""``nablahog table2``: the table of poses."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...datasets.pascal3d import read_pascal3d
from ...datasets.viewpoints import read_viewpoints, sample_viewpoints
from ...evaluate import table2_page
from ...evaluate.examples import Examples, photographed, rendered
from ...evaluate.models import models_in, procedural_chairs
from ...evaluate.pose_methods import POSE_METHODS, Table2Settings
from ...evaluate.table2 import run_table2, write_table2
from ...io.files import output_folder, write_text
from ...io.sample_photographs import SAMPLE_NAMES, sample_photograph
from ...jobs.runner import cores
from ..arguments.tables import SCENES
from ..errors import UserError, as_user_error
from ..results.failures import say_failures
from ..terminal import counter, print_table, say, say_page

CHAIRS = 24  # procedural models
VIEWPOINTS = 10_000  # of our own distribution, of which each scene has one


def table2(arguments: Namespace) -> None:
    """Makes the table of ``arguments.methods``.

    Raises:
        UserError: an input is unusable, or there is no pose of any object.
        OSError: a file or folder is missing or cannot be written.
    """
    methods = [method for name, method in POSE_METHODS.items() if name in (arguments.methods or POSE_METHODS)]
    with as_user_error():
        examples, passed_over = _examples(arguments)
    with output_folder(arguments.output) as folder:
        settings = Table2Settings(arguments.seed, folder / "exemplars")
        if arguments.cluster is not None:
            (folder / "exemplars").mkdir(exist_ok=True)  # by which workers know that they share the folder
        with counter("nablahog table2") as progress, as_user_error():
            workers = arguments.workers or cores()
            table = run_table2(
                folder, examples, methods, settings, workers=workers, cluster=arguments.cluster, progress=progress
            )
        if not any(table.seconds.values()):
            first = next(failure for failure in table.failures if failure.method is not None)
            raise UserError(f"there is no pose of any object; the first: {first.image}: {first.reason}")
        write_table2(folder, table)
        write_text(folder / "index.html", table2_page.page(table, settings))
    say(table.examples.origin)
    print_table(table2_page.terminal_rows(table))
    print_table(table2_page.terminal_rotations(table))
    say(f"Ran: {', '.join(method.name for method in methods)}")
    say_failures(table)
    for name, reason in passed_over.items():
        say(f"Passed over: {name}: {reason}")
    say_page(folder / "index.html")


def _examples(arguments: Namespace) -> tuple[Examples, dict[str, str]]:
    """The objects, and why models are passed over, by their names."""
    photographs = [path for path in (arguments.voc, arguments.pascal3d) if path is not None]
    if len(photographs) == 1:
        raise ValueError("--voc and --pascal3d need each other: the one has the photographs, the other the viewpoints")
    if photographs:
        return _photographed(arguments)
    models, passed_over = (
        (procedural_chairs(CHAIRS), {}) if arguments.models is None else models_in(Path(arguments.models))
    )
    if arguments.viewpoints is None:
        viewpoints = sample_viewpoints(VIEWPOINTS, np.random.default_rng(arguments.seed))
        views = "seen as people photograph chairs"
    else:
        viewpoints = read_viewpoints(arguments.viewpoints)
        views = f"seen from the {len(viewpoints)} viewpoints of {Path(arguments.viewpoints).name}"
    kind = (
        "procedural chairs"
        if arguments.models is None
        else f"models of the folder {Path(arguments.models).resolve().name}"
    )
    origin = f"{len(models)} {kind}, {views}, in front of photographs that come with scikit-image"
    examples = rendered(
        arguments.objects or SCENES,
        models,
        viewpoints,
        [sample_photograph(name) for name in SAMPLE_NAMES],
        origin=origin,
        unknown_model=arguments.unknown_model,
        seed=arguments.seed,
    )
    return examples, passed_over


def _photographed(arguments: Namespace) -> tuple[Examples, dict[str, str]]:
    if arguments.viewpoints is not None:
        raise ValueError("--viewpoints is for scenes that are rendered; the objects of --pascal3d have theirs")
    pascal3d = Path(arguments.pascal3d)
    models, passed_over = models_in(pascal3d / "CAD" / "chair" if arguments.models is None else Path(arguments.models))
    selection = read_pascal3d(Path(arguments.voc), pascal3d)
    if arguments.objects is not None:
        selection = replace(selection, objects=selection.objects[: arguments.objects])
    return photographed(selection, models, unknown_model=arguments.unknown_model, seed=arguments.seed), passed_over
