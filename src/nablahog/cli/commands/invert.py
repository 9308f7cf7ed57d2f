"""``nablahog invert``: images of descriptors."""

from __future__ import annotations

import json
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path

import torch

from ...invert import AsPublished
from ...io.files import output_folder, write_text
from ..errors import UserError, forbid_overwrite
from ..inputs.memory import check_glyphs, check_inversion
from ..inputs.prior import PriorOptions
from ..inputs.sources import Source, read_inputs
from ..results import inversion_page
from ..results.inversion import Inversion, batches, invert_batch, result_names
from ..terminal import print_table, progress_bars, say, say_page

NAMED = 5  # inputs of a kind, on the terminal


def invert(arguments: Namespace) -> int:
    """Finds an image for each descriptor, in batches of one spec and size; returns the exit status.

    Raises:
        UserError: no input can be used, or an option is wrong.
        OSError: a folder is missing or cannot be written.
    """
    published, prior = _published(arguments), _prior(arguments)

    def check(source: Source) -> None:
        check_inversion(source.path, source.image_size, source.descriptor.numel(), arguments.memory)
        check_glyphs(source.path, tuple(source.descriptor.shape), source.spec, arguments.memory)
        prior.check(source.spec)

    inputs = read_inputs(arguments, keep_photos=True, check=check)
    sources, skipping, folder = inputs.sources, inputs.skipping, Path(arguments.output)
    results = [name for source in sources for name in result_names(source, _more_pictures(arguments))]
    forbid_overwrite(inputs.paths, [folder / name for name in (*results, "results.json", "index.html")])
    inversions: dict[int, Inversion] = {}

    def run(batch: Sequence[int], about: str) -> None:
        with progress_bars() as progress:
            inverted = invert_batch(
                [sources[i] for i in batch],
                device=torch.device(arguments.device),
                quality=arguments.quality,
                seed=arguments.seed,
                max_evaluations=arguments.max_evaluations,
                published=published,
                prior=prior.for_spec(sources[batch[0]].spec),
                samples=arguments.samples,
                colour=arguments.colour,
                progress=progress(about),
            )
        inversions.update(zip(batch, inverted, strict=True))

    with output_folder(folder):
        for number, batch in enumerate(groups := batches(sources), start=1):
            about = f"batch {number} of {len(groups)}, {len(batch)} x {sources[batch[0]].spec.name}"
            try:
                run(batch, about)
            except ValueError:  # of one of them: which is seen one by one
                for index in batch:
                    with skipping.each(sources[index].path):
                        run([index], about)
            skipping.check()
            for index in inversions.keys() & {*batch}:
                inversions[index].write(folder)
            # after each batch, so that an interrupted run leaves its finished part whole
            done = [inversions[index] for index in sorted(inversions)]
            figures = json.dumps([*(each.figures() for each in done), *skipping.figures()], indent=2, allow_nan=False)
            write_text(folder / "results.json", f"{figures}\n")
        write_text(folder / "index.html", inversion_page.page(done, skipping.skipped))
    if arguments.json:
        print(figures)
    else:
        print_table([inversion.terminal_row() for inversion in done])
        _say_unsure(done)
        say_page(folder / "index.html")
    return skipping.status


def _more_pictures(arguments: Namespace) -> list[str]:
    """The pictures of an inversion that there are only if they are asked for."""
    return [name for name in ("iterations", "samples") if getattr(arguments, name)]


def _say_unsure(inversions: Sequence[Inversion]) -> None:
    """Of which pre-images the negative may as well be right."""
    unsure = [f"{each.source.name} ({each.polarity:.0%} sure)" for each in inversions if each.unsure]
    if unsure:
        more = ", …" if len(unsure) > NAMED else ""
        say(f"Which side is bright is uncertain: {', '.join(unsure[:NAMED])}{more}")


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


def _prior(arguments: Namespace) -> PriorOptions:
    """Without one for what takes none: the paper's search, and images in colour."""
    if arguments.colour and arguments.prior:
        raise UserError("--colour and --prior exclude each other: the prior was learned from gray images")
    without = [name for name in ("--colour", "--no-prior") if getattr(arguments, name[2:].replace("-", "_"))]
    if arguments.method == "paper":
        without.append("--method paper")
    if arguments.samples and without:
        raise UserError(f"--samples and {without[0]} exclude each other: samples are draws of a prior")
    if arguments.colour or arguments.method == "paper":
        return PriorOptions(None, False)
    return PriorOptions.of(arguments)
