"""``nablahog invert``: images of descriptors."""

from __future__ import annotations

import hashlib
import itertools
import json
import time
from argparse import Namespace
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
import torch

from ...hog import HOGSpec
from ...io.files import forbid_overwrite, output_folder, write_text
from ...jobs.store import JobResult, digest, do_all, make_key
from ...jobs.worker import local_path
from ...requests.arrays import NEGATIVE
from ...requests.inversion import GlyphRequest, InvertRequest
from ...requests.options import changed
from ...requests.sources import Source
from ...runtime.cache import code_key
from ..arguments.options import build_request
from ..errors import Skipping, WrongArguments
from ..inputs import read_inputs, read_template_inputs
from ..results import inversion_page
from ..results.inversion import (
    PICTURES,
    Inversion,
    batches,
    invert_batch,
    picture_name,
    say_unsure,
)
from ..terminal import counter, inform, print_table, say, say_page

LINES = 100  # of the table on the terminal
WRITE_INTERVAL = 10.0  # seconds after which results.json is written again

_STORED = (
    "measures",
    "stop_reason",
    "polarity",
    "sure_regions",
    "agreement",
)  # fields of an inversion that are not pictures


def invert(arguments: Namespace) -> int:
    """Finds an image for each descriptor, or what each detector looks for; returns the exit status."""
    request = build_request(InvertRequest, arguments)
    _check_cluster(arguments)
    learned = request.learned_prior()

    def check(source: Source) -> None:
        if learned is not None:
            learned.check(source.spec)
        if float((source.descriptor < 0).float().mean()) > NEGATIVE:
            inform(f"{source.path}: many entries are negative, as in the weights of a detector: try --template")

    if request.template:
        inputs = read_template_inputs(arguments, request)
    else:
        inputs = read_inputs(arguments, request, keep_photos=True, check=check, datasets=True)
    folder, sources_of_files = Path(arguments.output), list(inputs.sources)
    names = [picture_name(source, what) for source in sources_of_files for what in PICTURES]
    forbid_overwrite(inputs.paths, [folder / name for name in (*names, "results.json", "index.html")])
    search = _in_batches if arguments.cluster is None else _on_cluster
    with output_folder(folder):
        written = _Results(folder, inputs.skipping)
        try:
            before = 0
            for sources in filter(None, itertools.chain([sources_of_files], inputs.rows(check))):
                for index, inversion in search(sources, arguments, request, inputs.skipping):
                    written.add(before + index, inversion)
                inputs.skipping.check()
                before += len(sources)
        finally:
            if written.inversions:
                written.write()
        done = written.in_order()
        lead = inversion_page.TEMPLATES if request.template else inversion_page.LEAD
        write_text(folder / "index.html", inversion_page.page(done, inputs.skipping.skipped, lead=lead))
    print_table([inversion.terminal_row() for inversion in done[:LINES]])
    if len(done) > LINES:
        say(f"and {len(done) - LINES:,} more in {folder / 'results.json'}")
    say_unsure(done)
    if request.samples and all(each.agreement is None for each in done):
        say("No samples: these descriptors have signed gradients, which leave little open")
    _say_seed(request, {inversion.source.spec for inversion in done})
    say_page(folder / "index.html")
    return inputs.skipping.status


def _check_cluster(arguments: Namespace) -> None:
    """Raises ValueError if another option excludes ``--cluster``."""
    options = {"--template": arguments.template, "--device": arguments.device != "cpu"}
    for option, chosen in options.items():
        if chosen and arguments.cluster:
            raise WrongArguments(f"--cluster and {option} exclude each other")


def _in_batches(
    sources: Sequence[Source], arguments: Namespace, request: InvertRequest, skipping: Skipping
) -> Iterator[tuple[int, Inversion]]:
    """Inverts sources of one spec and image size together, in this process; templates one by one."""

    def run(indices: Sequence[int], about: str) -> Iterator[tuple[int, Inversion]]:
        batch = [sources[index] for index in indices]
        with counter("nablahog invert", "evaluations") as progress:
            device, progress_of = torch.device(arguments.device), partial(progress, what=about)
            inversions = invert_batch(batch, request, device=device, progress=progress_of)
        yield from zip(indices, inversions, strict=True)

    groups = [[index] for index in range(len(sources))] if request.template else batches(sources)
    for number, indices in enumerate(groups, start=1):
        about = f"batch {number} of {len(groups)}, {len(indices)} x {sources[indices[0]].spec.name}"
        try:
            yield from run(indices, about)
        except ValueError:  # one of them cannot be inverted: find out which
            for index in indices:
                with skipping.guard(sources[index].path):
                    yield from run([index], about)
        skipping.check()


def _on_cluster(
    sources: Sequence[Source], arguments: Namespace, request: InvertRequest, skipping: Skipping
) -> Iterator[tuple[int, Inversion]]:
    """Inverts sources one by one, on a cluster; reads the results that an earlier run stored."""
    jobs = {index: InversionJob(source, request) for index, source in enumerate(sources)}
    with counter("nablahog invert", "images") as progress:
        outcomes = do_all(
            Path(arguments.output),
            jobs,
            workers=1,
            label=lambda index: sources[index].name,
            cluster=arguments.cluster,
            progress=progress,
        )
        for index, outcome in outcomes:
            with skipping.guard(sources[index].path):
                if isinstance(outcome, str):
                    raise ValueError(outcome)
                yield index, jobs[index].inversion(outcome)


@dataclass
class _Results:
    """Writes results while they are computed; keeps their pictures as far as the page may show them."""

    folder: Path
    skipping: Skipping
    inversions: dict[int, Inversion] = field(default_factory=dict)
    written: float = 0.0

    def add(self, number: int, inversion: Inversion) -> None:
        """Writes the pictures of an inversion."""
        inversion.write(self.folder)
        self.inversions[number] = inversion if number < inversion_page.SHOWN_INPUTS else inversion.without_pictures()
        if time.monotonic() - self.written > WRITE_INTERVAL:  # so that an interrupted run leaves a valid results.json
            self.write()

    def in_order(self) -> list[Inversion]:
        """All of them, in the order of their inputs."""
        return [self.inversions[number] for number in sorted(self.inversions)]

    def write(self) -> None:
        figures = [*(inversion.figures() for inversion in self.in_order()), *self.skipping.skipped]
        write_text(self.folder / "results.json", f"{json.dumps(figures, indent=2, allow_nan=False)}\n")
        self.written = time.monotonic()


def _say_seed(request: InvertRequest, specs: set[HOGSpec]) -> None:
    """Says so if a seed that was asked for has changed nothing."""
    with suppress(FileNotFoundError):  # installed without priors
        if request.seed and not any(map(request.draws_random_numbers, specs)):
            inform("--seed changes nothing: a search from a learned prior draws no random numbers, see --prior none")


@dataclass(frozen=True, eq=False)
class InversionJob:
    """The inversion of a descriptor."""

    source: Source
    request: InvertRequest

    @property
    def folder(self) -> str:
        """The name of its folder of stored results."""
        return "inversions"

    def key(self) -> str:
        """A hash of the descriptor, the photograph, the request, the prior, and the code that makes the result."""
        source = self.source
        photo = b"" if source.photo is None else source.photo.numpy().tobytes()
        facts = {
            "spec": source.spec.to_json(),
            "image_size": source.image_size,
            "photo": hashlib.sha256(photo).hexdigest(),
            "request": {
                each.name: value
                for each, value in changed(self.request, InvertRequest, beyond=GlyphRequest)
                if each.name != "prior"
            },
            "prior": [digest(file) for file in self.files()] or self.request.prior,
            "code": code_key(),
        }
        return make_key(facts, source.descriptor.numpy())

    def files(self) -> list[Path]:
        """The file of the prior, if there is one."""
        return [] if self.request.prior_file is None else [self.request.prior_file]

    def run(self) -> JobResult:
        """Inverts the descriptor: the pictures are pre-image, iterates, samples and region confidence, float32."""
        request, file = self.request, self.request.prior_file
        if file is not None:
            request = replace(request, prior=str(local_path(file)))
        [result] = invert_batch([self.source], request, device=torch.device("cpu"))
        samples = [] if result.samples is None else list(result.samples)
        regions = [] if result.regions is None else [result.regions]
        pictures = np.stack([each.numpy() for each in (result.preimage, *result.iterates.values(), *samples, *regions)])
        figures = {name: getattr(result, name) for name in _STORED}
        figures |= {"iterates": list(result.iterates), "samples": len(samples)}
        return JobResult([figures], pictures, result.seconds)

    def fits(self, result: JobResult) -> bool:
        """Whether there are as many pictures as the figures say, of the image's size."""
        figures, pictures = result.figures[0], result.pictures
        count = 1 + len(figures["iterates"]) + figures["samples"] + (figures["sure_regions"] is not None)
        whole = len(pictures) == count and pictures.shape[-2:] == self.source.image_size
        return bool(whole and pictures.dtype == np.float32)

    def inversion(self, result: JobResult) -> Inversion:
        """The inversion that :meth:`run` has computed."""
        figures, pictures = result.figures[0], torch.from_numpy(result.pictures)
        samples_from = 1 + len(figures["iterates"])
        samples = pictures[samples_from : samples_from + figures["samples"]]
        return Inversion(
            self.source,
            pictures[0],
            seconds=result.seconds,
            iterates=dict(zip(figures["iterates"], pictures[1:samples_from], strict=True)),
            regions=None if figures["sure_regions"] is None else pictures[-1],
            samples=samples if len(samples) else None,
            **{name: figures[name] for name in _STORED},
        )
