"""``nablahog hog -o NAME.parquet``: the descriptors of any number of photographs as one data set."""

from __future__ import annotations

import glob
from argparse import Namespace
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from ...hog.descriptor import makes_colours_gray
from ...io.files import remove_parts
from ...jobs.runner import run_jobs
from ...jobs.worker import cores
from ...requests.inversion import HogRequest
from ...runtime.extras import extra
from ...runtime.text import counted
from ..arguments.options import build_request
from ..errors import SOME_SKIPPED
from ..input_files import DATASET
from ..inputs import MADE_GRAY
from ..terminal import counter, inform, say

if TYPE_CHECKING:
    from ...io.dataset_manifest import ImageState, Manifest
    from ...jobs.describing import ShardJob

NAMED_FAILURES = 3  # images without a descriptor that are named on stderr; the data set names all


def hog_dataset(arguments: Namespace) -> int:
    """Describes the images that the data set lacks; keeps what an earlier run has done; returns the exit status."""
    with extra("dataset", "a data set of descriptors"):
        from ...io.dataset_manifest import write_manifest
        from ...io.descriptor_dataset import find_shards, shard_name
        from ...jobs.describing import ShardJob
        from ..image_lists import list_images
    request, target = build_request(HogRequest, arguments), arguments.output.rstrip("/")
    images, skipping = list_images(arguments)
    manifest = _plan(target, images, request)
    remove_parts(Path(target))
    shards = find_shards(target, manifest)
    if all(shards):  # nothing is left to do but to look for damage
        shards = find_shards(target, manifest, whole=True)
    jobs = [
        ShardJob(
            tuple(image.path for image in manifest.shards[number]),
            request.spec,
            request.size,
            f"{target}/{shard_name(number)}",
            manifest.key(number),
        )
        for number, shard in enumerate(shards)
        if shard is None
    ]

    if jobs and makes_colours_gray(request.spec):
        inform(MADE_GRAY)

    def begin(index: int) -> None:
        if index == 0:  # a cluster that is not there leaves nothing
            write_manifest(target, manifest)

    if not jobs:
        begin(0)  # perhaps it alone is missing
    before = len(manifest) - sum(len(job.paths) for job in jobs)
    try:
        reasons = _do(jobs, before, len(manifest), arguments, begin)
    except KeyboardInterrupt:
        raise KeyboardInterrupt("the same command, repeated, continues") from None
    if reasons:
        raise ValueError(f"{counted(len(reasons), 'shard')} could not be written; the first: {reasons[0]}")
    return _report(target, before) or skipping.status


def _plan(target: str, images: Sequence[ImageState], request: HogRequest) -> Manifest:
    """The manifest of the data set to be; ValueError if the output is another one."""
    from ...io.dataset_manifest import Manifest, read_manifest
    from ...io.descriptor_dataset import find_shards, find_undescribed, shard_name
    from ..image_lists import open_store

    system, path = open_store(target)
    if system.exists(path) and not system.isdir(path):
        raise ValueError(f"expected a folder for the data set, got the file {target}")
    begun, empty = read_manifest(target), Manifest(request.spec, request.size)
    try:
        if begun is None:
            manifest = empty.add_images(images)
        else:
            begun.check(empty)
            manifest = begun.add_images(images, find_undescribed(target, begun))
    except ValueError as error:
        raise ValueError(f"{target} cannot be continued: {error}; expected another -o") from None
    foreign = {Path(str(file)).name for file in system.glob(f"{glob.escape(path)}/part-*{DATASET}")}
    if foreign:  # without a manifest, only those with the right key are its own
        shards = enumerate(find_shards(target, manifest))
        foreign -= {shard_name(number) for number, shard in shards if begun is not None or shard is not None}
    if foreign:
        raise ValueError(f"{target} holds {counted(len(foreign), 'shard')} of another data set: expected another -o")
    return manifest


def _do(
    jobs: Sequence[ShardJob], done: int, total: int, arguments: Namespace, begin: Callable[[int], None]
) -> list[str]:
    """Writes the shards, after ``begin`` for each; returns why some could not be written."""
    reasons = []
    with counter("nablahog hog", "images") as progress:
        progress(done, total, "")
        workers = arguments.workers or cores()
        with closing(run_jobs(jobs, workers=workers, cluster=arguments.cluster, started=begin)) as outcomes:
            for index, outcome in outcomes:
                done += len(jobs[index].paths)
                progress(done, total, "")
                if isinstance(outcome, str):
                    reasons.append(outcome)
    return reasons


def _report(target: str, before: int) -> int:
    """Prints what was done, and that an earlier run had done some; returns the exit status."""
    from ...io.descriptor_dataset import DescriptorDataset

    data = DescriptorDataset(target)
    errors = list(data.errors())
    if len(errors) == len(data):
        data.remove()
        raise ValueError(f"no image of {len(data):,} has a descriptor; the first: {': '.join(errors[0])}")
    for path, reason in errors[:NAMED_FAILURES]:
        inform(f"nablahog hog: skipped: {path}: {reason}")
    new = f", {len(data) - before:,} of them described now" if before else ""
    say(f"{len(data) - len(errors):,} of {len(data):,} images in {target}{new}")
    return SOME_SKIPPED if errors else 0
