"""``nablahog hog`` saves descriptors, ``nablahog glyph`` draws them."""

from __future__ import annotations

import glob
import os
import sys
from argparse import Namespace
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.request import url2pathname

from PIL import Image

from ...io.arrays import naming
from ...io.descriptor_file import save_descriptor
from ...io.files import Writable, forbid_overwrite, local_name, natural_order, output_folder
from ...io.images import image_endings, write_image
from ...jobs.runner import run_jobs
from ...jobs.store import JobResult
from ...jobs.worker import cores
from ...requests.inversion import GlyphRequest, HogRequest
from ...requests.sources import Source
from ...runtime.extras import extra
from ...runtime.text import counted, decode_text
from ...viz.pictures import glyph_image
from ..arguments.options import build_request
from ..errors import SOME_SKIPPED
from ..inputs import DATASET, Inputs, expand, read_inputs
from ..terminal import counter, inform, print_table, say

if TYPE_CHECKING:
    from ...jobs.describing import ShardJob

STDOUT = "-"
LIST = "@"
SHARD = 1000  # images of a file
OTHER_FORMATS = (".npy", ".mat", ".csv", ".txt", ".json")  # in which programs would expect what their names say
NAMED_FAILURES = 3  # images without a descriptor that are named on stderr; the data set names all


def hog(arguments: Namespace) -> int:
    """Saves the descriptor of each photograph with its spec, or all as one data set; returns the exit status."""

    if arguments.output.rstrip("/").lower().endswith(DATASET):
        return hog_dataset(arguments)
    for option in ("workers", "cluster"):
        if getattr(arguments, option) is not None:
            raise ValueError(f"--{option} goes with a data set: expected -o NAME{DATASET}, got {arguments.output}")

    def write(target: Writable, source: Source) -> None:
        save_descriptor(target, source.descriptor, source.spec, source.image_size)

    is_file = not arguments.output.endswith(os.sep)  # a file of nearly any name, since np.load does not mind
    suffix = Path(arguments.output).suffix.lower()
    if suffix in {*image_endings(), *OTHER_FORMATS} and arguments.output not in arguments.inputs:
        raise ValueError(
            f"descriptors are written as .npz, which numpy.load reads: expected -o FILE.npz, a folder or "
            f"NAME{DATASET}, got {arguments.output}"
        )
    _check_stdout(arguments.output)
    inputs = read_inputs(arguments, build_request(HogRequest, arguments))
    _write_files(arguments.output, inputs, ".npz", write, is_file=is_file)
    return inputs.skipping.status


def glyph(arguments: Namespace) -> int:
    """Draws each descriptor; returns the exit status."""

    def write(target: Writable, source: Source) -> None:
        write_image(target, glyph_image(source.descriptor, source.spec))

    suffix = Path(arguments.output).suffix.lower()
    if suffix != ".png" and suffix in Image.registered_extensions():
        raise ValueError(f"glyphs are written as PNG: expected -o FILE.png or a folder, got {arguments.output}")
    _check_stdout(arguments.output)
    inputs = read_inputs(arguments, build_request(GlyphRequest, arguments))
    _write_files(arguments.output, inputs, "_glyphs.png", write, is_file=suffix == ".png")
    return inputs.skipping.status


def _check_stdout(output: str) -> None:
    if output == STDOUT and getattr(sys.stdout, "name", "") == os.devnull:
        raise ValueError("-o - writes to stdout, which is closed: expected a pipe or a file")
    if output == STDOUT and sys.stdout.isatty():
        raise ValueError("-o - writes bytes, and stdout is a terminal: expected a pipe or a file")


def _write_files(
    name: str, inputs: Inputs, ending: str, write: Callable[[Writable, Source], None], *, is_file: bool
) -> None:
    """Writes one result for each input: to stdout; to the file ``name``, for one input and ``is_file``; or to a folder.

    Prints a table of what was written, except after writing to stdout.
    """
    output = Path(name)
    to_stdout = name == STDOUT
    if inputs.many and (to_stdout or (output.suffix and ending.endswith(output.suffix.lower()))):
        got = "stdout" if to_stdout else f"the file name {output}"
        raise ValueError(f"several inputs need a folder: expected -o DIR, got {got}")
    if to_stdout:
        (source,) = inputs.sources
        write(sys.stdout.buffer, source)
        return
    if not inputs.many and is_file and not output.is_dir():
        folder, targets = output.parent, dict.fromkeys(inputs.stems, output)
    else:
        folder, targets = output, {stem: output / f"{stem}{ending}" for stem in inputs.stems}
    forbid_overwrite(inputs.paths, targets.values())
    rows = []
    with output_folder(folder):
        for source in inputs.sources:
            target = targets[source.stem]
            write(target, source)
            rows.append(
                {
                    "input": source.path,
                    "descriptor": source.spec.name,
                    "image_size": list(source.image_size),
                    "shape": list(source.descriptor.shape),
                    "output": str(target),
                }
            )
    print_table(rows)


def hog_dataset(arguments: Namespace) -> int:
    """Describes all images, :data:`SHARD` to a file; keeps what an earlier run has done; returns the exit status."""
    with extra("dataset", "a data set of descriptors"):
        from ...io.descriptor_dataset import read_shard_key, shard_key, shard_name
        from ...jobs.describing import ShardJob
    request = build_request(HogRequest, arguments)
    spec, size = request.spec, request.size
    paths, target = _paths(arguments), arguments.output.rstrip("/")
    parts = [tuple(paths[start : start + SHARD]) for start in range(0, len(paths), SHARD)]
    jobs = [
        ShardJob(part, spec, size, f"{target}/{shard_name(number)}", shard_key(part, spec, size))
        for number, part in enumerate(parts)
    ]
    _check_empty(target, [job.target for job in jobs])
    keys = [read_shard_key(job.target) for job in jobs]
    for job, key in zip(jobs, keys, strict=True):
        if key not in (None, job.key):
            raise ValueError(
                f"{job.target} has other images, or another kind of descriptor, or another version of nablahog or "
                "PyTorch wrote it: expected another -o"
            )
    missing = [job for job, key in zip(jobs, keys, strict=True) if key is None]
    failed = _do(missing, len(paths) - sum(len(job.paths) for job in missing), len(paths), arguments)
    return _report(target, failed)


def _do(jobs: Sequence[ShardJob], done: int, total: int, arguments: Namespace) -> list[str]:
    """Writes the shards; returns why some could not be written."""
    reasons = []
    with counter("nablahog hog") as progress:
        progress(done, total, "")
        workers = arguments.workers or cores()
        with closing(run_jobs(jobs, workers=workers, cluster=arguments.cluster)) as outcomes:
            for index, outcome in outcomes:
                done += len(jobs[index].paths)
                progress(done, total, "")
                if not isinstance(outcome, JobResult):
                    reasons.append(outcome)
    return reasons


def _paths(arguments: Namespace) -> list[str]:
    """All images, in order: files, folders, patterns, URLs, and lists of these."""
    named = [_decode_file_url(name) for name in arguments.inputs if not name.startswith(LIST)]
    plain = [name for name in named if "://" not in name]
    paths = _expanded(arguments, plain) if plain else []
    for name in named:
        if "://" in name:
            paths += _urls(name)
    for name in arguments.inputs:
        for line in map(_decode_file_url, map(local_name, _lines(name[1:]) if name.startswith(LIST) else ())):
            if "://" in line:  # signed URLs have question marks, which are no patterns
                paths += _urls(line) if "*" in line else [line]
            else:
                paths += _expanded(arguments, [line]) if os.path.isdir(line) or glob.has_magic(line) else [line]
    if not paths:
        raise ValueError("there are no images among the inputs")
    return paths


def _decode_file_url(name: str) -> str:
    """The path of a URL as ``Path.as_uri()`` writes it, if fsspec, which decodes none, finds no file; else itself."""
    path = name.removeprefix("file://").removeprefix("localhost")
    if "%" not in path or not name.startswith("file://") or "::" in name:
        return name

    def exists(pattern: str) -> bool:
        return os.path.lexists(pattern) or any(glob.iglob(pattern, recursive=True))

    decoded = url2pathname(path)
    return decoded if exists(decoded) and not exists(path) else name


def _expanded(arguments: Namespace, names: list[str]) -> list[str]:
    return expand(names, arguments, image_endings()).paths


def _lines(name: str) -> list[str]:
    """The entries of a list: lines without blanks and quotes around them; comments (#) and empty ones are left out."""
    try:
        lines = [line.strip() for line in decode_text(Path(name).read_bytes()).splitlines()]
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"{name}: expected a list of images, one per line: {error}") from None
    lines = [line[1:-1] if len(line) > 1 and line[0] == line[-1] == '"' else line for line in lines]
    return [line for line in lines if line and not (line.startswith("#") and not os.path.exists(line))]


def _urls(name: str) -> list[str]:
    """The images of a URL: of a file, pattern or folder; each with the chain, as in ``zip://*.jpg::photos.zip``."""
    system, path = _storage(name)
    with naming(name):
        if glob.has_magic(path) and not system.exists(path):
            found = list(map(str, system.glob(path)))
        elif system.isdir(path):
            found = list(map(str, system.ls(path, detail=False)))
        else:
            found = [path]
        endings = image_endings()
        visible = (each for each in found if each == path or not Path(each).name.startswith("."))
        images = sorted((each for each in visible if Path(each).suffix.lower() in endings), key=natural_order)
    links = name.split("::")
    if len(links) == 1:
        return [system.unstrip_protocol(each) for each in images]
    # in a chained URL, the part with the path: a cache uses the path of the store behind it
    at = next((k for k, link in enumerate(links) if link.partition("://")[2].strip("/") == path.strip("/")), 0)
    protocol = links[at].partition("://")[0]
    return ["::".join([*links[:at], f"{protocol}://{each}", *links[at + 1 :]]) for each in images]


def _storage(name: str) -> tuple[Any, str]:
    """The file system of fsspec that a URL or path is on, and its path there."""
    import fsspec

    try:
        system, path = fsspec.core.url_to_fs(name)
    except Exception as error:  # archives and stores that cannot be opened raise nearly anything
        raise ValueError(f"{name}: {error}") from None
    return system, str(path)


def _check_empty(target: str, own: Sequence[str]) -> None:
    """Raises ValueError if the output holds other shards, which would become a part of the data set."""
    system, path = _storage(target)
    if system.exists(path) and not system.isdir(path):
        raise ValueError(f"expected a folder for the data set, got the file {target}")
    there = {Path(str(each)).name for each in system.glob(f"{glob.escape(path)}/part-*{DATASET}")}
    others = there - {Path(each).name for each in own}
    if others:
        raise ValueError(f"{target} holds {counted(len(others), 'shard')} of other images: expected another -o")


def _report(target: str, reasons: Sequence[str]) -> int:
    """Prints what was done; returns the exit status."""
    from ...io.descriptor_dataset import DescriptorDataset

    if reasons:
        raise ValueError(f"{counted(len(reasons), 'shard')} could not be written; the first: {reasons[0]}")
    data = DescriptorDataset(target)
    errors = list(data.errors())
    if len(errors) == len(data):
        data.remove()
        raise ValueError(f"no image of {len(data):,} has a descriptor; the first: {': '.join(errors[0])}")
    for path, reason in errors[:NAMED_FAILURES]:
        inform(f"nablahog hog: skipped: {path}: {reason}")
    say(f"{len(data) - len(errors):,} of {len(data):,} images in {target}")
    return SOME_SKIPPED if errors else 0
