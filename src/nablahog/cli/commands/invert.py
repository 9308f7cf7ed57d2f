"""``nablahog invert``: images of descriptors."""

from __future__ import annotations

import json
import time
from argparse import Namespace
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import torch

from ...invert import AsPublished
from ...io.files import output_folder, write_text
from ...jobs.resume import do_all
from ..errors import Skipping, UserError, as_user_error, forbid_overwrite
from ..inputs.memory import check_glyphs, check_inversion
from ..inputs.prior import PriorOptions
from ..inputs.sources import Source, read_inputs
from ..results import inversion_page
from ..results.inversion import Inversion, InversionOptions, batches, invert_batch, result_names
from ..results.inversion_job import InversionJob
from ..terminal import counter, print_table, progress_bars, say, say_page

NAMED = 5  # inputs of a kind, on the terminal
LINES = 100  # of the table on the terminal
EVERY = 10.0  # seconds after which results.json is written again

Invert = Callable[[Sequence[Source]], Iterator[tuple[int, Inversion]]]  # with the index of its source


def invert(arguments: Namespace) -> int:
    """Finds an image for each descriptor; returns the exit status.

    Raises:
        UserError: no input can be used, or an option is wrong.
        OSError: a folder is missing or cannot be written.
    """
    options = InversionOptions(
        quality=arguments.quality,
        seed=arguments.seed,
        max_evaluations=arguments.max_evaluations,
        published=_published(arguments),
        samples=arguments.samples,
        colour=arguments.colour,
    )
    prior = _prior(arguments)
    if arguments.cluster is not None and arguments.device != "cpu":
        raise UserError(f"a cluster computes on processors: expected --device cpu, got {arguments.device}")

    def check(source: Source) -> None:
        check_inversion(source.path, source.image_size, source.descriptor.numel(), arguments.memory)
        check_glyphs(source.path, tuple(source.descriptor.shape), source.spec, arguments.memory)
        prior.check(source.spec)

    inputs = read_inputs(arguments, keep_photos=True, check=check, datasets=True)
    folder = Path(arguments.output)
    results = [name for source in inputs.sources for name in result_names(source, _more_pictures(arguments))]
    forbid_overwrite(inputs.paths, [folder / name for name in (*results, "results.json", "index.html")])
    with output_folder(folder):
        run = _in_batches(arguments, options, prior, inputs.skipping)
        if arguments.cluster is not None:
            run = _on_cluster(arguments, options, prior, inputs.skipping)
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
        write_text(folder / "index.html", inversion_page.page(done, inputs.skipping.skipped))
    if arguments.json:
        print(written.text())
    else:
        print_table([inversion.terminal_row() for inversion in done[:LINES]])
        if len(done) > LINES:
            say(f"and {len(done) - LINES:,} more in {folder / 'results.json'}")
        _say_unsure(done)
        say_page(folder / "index.html")
    return inputs.skipping.status


def _in_batches(arguments: Namespace, options: InversionOptions, prior: PriorOptions, skipping: Skipping) -> Invert:
    """Inverts sources of one spec and image size together, in this process."""

    def run(batch: Sequence[Source], about: str) -> list[Inversion]:
        with progress_bars() as progress:
            return invert_batch(
                batch,
                device=torch.device(arguments.device),
                prior=prior.for_spec(batch[0].spec),
                options=options,
                progress=progress(about),
            )

    def inverted(sources: Sequence[Source]) -> Iterator[tuple[int, Inversion]]:
        groups = batches(sources)
        for number, indices in enumerate(groups, start=1):
            batch = [sources[index] for index in indices]
            about = f"batch {number} of {len(groups)}, {len(batch)} x {batch[0].spec.name}"
            try:
                yield from zip(indices, run(batch, about), strict=True)
            except ValueError:  # of one of them: which is seen one by one
                for index in indices:
                    with skipping.each(sources[index].path):
                        yield from zip([index], run([sources[index]], about), strict=True)
            skipping.check()

    return inverted


def _on_cluster(arguments: Namespace, options: InversionOptions, prior: PriorOptions, skipping: Skipping) -> Invert:
    """Inverts sources one by one, on a cluster; results that an earlier run stored are read."""
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


@dataclass
class _Results:
    """The results that are written.

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
        if time.monotonic() - self.written > EVERY:  # so that an interrupted run leaves its finished part whole
            self.write()

    def in_order(self) -> list[Inversion]:
        """All of them, in the order of their inputs."""
        return [self.inversions[number] for number in sorted(self.inversions)]

    def text(self) -> str:
        """What ``results.json`` holds."""
        figures = [*(inversion.figures() for inversion in self.in_order()), *self.skipping.figures()]
        return json.dumps(figures, indent=2, allow_nan=False)

    def write(self) -> None:
        """Writes ``results.json``."""
        write_text(self.folder / "results.json", f"{self.text()}\n")
        self.written = time.monotonic()


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
