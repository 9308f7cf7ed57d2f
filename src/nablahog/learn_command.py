"""What is learned from photographs, as ``nablahog learn`` does it."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

import torch

from .evaluate.learned import shipped_lessons
from .evaluate.photographs import Photographs
from .invert.baselines.bovw_learning import learn_bovw as learn_words
from .invert.baselines.hoggles import patch_size
from .invert.baselines.hoggles_learning import learn_hoggles as learn_pair
from .invert.crops import least_side
from .invert.network import default_architecture
from .learning import learn_prior as train
from .learning import lessons
from .output import output_folder
from .pose.background import learn_background as learn
from .pose.background import least_size
from .pose.whitening import check_spec
from .refusal import UserError, refusing
from .sources import Wanted
from .table1_command import say_ignored
from .terminal import counter, say


def learn_prior(arguments: Namespace) -> None:
    """Learns what photographs look like; goes on after the last whole epoch of an interrupted run.

    Raises:
        UserError: an input is unusable.
        OSError: a file or folder is missing or cannot be written.
    """
    output = _npz_file(arguments, "a prior")
    if arguments.threads is not None:
        torch.set_num_threads(arguments.threads)
    with refusing():
        spec = Wanted.of(arguments).spec()
        default_architecture(spec)  # raises before the images are read
    photographs = _lessons(arguments, (least_side(spec.cell_size[0]),) * 2)
    with output_folder(output.parent), refusing():
        _say_passed_over(photographs)
        with counter("nablahog learn prior") as progress:
            prior = train(output, photographs, spec, epochs=arguments.epochs, seed=arguments.seed, progress=progress)
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
    with refusing():
        spec = Wanted.of(arguments).spec()
        check_spec(spec)
    photographs = _lessons(arguments, least_size(spec, arguments.order))
    with output_folder(output.parent), refusing():
        _say_passed_over(photographs)
        with counter("nablahog learn background") as progress:
            background = learn(photographs.images, spec, order=arguments.order, progress=progress)
        background.save(output)
    say(
        f"Background in {output}: {len(background.images)} images, {spec.channels} channels, templates of up to "
        f"{background.order + 1}x{background.order + 1} cells"
    )


def learn_hoggles(arguments: Namespace) -> None:
    """Learns the paired dictionaries of HOGgles.

    Raises:
        UserError: an input is unusable.
        OSError: a file or folder is missing or cannot be written.
    """
    output = _npz_file(arguments, "a pair of dictionaries")
    with refusing():
        spec = Wanted.of(arguments).spec()
    photographs = _lessons(arguments, patch_size(spec))
    with output_folder(output.parent), refusing():
        _say_passed_over(photographs)
        with counter("nablahog learn hoggles") as progress:
            pair = learn_pair(photographs.images, spec, fast=arguments.fast, seed=arguments.seed, progress=progress)
        pair.save(output)
    say(f"Dictionaries in {output}: {len(pair.gray)} pairs of atoms, {len(pair.learning.images)} images")


def learn_bovw(arguments: Namespace) -> None:
    """Learns visual words, from tiles of the photographs that come with scikit-image if there is no folder.

    Raises:
        UserError: an input is unusable.
        OSError: a file or folder is missing or cannot be written.
    """
    output = _npz_file(arguments, "a vocabulary")
    photographs = Photographs(shipped_lessons("bovw")) if arguments.images is None else _lessons(arguments, (1, 1))
    with output_folder(output.parent), refusing():
        _say_passed_over(photographs)
        with counter("nablahog learn bovw") as progress:
            words = learn_words(photographs.images, seed=arguments.seed, progress=progress)
        words.save(output)
    say(f"Vocabulary in {output}: {len(words.vocabulary)} words, {len(words.learning.images)} images")


def _npz_file(arguments: Namespace, what: str) -> Path:
    output = Path(arguments.output)
    if output.suffix.lower() != ".npz" or output.is_dir():
        raise UserError(f"{what} is one file: expected -o FILE.npz, got {output}")
    return output


def _lessons(arguments: Namespace, least: tuple[int, int]) -> Photographs:
    with refusing():
        return lessons(None if arguments.images is None else Path(arguments.images), least, arguments.size)


def _say_passed_over(photographs: Photographs) -> None:
    for name, reason in photographs.failed.items():
        say(f"Passed over: {name}: {reason}")
    say_ignored(photographs)
