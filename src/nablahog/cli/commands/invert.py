"""``nablahog invert``: images of descriptors."""

from __future__ import annotations

import json
import time
from argparse import Namespace
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import torch

from ...io.files import output_folder, write_text
from ...jobs.resume import do_all
from ..errors import Skipping, UserError, as_user_error, forbid_overwrite
from ..inputs.prior import NO_PRIOR, PriorOptions
from ..inputs.sources import Source, read_inputs
from ..inputs.templates import read_template_inputs
from ..results import inversion_page
from ..results.inversion import Inversion, InversionOptions, batches, invert_batch, invert_template, result_names
from ..results.inversion_job import InversionJob
from ..terminal import counter, print_table, say, say_page

NAMED = 5  # pre-images of uncertain polarity that are named on the terminal
LINES = 100  # of the table on the terminal
EVERY = 10.0  # seconds after which results.json is written again

_EXCLUDED = {
    "--template": ("--quality fast", "--method paper", "--prior", "--samples", "--colour", "--cluster"),
    "--method paper": ("--quality fast", "--prior", "--samples", "--colour"),
    "--colour": ("--prior", "--samples"),
    "--samples": ("--prior none",),
    "--cluster": ("--device",),
}
"""Options that exclude each other."""

Invert = Callable[[Sequence[Source]], Iterator[tuple[int, Inversion]]]  # yields the index of the source, too


def invert(arguments: Namespace) -> int:
    """Finds an image for each descriptor, or what each detector looks for; returns the exit status.

    Raises:
        UserError: no input can be used, or an option is wrong.
        OSError: a folder is missing or cannot be written.
    """
    _check_options(arguments)
    options = InversionOptions(
        quality=arguments.quality,
        seed=arguments.seed,
        method=arguments.method,
        samples=arguments.samples,
        colour=arguments.colour,
    )
    without = arguments.colour or arguments.method == "paper"
    prior = PriorOptions(None, default=False) if without else PriorOptions.of(arguments)

    def check(source: Source) -> None:
        prior.check(source.spec)

    if arguments.template:
        inputs = read_template_inputs(arguments)
    else:
        inputs = read_inputs(arguments, keep_photos=True, check=check, datasets=True)
    folder = Path(arguments.output)
    names = [name for source in inputs.sources for name in result_names(source, options.more_pictures)]
    forbid_overwrite(inputs.paths, [folder / name for name in (*names, "results.json", "index.html")])
    with output_folder(folder):
        if arguments.template:
            run = _templates(arguments)
        else:
            search = _in_batches if arguments.cluster is None else _on_cluster
            run = search(arguments, options, prior, inputs.skipping)
        written = _Results(folder, inputs.skipping)
        try:
            before = 0
            for sources in inputs.parts(check):
                for index, inversion in run(sources):
                    written.add(before + index, inversion)
                inputs.skipping.check()
                before += len(sources)
        finally:
            if written.inversions:
                written.write()
        done = written.in_order()
        lead = inversion_page.TEMPLATES if arguments.template else inversion_page.LEAD
        write_text(folder / "index.html", inversion_page.page(done, inputs.skipping.skipped, lead=lead))
    print_table([inversion.terminal_row() for inversion in done[:LINES]])
    if len(done) > LINES:
        say(f"and {len(done) - LINES:,} more in {folder / 'results.json'}")
    _say_unsure(done)
    say_page(folder / "index.html")
    return inputs.skipping.status


def _check_options(arguments: Namespace) -> None:
    """Raises UserError if two options exclude each other."""
    chosen = {
        "--template": arguments.template,
        "--quality fast": arguments.quality == "fast",
        "--method paper": arguments.method == "paper",
        "--prior": arguments.prior not in (None, NO_PRIOR),
        "--prior none": arguments.prior == NO_PRIOR,
        "--samples": arguments.samples,
        "--colour": arguments.colour,
        "--cluster": arguments.cluster,
        "--device": arguments.device != "cpu",
    }
    for one, others in _EXCLUDED.items():
        for other in others:
            if chosen[one] and chosen[other]:
                raise UserError(f"{one} and {other} exclude each other")


def _in_batches(arguments: Namespace, options: InversionOptions, prior: PriorOptions, skipping: Skipping) -> Invert:
    """Inverts sources of one spec and image size together, in this process."""

    def run(batch: Sequence[Source], about: str) -> list[Inversion]:
        with counter("nablahog invert") as progress:
            return invert_batch(
                batch,
                device=torch.device(arguments.device),
                prior=prior.for_spec(batch[0].spec),
                options=options,
                progress=partial(progress, what=about),
            )

    def inverted(sources: Sequence[Source]) -> Iterator[tuple[int, Inversion]]:
        groups = batches(sources)
        for number, indices in enumerate(groups, start=1):
            batch = [sources[index] for index in indices]
            about = f"batch {number} of {len(groups)}, {len(batch)} x {batch[0].spec.name}"
            try:
                yield from zip(indices, run(batch, about), strict=True)
            except ValueError:  # one of them cannot be inverted: find out which
                for index in indices:
                    with skipping.each(sources[index].path):
                        yield from zip([index], run([sources[index]], about), strict=True)
            skipping.check()

    return inverted


def _on_cluster(arguments: Namespace, options: InversionOptions, prior: PriorOptions, skipping: Skipping) -> Invert:
    """Inverts sources one by one, on a cluster; reads the results that an earlier run stored."""
    file = None if prior.given is None else Path(arguments.prior)

    def inverted(sources: Sequence[Source]) -> Iterator[tuple[int, Inversion]]:
        jobs = {index: InversionJob(source, options, file, prior.default) for index, source in enumerate(sources)}
        with counter("nablahog invert") as progress, as_user_error():
            outcomes = do_all(Path(arguments.output), jobs, workers=1, cluster=arguments.cluster, progress=progress)
            for index, outcome in outcomes:
                with skipping.each(sources[index].path):
                    if isinstance(outcome, str):
                        raise ValueError(outcome)
                    yield index, jobs[index].inversion(outcome)

    return inverted


def _templates(arguments: Namespace) -> Invert:
    """Finds what templates look for, one by one, in this process."""

    def inverted(sources: Sequence[Source]) -> Iterator[tuple[int, Inversion]]:
        device = torch.device(arguments.device)
        for index, source in enumerate(sources):
            with counter("nablahog invert") as progress, as_user_error(f"{source.path}: "):
                shown = partial(progress, what=source.name)
                yield index, invert_template(source, device=device, seed=arguments.seed, progress=shown)

    return inverted


@dataclass
class _Results:
    """Writes results while they are computed.

    Attributes:
        inversions: by the number of their input, with pictures as far as the page may show them.
    """

    folder: Path
    skipping: Skipping
    inversions: dict[int, Inversion] = field(default_factory=dict)
    written: float = 0.0

    def add(self, number: int, inversion: Inversion) -> None:
        """Writes the pictures of an inversion."""
        inversion.write(self.folder)
        self.inversions[number] = inversion if number < inversion_page.SHOWN else inversion.without_pictures()
        if time.monotonic() - self.written > EVERY:  # so that an interrupted run leaves a valid results.json
            self.write()

    def in_order(self) -> list[Inversion]:
        """All of them, in the order of their inputs."""
        return [self.inversions[number] for number in sorted(self.inversions)]

    def write(self) -> None:
        """Writes ``results.json``."""
        figures = [*(inversion.figures() for inversion in self.in_order()), *self.skipping.figures()]
        write_text(self.folder / "results.json", f"{json.dumps(figures, indent=2, allow_nan=False)}\n")
        self.written = time.monotonic()


def _say_unsure(inversions: Sequence[Inversion]) -> None:
    """Names the pre-images whose negatives may as well be right."""
    unsure = [f"{each.source.name} ({each.polarity:.0%} sure)" for each in inversions if each.unsure]
    if unsure:
        more = ", …" if len(unsure) > NAMED else ""
        say(f"Which side is bright is uncertain: {', '.join(unsure[:NAMED])}{more}")
