"""``nablahog learn``: models that are learned from photographs."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import Any

import torch

from ...hog import HOGSpec, presets
from ...invert import LearnedPrior, default_prior
from ...io.files import output_folder
from ...io.learner import Learner
from ...io.photographs import Photographs, read_folder, sample_photographs
from ...jobs.runner import map_on
from ...paper.learned import LEARNED, SPEC, sample_training_photographs
from ...pose.background import learn_background, least_size
from ...pose.whitening import Background, check_spec
from ...requests.dialect import Dialect
from ..arguments.options import build_request
from ..arguments.parsers import TRAINING_SIZE
from ..errors import WrongArguments
from ..terminal import counter, say, say_ignored


def learn(arguments: Namespace) -> None:
    """Learns a model of ``arguments.kind``; an interrupted run is resumed."""
    learner, output = _learner(arguments.kind), Path(arguments.output)
    noun = learner.model.NOUN
    if output.suffix.lower() != ".npz" or output.is_dir():
        raise WrongArguments(f"a {noun} is one file: expected -o FILE.npz, got {output}")
    spec = _spec(arguments)
    learner.check(spec)  # before any image is read
    photographs = _photographs(arguments, learner, spec)
    options = _options(arguments, spec)
    with output_folder(output.parent):
        for name, reason in photographs.failed.items():
            say(f"Skipped: {name}: {reason}")
        say_ignored(photographs.ignored)
        with counter(f"nablahog {arguments.command}", "steps") as progress:
            model = learner.learn_to(output, photographs.images, spec, progress, **options)
    say(f"{noun.capitalize()} in {output}: {model.summary}")


def _learner(kind: str) -> Learner:
    if kind == "background":
        return Learner(Background, learn_background, check_spec, least_size)
    return LEARNED[kind]


def _options(arguments: Namespace, spec: HOGSpec) -> dict[str, Any]:
    options = {name: getattr(arguments, name) for name in ("seed", "epochs") if name in arguments}
    if arguments.kind == "prior":
        options["device"] = "cuda" if torch.cuda.is_available() else "cpu"
        if arguments.start is not None:
            start = default_prior(spec) if arguments.start == "default" else LearnedPrior.load(arguments.start)
            start.check(spec)
            options["start"] = start
    if getattr(arguments, "cluster", None) is not None:
        options["map_function"] = map_on(arguments.cluster)
    return options


def _spec(arguments: Namespace) -> HOGSpec:
    """The spec to learn for; of a prior, one of those that it is for."""
    if "preset" in arguments:
        return build_request(Dialect, arguments).spec
    return presets.paper() if getattr(arguments, "signs", None) == "unsigned" else SPEC


def _photographs(arguments: Namespace, learner: Learner, spec: HOGSpec) -> Photographs:
    """The photographs of the option ``--images``, or the sample photographs.

    Returns:
        At least one image; ``failed`` has the files that cannot be read and the images that are too small.
    """
    folder, size = arguments.images, getattr(arguments, "size", TRAINING_SIZE)
    if folder is None and learner.tile is not None:
        return Photographs(sample_training_photographs(arguments.kind))
    if folder is None:
        read = sample_photographs(size=size, whole=True)
    else:
        read = read_folder(Path(folder), size=size, recursive=True)
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
