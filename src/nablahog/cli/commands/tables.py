"""``nablahog table1`` and ``nablahog table2``: the tables of pre-images and of poses."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypeAlias

import numpy as np

from ...io.arrays import naming
from ...io.files import output_folder, write_text
from ...io.images import SAMPLE_NAMES, sample_photograph
from ...io.photographs import Photographs, read_folder, sample_photographs
from ...jobs.worker import cores
from ...paper import table1_page, table2_page
from ...paper.annotations import read_annotations, read_viewpoints, sample_viewpoints
from ...paper.examples import CONDITIONS, Examples, photograph_examples, render_examples
from ...paper.learned import learned_from_samples, load, shipped_files
from ...paper.methods import ReconstructionMethod, Table1Settings, choose
from ...paper.pascal3d import read_pascal3d
from ...paper.pose_methods import POSE_METHODS, PoseMethod, Table2Settings
from ...paper.scenes import CHAIRS
from ...paper.table1 import run_table1, write_table1
from ...paper.table2 import run_table2, write_table2
from ...paper.tables import Results
from ...render.models import SAMPLE_CHAIRS, Model, archived_models, check_models, read_models
from ...runtime.text import counted
from ..arguments.parsers import HARDER, SCENES
from ..errors import WrongArguments, blaming_arguments
from ..terminal import counter, print_table, say, say_ignored, say_page

VIEWPOINTS = 10_000  # sampled from our own distribution; each scene has one of them

Objects: TypeAlias = tuple[Examples, dict[str, Examples], dict[str, str]]


def table1(arguments: Namespace) -> None:
    """Makes the table of ``arguments.methods`` on ``arguments.images``."""
    files = {kind: Path(file).resolve() for kind, file in arguments.learned or ()}
    shipped = shipped_files()
    with blaming_arguments():
        methods, left_out = choose(arguments.methods, files, shipped)
    _check_files(files, methods)
    files = {kind: path for kind, path in shipped.items() if any(kind in each.needs for each in methods)} | files
    photographs, origin = _photographs(arguments)
    with output_folder(arguments.output) as folder:
        settings = Table1Settings(arguments.seed, arguments.max_evaluations, files | _learn_missing(files, methods))
        remarks = table1_page.remarks(left_out, settings.learned, photographs)
        with counter("nablahog table1", "results") as progress:
            workers = arguments.workers or cores()
            table = run_table1(
                folder, photographs, methods, settings, workers=workers, cluster=arguments.cluster, progress=progress
            )
        if not any(table.seconds.values()):
            first = table.failures[0]
            raise ValueError(f"no image has a result; the first: {first.image}: {first.reason}")
        write_table1(folder, table)
        write_text(folder / "index.html", table1_page.page(table, settings, origin, remarks))
    print_table(table1_page.terminal_rows(table))
    _say_ran(methods, table)
    say_ignored(photographs.ignored)
    for remark in remarks:
        say(remark)
    say_page(folder / "index.html")


def table2(arguments: Namespace) -> None:
    """Makes the table of ``arguments.methods``."""
    methods = [method for name, method in POSE_METHODS.items() if name in (arguments.methods or POSE_METHODS)]
    examples, conditions, passed_over = objects(arguments)
    with output_folder(arguments.output) as folder:
        settings = Table2Settings(arguments.seed, folder / "exemplars")
        if arguments.cluster is not None:
            (folder / "exemplars").mkdir(exist_ok=True)  # so that workers see that they share the folder
        with counter("nablahog table2", "results") as progress:
            table = run_table2(
                folder,
                examples,
                methods,
                settings,
                conditions,
                workers=arguments.workers or cores(),
                cluster=arguments.cluster,
                progress=progress,
            )
        if not any(table.seconds.values()):
            first = next(failure for failure in table.failures if failure.method is not None)
            raise ValueError(f"no object has a pose; the first: {first.image}: {first.reason}")
        write_table2(folder, table)
        write_text(folder / "index.html", table2_page.page(table, settings))
    say(table.examples.origin)
    say("Percent of azimuths that are right, by equal intervals (the paper's in brackets) and by the error:")
    print_table(table2_page.terminal_rows(table))
    print_table(table2_page.terminal_rotations(table))
    if table.conditions:
        print_table(table2_page.terminal_conditions(table))
    _say_ran(methods, table)
    for name, reason in passed_over.items():
        say(f"Skipped: {name}: {reason}")
    say_page(folder / "index.html")


def _say_ran(methods: Sequence[ReconstructionMethod | PoseMethod], results: Results) -> None:
    """Names the methods, and each result that is missing from the table."""
    say(f"Ran: {', '.join(method.name for method in methods)}")
    for failure in results.failures:
        say(f"Failed: {failure.image}, {failure.method or 'all methods'}: {failure.reason}")


def _check_files(files: Mapping[str, Path], methods: Sequence[ReconstructionMethod]) -> None:
    """Raises ValueError if a learned file cannot be read or is for other descriptors than those of its methods."""
    for kind, path in files.items():
        model = load(kind, path)
        for method in methods:
            if method.needs[:1] == (kind,) and method.spec is not None:
                with naming(method.name):
                    model.check(method.spec)


def _learn_missing(files: Mapping[str, Path], methods: Sequence[ReconstructionMethod]) -> dict[str, Path]:
    """Learns, from bundled photographs, the files that methods need and no option gives."""
    learned = {}
    for kind in dict.fromkeys(kind for method in methods for kind in method.needs if kind not in files):
        with counter(f"nablahog table1, learning {kind} (--methods without it skips this)", "steps") as progress:
            learned[kind] = learned_from_samples(kind, progress)
    return learned


def _photographs(arguments: Namespace) -> tuple[Photographs, str]:
    """The images for the table, and a sentence that says where they are from."""
    if arguments.images is None:
        photographs = sample_photographs(size=arguments.size, limit=arguments.limit)
        return photographs, f"{_count(photographs, 'photograph')} of scikit-image, cut to the middle square."
    folder = Path(arguments.images)
    photographs = read_folder(folder, size=arguments.size, limit=arguments.limit)
    return photographs, f"{_count(photographs, 'image')} of the folder {folder.resolve().name}."


def _count(photographs: Photographs, noun: str) -> str:
    """How many of how many photographs there are, as ``noun``."""
    number = len(photographs.images) + len(photographs.failed)
    everything = counted(photographs.available, noun)
    return everything if number == photographs.available else f"The first {number} of {everything}"


def objects(arguments: Namespace) -> Objects:
    """The objects of the table, those of the second table by condition, and why models are passed over, by name."""
    if arguments.pascal3d is not None and arguments.annotations is not None:
        raise WrongArguments("expected --pascal3d or annotated photographs, got both")
    if arguments.viewpoints is not None and (arguments.pascal3d or arguments.annotations) is not None:
        raise WrongArguments("--viewpoints is for rendered scenes; photographs have their own viewpoints")
    if arguments.pascal3d is not None:
        return _published(arguments)
    return _scenes(arguments) if arguments.annotations is None else _annotated(arguments)


def _models(folder: str | None, shipped: Path) -> tuple[list[Model], dict[str, str]]:
    """The models of a folder, or of an archive that comes with the package; why others cannot be read, by name."""
    return (archived_models(shipped), {}) if folder is None else check_models(read_models(folder)[0])


def _published(arguments: Namespace) -> Objects:
    if arguments.conditions:
        raise WrongArguments(
            "--conditions needs scenes or annotations: objects of --pascal3d are cut out along their boxes"
        )
    voc, pascal3d = map(Path, arguments.pascal3d)
    models, passed_over = check_models(read_models(arguments.models or pascal3d / "CAD" / "chair")[0])
    selection = read_pascal3d(voc, pascal3d)
    if arguments.objects is not None:
        selection = replace(selection, objects=selection.objects[: arguments.objects])
    examples = photograph_examples(
        selection.objects,
        models,
        origin=f"PASCAL VOC with the viewpoints of PASCAL3D+: {selection.summary()}",
        unknown_model=arguments.unknown_model,
        seed=arguments.seed,
        failed=selection.failed,
    )
    return examples, {}, passed_over


def _annotated(arguments: Namespace) -> Objects:
    models, passed_over = _models(arguments.models, SAMPLE_CHAIRS)
    folder = Path(arguments.annotations).resolve().parent
    read = read_annotations(arguments.annotations, {model.name for model in models}, arguments.objects)
    made = partial(
        photograph_examples,
        models=models,
        origin=f"{counted(len(read), 'object')} in photographs of the folder {folder.name}.",
        unknown_model=arguments.unknown_model,
        seed=arguments.seed,
    )
    names = arguments.conditions or []
    if names == list(CONDITIONS):  # all
        names = [name for name in CONDITIONS if CONDITIONS[name].of_photographs and name != "exact"]
    for name in names:
        if not CONDITIONS[name].of_photographs:
            raise WrongArguments(f"the condition {name} is for rendered scenes only, not for photographs")
    return made(read), {name: made(read[:HARDER], condition=name) for name in names}, passed_over


def _scenes(arguments: Namespace) -> Objects:
    models, passed_over = _models(arguments.models, CHAIRS)
    if arguments.viewpoints is None:
        viewpoints = sample_viewpoints(VIEWPOINTS, np.random.default_rng(arguments.seed))
        views = "seen as people photograph chairs"
    else:
        viewpoints = read_viewpoints(arguments.viewpoints)
        views = f"seen from {counted(len(viewpoints), 'viewpoint')} of {Path(arguments.viewpoints).name}"
    of = (
        counted(len(models), "procedural chair")
        if arguments.models is None
        else f"{counted(len(models), 'model')} of the folder {Path(arguments.models).resolve().name}"
    )
    made: Callable[..., Examples] = partial(
        render_examples,
        models=models,
        viewpoints=viewpoints,
        photographs=[sample_photograph(name) for name in SAMPLE_NAMES],
        origin=f"{of}, {views}, in front of photographs that come with scikit-image",
        unknown_model=arguments.unknown_model,
        seed=arguments.seed,
    )
    count = arguments.objects or SCENES
    names = CONDITIONS if arguments.conditions is None else arguments.conditions
    harder = {name: made(min(HARDER, count), condition=name) for name in names}
    return made(count), harder, passed_over
