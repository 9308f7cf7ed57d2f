"""``nablahog invert``: images of descriptors."""

from __future__ import annotations

import json
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path

import torch

from ...evaluate.learned import load
from ...invert import AsPublished, LearnedPrior
from ...io.files import output_folder, write_text
from ..errors import UserError, as_user_error, forbid_overwrite
from ..inputs.memory import check_glyphs, check_inversion
from ..inputs.sources import Source, read_sources
from ..results.inversion import Inversion, batches, invert_batch, print_figures, result_names
from ..terminal import progress_bars, say


def invert(arguments: Namespace) -> None:
    """Finds an image for each descriptor, in batches of one spec and size.

    Raises:
        UserError: an input is unusable.
        OSError: a file or folder is missing or cannot be written.
    """
    sources = read_sources(arguments, keep_photos=True)
    with as_user_error():
        for source in sources:
            check_inversion(source.path, source.image_size, source.descriptor.numel(), arguments.memory)
            check_glyphs(source.path, tuple(source.descriptor.shape), source.spec, arguments.memory)
    published = _published(arguments)
    prior = _prior(arguments, sources)
    folder = Path(arguments.output)
    results = [name for source in sources for name in result_names(source, arguments.iterations)]
    forbid_overwrite(arguments.inputs, [folder / name for name in results])
    inversions: dict[int, Inversion] = {}
    with output_folder(folder):
        for number, batch in enumerate(groups := batches(sources), start=1):
            about = f"batch {number} of {len(groups)}, {len(batch)} x {sources[batch[0]].spec.name}"
            with progress_bars() as progress, as_user_error(f"{', '.join(sources[i].path for i in batch)}: "):
                inverted = invert_batch(
                    [sources[i] for i in batch],
                    device=torch.device(arguments.device),
                    quality=arguments.quality,
                    seed=arguments.seed,
                    max_evaluations=arguments.max_evaluations,
                    published=published,
                    prior=prior,
                    colour=arguments.colour,
                    progress=progress(about),
                )
            for index, inversion in zip(batch, inverted, strict=True):
                inversion.write(folder)
                inversions[index] = inversion
            # after each batch, so that an interrupted run leaves its finished part whole
            figures = [inversions[index].figures() for index in sorted(inversions)]
            write_text(folder / "results.json", json.dumps(figures, indent=2, allow_nan=False) + "\n")
    if arguments.json:
        print(json.dumps(figures, indent=2, allow_nan=False))
    else:
        print_figures([inversions[index] for index in sorted(inversions)])
        say(f"Results in {folder}")


def _published(arguments: Namespace) -> AsPublished | None:
    """The paper's search, if it is asked for, without what it does not take."""
    if arguments.method != "paper":
        if arguments.iterations:
            raise UserError("--iterations needs --method paper")
        return None
    unfit = {"--quality fast": arguments.quality != "best", "--prior": arguments.prior, "--colour": arguments.colour}
    for option, given in unfit.items():
        if given:
            raise UserError(f"--method paper and {option} exclude each other")
    return AsPublished(max_evaluations=arguments.max_evaluations, keep_iterates=arguments.iterations)


def _prior(arguments: Namespace, sources: Sequence[Source]) -> LearnedPrior | None:
    """The prior of the option ``--prior``, which must have been learned for the specs of all sources."""
    if arguments.prior is None:
        return None
    if arguments.colour:
        raise UserError("--colour and --prior exclude each other: the prior was learned from gray images")
    with as_user_error():
        prior: LearnedPrior = load("prior", Path(arguments.prior))
    for source in sources:
        with as_user_error(f"{source.path}: "):
            prior.check(source.spec)
    return prior
