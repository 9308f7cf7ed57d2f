"""What is learned from photographs, as ``nablahog learn`` does it."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import TypeVar

import torch

from ...evaluate.learned import Progress, Saved, sample_training_photographs
from ...evaluate.photographs import Photographs
from ...hog import HOGSpec
from ...invert import train_prior
from ...invert.baselines.bovw_learning import learn_bovw as learn_words
from ...invert.baselines.hoggles import patch_size
from ...invert.baselines.hoggles_learning import learn_hoggles as learn_pair
from ...invert.baselines.nearest import learn_nearest as keep_windows
from ...invert.baselines.ridge import learn_ridge as fit_regression
from ...invert.baselines.windows import check_cells
from ...invert.crops import least_side
from ...invert.network import default_architecture
from ...io.files import checkpoint_for, output_folder
from ...pose.background import learn_background as measure_background
from ...pose.background import least_size
from ...pose.whitening import check_spec
from ..errors import UserError, refusing
from ..inputs.spec import Wanted
from ..inputs.training_photographs import training_photographs
from ..terminal import counter, say
from .table1 import say_ignored

Result = TypeVar("Result", bound=Saved)


def learn_prior(arguments: Namespace) -> None:
    """Learns what photographs look like; goes on after the last whole epoch of an interrupted run.

    Raises:
        UserError: an input is unusable.
        OSError: a file or folder is missing or cannot be written.
    """
    output = _npz_file(arguments, "a prior")
    if arguments.threads is not None:
        torch.set_num_threads(arguments.threads)
    spec = _spec(arguments, default_architecture)
    photographs = _lessons(arguments, (least_side(spec.cell_size[0]),) * 2)
    options = {"epochs": arguments.epochs, "seed": arguments.seed}
    prior = _learn(
        arguments,
        photographs,
        lambda kept, progress: train_prior(photographs.images, spec, checkpoint=kept, progress=progress, **options),
        resumes=True,
    )
    training = prior.training
    say(
        f"Learned prior in {output}: {len(training.images)} images, {training.epochs} epochs, last loss "
        f"{training.losses[-1]:.4f}, {len(prior.weights):,} weights"
    )


def learn_background(arguments: Namespace) -> None:
    """Learns what descriptors of photographs have in common.

    Raises:
        UserError: an input is unusable.
        OSError: a file or folder is missing or cannot be written.
    """
    output = _npz_file(arguments, "a background")
    spec = _spec(arguments, check_spec)
    photographs = _lessons(arguments, least_size(spec, arguments.order))
    background = _learn(
        arguments,
        photographs,
        lambda kept, progress: measure_background(photographs.images, spec, order=arguments.order, progress=progress),
    )
    say(
        f"Background in {output}: {len(background.images)} images, {spec.channels} channels, templates of up to "
        f"{background.order + 1}x{background.order + 1} cells"
    )


def learn_hoggles(arguments: Namespace) -> None:
    """Learns the paired dictionaries of HOGgles; an interrupted run goes on.

    Raises:
        UserError: an input is unusable.
        OSError: a file or folder is missing or cannot be written.
    """
    output = _npz_file(arguments, "a pair of dictionaries")
    spec = _spec(arguments, check_cells)
    photographs = _lessons(arguments, patch_size(spec))
    options = {"fast": arguments.fast, "seed": arguments.seed}
    pair = _learn(
        arguments,
        photographs,
        lambda kept, progress: learn_pair(photographs.images, spec, checkpoint=kept, progress=progress, **options),
        resumes=not arguments.fast,
    )
    say(f"Dictionaries in {output}: {len(pair.gray)} pairs of atoms, {len(pair.learning.images)} images")


def learn_bovw(arguments: Namespace) -> None:
    """Learns visual words, from tiles of the photographs that come with scikit-image if there is no folder.

    Raises:
        UserError: an input is unusable.
        OSError: a file or folder is missing or cannot be written.
    """
    output = _npz_file(arguments, "a vocabulary")
    photographs = (
        Photographs(sample_training_photographs("bovw")) if arguments.images is None else _lessons(arguments, (1, 1))
    )
    words = _learn(
        arguments,
        photographs,
        lambda kept, progress: learn_words(photographs.images, seed=arguments.seed, progress=progress),
    )
    say(f"Vocabulary in {output}: {len(words.vocabulary)} words, {len(words.learning.images)} images")


def learn_ridge(arguments: Namespace) -> None:
    """Learns the patch of an image as a linear function of a window of its descriptor.

    Raises:
        UserError: an input is unusable.
        OSError: a file or folder is missing or cannot be written.
    """
    output = _npz_file(arguments, "a regression")
    spec = _spec(arguments, check_cells)
    photographs = _lessons(arguments, spec.cell_size)
    ridge = _learn(
        arguments,
        photographs,
        lambda kept, progress: fit_regression(photographs.images, spec, seed=arguments.seed, progress=progress),
    )
    learning = ridge.learning
    say(f"Regression in {output}: {ridge.weights.numel():,} weights, {len(learning.images)} images")


def learn_nearest(arguments: Namespace) -> None:
    """Keeps photographs, among whose windows the nearest ones are sought.

    Raises:
        UserError: an input is unusable.
        OSError: a file or folder is missing or cannot be written.
    """
    output = _npz_file(arguments, "a database")
    spec = _spec(arguments, check_cells)
    photographs = _lessons(arguments, spec.cell_size)
    database = _learn(
        arguments,
        photographs,
        lambda kept, progress: keep_windows(photographs.images, spec, seed=arguments.seed, progress=progress),
    )
    say(f"Database in {output}: {len(database.images)} images")


def _npz_file(arguments: Namespace, what: str) -> Path:
    output = Path(arguments.output)
    if output.suffix.lower() != ".npz" or output.is_dir():
        raise UserError(f"{what} is one file: expected -o FILE.npz, got {output}")
    return output


def _spec(arguments: Namespace, check: Callable[[HOGSpec], object] = lambda spec: None) -> HOGSpec:
    """The dialect, which ``check`` raises for if it will not do, before any image is read."""
    with refusing():
        spec = Wanted.of(arguments).spec()
        check(spec)
    return spec


def _lessons(arguments: Namespace, least: tuple[int, int]) -> Photographs:
    with refusing():
        return training_photographs(None if arguments.images is None else Path(arguments.images), least, arguments.size)


def _learn(
    arguments: Namespace,
    photographs: Photographs,
    learn: Callable[[Path | None, Progress], Result],
    *,
    resumes: bool = False,
) -> Result:
    """What ``learn`` makes of a file for its checkpoint, if it ``resumes``, and of something to report to.

    It is written to the file ``-o``.
    """
    output = Path(arguments.output)
    kept = checkpoint_for(output) if resumes else nullcontext()
    with output_folder(output.parent), refusing(), kept as checkpoint:
        for name, reason in photographs.failed.items():
            say(f"Passed over: {name}: {reason}")
        say_ignored(photographs)
        with counter(f"nablahog {arguments.command}") as progress:
            found = learn(checkpoint, progress)
        found.save(output)
    return found
