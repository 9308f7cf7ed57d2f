"""Images that have given descriptors, as ``nablahog invert`` finds them; and one example, ``nablahog demo``."""

from __future__ import annotations

import json
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path

import torch

from ...io.files import output_folder, replacing
from ...metrics import DEFINITIONS
from ..errors import UserError, as_user_error, forbid_overwrite
from ..inputs.prior import prior_for
from ..inputs.sources import sources_of
from ..results.inversion import Inversion, batches, invert_batch, result_names
from ..terminal import print_definitions, print_table, progress_bars, say
from .demo import DESCRIPTORS, run_demo


def invert(arguments: Namespace) -> None:
    """Finds an image for each descriptor, in batches of one spec and size.

    Raises:
        UserError: an input is unusable.
        OSError: a file or folder is missing or cannot be written.
    """
    sources = sources_of(arguments)
    if arguments.colour and arguments.prior:
        raise UserError("--colour and --prior exclude each other: what is learned are gray images")
    prior = prior_for(arguments, [(source.path, source.spec) for source in sources])
    folder = Path(arguments.output)
    forbid_overwrite(arguments.inputs, [folder / name for source in sources for name in result_names(source)])
    done: dict[int, Inversion] = {}
    with output_folder(folder):
        for number, batch in enumerate(groups := batches(sources), start=1):
            about = f"batch {number} of {len(groups)}, {len(batch)} x {sources[batch[0]].spec.name}"
            with progress_bars() as progress, as_user_error(f"{', '.join(sources[i].path for i in batch)}: "):
                found = invert_batch(
                    [sources[i] for i in batch],
                    device=torch.device(arguments.device),
                    quality=arguments.quality,
                    seed=arguments.seed,
                    max_evaluations=arguments.max_evaluations,
                    prior=prior,
                    colour=arguments.colour,
                    progress=progress(about),
                )
            done.update(zip(batch, found, strict=True))
            for index in batch:
                done[index].write(folder)
            # after each batch, so that an interrupted run leaves its finished part whole
            figures = [done[index].figures() for index in sorted(done)]
            with replacing(folder / "results.json") as file:
                file.write((json.dumps(figures, indent=2, allow_nan=False) + "\n").encode())
    if arguments.json:
        print(json.dumps(figures, indent=2, allow_nan=False))
    else:
        _print_figures([done[index] for index in sorted(done)])
        say(f"Results in {folder}")


def demo(arguments: Namespace) -> None:
    """Inverts both descriptors of the paper of one photograph.

    Raises:
        OSError: the folder or a file cannot be written.
    """
    with output_folder(arguments.output) as folder, progress_bars() as progress:
        tasks = {name: progress(name) for name in DESCRIPTORS}
        inversions = run_demo(
            folder,
            device=torch.device(arguments.device),
            seed=arguments.seed,
            progress=lambda name, done, total: tasks[name](done, total),
            max_evaluations=arguments.max_evaluations,
        )
    _print_figures(inversions)
    say(f"Look at {folder / 'index.html'}")


def _print_figures(inversions: Sequence[Inversion]) -> None:
    print_table([inversion.row() for inversion in inversions])
    print_definitions(DEFINITIONS)
