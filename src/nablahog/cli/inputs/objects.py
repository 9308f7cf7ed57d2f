"""The objects of ``nablahog table2``: scenes, those of PASCAL3D+, or annotated photographs; and harder ones."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from ...io.images import SAMPLE_NAMES, sample_photograph
from ...paper.annotations import read_annotations, read_viewpoints, sample_viewpoints
from ...paper.examples import CONDITIONS, Examples, photographed, rendered
from ...paper.models import chair_library, models_in, scene_chairs
from ...paper.pascal3d import read_pascal3d
from ..arguments.tables import HARDER, SCENES

VIEWPOINTS = 10_000  # sampled from our own distribution; each scene has one of them


@dataclass(frozen=True)
class Objects:
    """The objects of a run.

    Attributes:
        examples: of the table.
        conditions: of the second table, by the names of their conditions.
        passed_over: why models are passed over, by their names.
    """

    examples: Examples
    conditions: dict[str, Examples]
    passed_over: dict[str, str]


def objects(arguments: Namespace) -> Objects:
    """The objects that the arguments ask for."""
    if arguments.pascal3d is not None and arguments.annotations is not None:
        raise ValueError("--pascal3d and annotated photographs are two sets of objects; one at a time")
    if arguments.viewpoints is not None and (arguments.pascal3d or arguments.annotations) is not None:
        raise ValueError("--viewpoints is for scenes that are rendered; photographs have theirs")
    if arguments.pascal3d is not None:
        return _published(arguments)
    return _scenes(arguments) if arguments.annotations is None else _photographs(arguments)


def _published(arguments: Namespace) -> Objects:
    if arguments.conditions:
        raise ValueError(
            "--conditions needs scenes or annotations: objects of --pascal3d are cut out along their boxes"
        )
    voc, pascal3d = map(Path, arguments.pascal3d)
    models, passed_over = models_in(Path(arguments.models or pascal3d / "CAD" / "chair"))
    selection = read_pascal3d(voc, pascal3d)
    if arguments.objects is not None:
        selection = replace(selection, objects=selection.objects[: arguments.objects])
    examples = photographed(
        selection.objects,
        models,
        origin=f"PASCAL VOC with the viewpoints of PASCAL3D+: {selection.summary()}",
        unknown_model=arguments.unknown_model,
        seed=arguments.seed,
        failed=selection.failed,
    )
    return Objects(examples, {}, passed_over)


def _photographs(arguments: Namespace) -> Objects:
    models, passed_over = (chair_library(), {}) if arguments.models is None else models_in(Path(arguments.models))
    folder = Path(arguments.annotations).resolve().parent
    read = read_annotations(arguments.annotations, {model.name for model in models}, arguments.objects)
    made = partial(
        photographed,
        models=models,
        origin=f"{len(read)} objects of the photographs of the folder {folder.name}.",
        unknown_model=arguments.unknown_model,
        seed=arguments.seed,
    )
    names = arguments.conditions
    if names is None:
        names = [name for name in CONDITIONS if CONDITIONS[name].of_photographs and name != "exact"]
    for name in names:
        if not CONDITIONS[name].of_photographs:
            raise ValueError(f"the condition {name} is of scenes that are rendered, which photographs are not")
    return Objects(made(read), {name: made(read[:HARDER], condition=name) for name in names}, passed_over)


def _scenes(arguments: Namespace) -> Objects:
    models, passed_over = (scene_chairs(), {}) if arguments.models is None else models_in(Path(arguments.models))
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
    made: Callable[..., Examples] = partial(
        rendered,
        models=models,
        viewpoints=viewpoints,
        photographs=[sample_photograph(name) for name in SAMPLE_NAMES],
        origin=f"{len(models)} {kind}, {views}, in front of photographs that come with scikit-image",
        unknown_model=arguments.unknown_model,
        seed=arguments.seed,
    )
    count = arguments.objects or SCENES
    names = CONDITIONS if arguments.conditions is None else arguments.conditions
    harder = {name: made(min(HARDER, count), condition=name) for name in names}
    return Objects(made(count), harder, passed_over)
