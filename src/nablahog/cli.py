"""The command ``nablahog``: reads and checks all inputs, does the work, writes the results."""

from __future__ import annotations

import io
import json
import os
import sys
from argparse import Namespace
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import torch
from PIL import Image

from .arguments import parser
from .demo import DESCRIPTORS, run_demo
from .descriptor_file import save_descriptor
from .draw import glyphs
from .evaluate import table1_page
from .evaluate.methods import Settings, choose, load_prior
from .evaluate.photographs import Photographs, read_folder, shipped
from .evaluate.runner import cores
from .evaluate.table1 import Table1, run_table1, write_tables
from .exemplars_command import learn_exemplars
from .hog import HOGSpec
from .images import write_image
from .inversion import Inversion, batches, invert_batch, result_names
from .invert import LearnedPrior
from .invert.crops import least_side
from .invert.network import default_architecture
from .learning import learn_prior, lessons
from .metrics import DEFINITIONS
from .output import output_folder, replacing
from .pose.background import learn_background, least_size
from .pose.whitening import check_spec
from .pose_command import pose
from .refusal import UserError, refusing, spare
from .sources import Source, Wanted, read_sources
from .table2_command import table2
from .terminal import counter, print_definitions, print_table, progress_bars, say

INTERRUPTED = 130  # what shells report of a command ended by Ctrl-C


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command with ``argv``, by default the arguments of this process.

    Returns:
        The exit status: 0; 1 after an error, which one line on stderr has told; 2 for wrong arguments; 130 when
        interrupted.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # file names and units need not fit the terminal's encoding
    try:
        arguments = parser().parse_args(argv)
    except SystemExit as stop:  # --help, --version or wrong arguments: all said
        return int(stop.code or 0)
    name = f"nablahog {arguments.command}"
    try:
        _COMMANDS[arguments.command](arguments)
        sys.stdout.flush()  # a closed pipe should fail here, not at exit
    except KeyboardInterrupt:
        return _failed(name, "interrupted", INTERRUPTED)
    except BrokenPipeError:
        # whoever read our output has enough; Python would complain when it flushes stdout at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except (UserError, OSError) as error:
        return _failed(name, str(error))
    except (MemoryError, RuntimeError) as error:
        if not isinstance(error, MemoryError) and "memory" not in str(error):
            raise
        return _failed(name, "not enough memory; a smaller --size, or fewer inputs at once, need less")
    return 0


def _failed(name: str, message: str, status: int = 1) -> int:
    print(f"{name}: error: {' '.join(message.split())}", file=sys.stderr)
    return status


def _hog(arguments: Namespace) -> None:
    def write(path: Path, source: Source) -> None:
        save_descriptor(path, source.descriptor, source.spec, source.image_size)

    is_file = not arguments.output.endswith(os.sep)  # a file of any name, since np.load does not mind
    _write_each(arguments, ".npz", write, is_file=is_file)


def _glyph(arguments: Namespace) -> None:
    def write(path: Path, source: Source) -> None:
        write_image(path, glyphs(source.descriptor, source.spec))

    suffix = Path(arguments.output).suffix.lower()
    if suffix != ".png" and suffix in Image.registered_extensions():
        raise UserError(f"glyphs are written as PNG: expected -o FILE.png or a folder, got {arguments.output}")
    _write_each(arguments, "_glyphs.png", write, is_file=suffix == ".png")


def _invert(arguments: Namespace) -> None:
    sources = _read(arguments)
    prior = _prior_for(arguments, [(source.path, source.spec) for source in sources])
    folder = Path(arguments.output)
    spare(arguments.inputs, [folder / name for source in sources for name in result_names(source)])
    done: dict[int, Inversion] = {}
    with output_folder(folder):
        for number, batch in enumerate(groups := batches(sources), start=1):
            about = f"batch {number} of {len(groups)}, {len(batch)} x {sources[batch[0]].spec.name}"
            with progress_bars() as progress, refusing(f"{', '.join(sources[i].path for i in batch)}: "):
                found = invert_batch(
                    [sources[i] for i in batch],
                    device=arguments.device,
                    seed=arguments.seed,
                    max_evaluations=arguments.max_evaluations,
                    prior=prior,
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


def _demo(arguments: Namespace) -> None:
    with output_folder(arguments.output) as folder, progress_bars() as progress:
        tasks = {name: progress(name) for name in DESCRIPTORS}
        inversions = run_demo(
            folder,
            device=arguments.device,
            seed=arguments.seed,
            progress=lambda name, done, total: tasks[name](done, total),
            max_evaluations=arguments.max_evaluations,
        )
    _print_figures(inversions)
    say(f"Look at {folder / 'index.html'}")


def _table1(arguments: Namespace) -> None:
    with refusing():
        methods, left_out = choose(arguments.methods, with_prior=arguments.prior is not None)
    prior = _prior_for(arguments, ((method.name, method.spec) for method in methods if method.uses_prior))
    path = None if prior is None else Path(arguments.prior).resolve()
    settings = Settings(arguments.seed, arguments.max_evaluations, path)
    photographs, origin = _photographs(arguments)
    remarks = table1_page.remarks(left_out, prior, photographs)
    with output_folder(arguments.output) as folder:
        with counter("nablahog table1") as progress:
            workers = arguments.workers or cores()
            table = run_table1(folder, photographs, methods, settings, workers=workers, progress=progress)
        if not any(table.seconds.values()):
            first = table.failures[0]
            raise UserError(f"there is no result for any image; the first: {first.image}: {first.reason}")
        write_tables(folder, table)
        with replacing(folder / "index.html") as file:
            file.write(table1_page.page(table, settings, origin, remarks).encode())
    _print_table1(table)
    for remark in remarks:
        say(remark)
    say(f"Look at {folder / 'index.html'}")


def _photographs(arguments: Namespace) -> tuple[Photographs, str]:
    """The images for the table, and a sentence that says where they are from."""
    if arguments.images is None:
        photographs = shipped(size=arguments.size, limit=arguments.limit)
        return photographs, f"{len(photographs.images)} photographs that come with scikit-image, their middle squares."
    folder = Path(arguments.images)
    with refusing():
        photographs = read_folder(folder, size=arguments.size, limit=arguments.limit)
    number = len(photographs.images) + len(photographs.failed)
    return photographs, f"{number} images of the folder {folder.resolve().name}."


def _prior_for(arguments: Namespace, uses: Iterable[tuple[str, HOGSpec | None]]) -> LearnedPrior | None:
    """The prior asked for, if any, once it fits all ``uses``: what it is for, and the spec of its descriptors."""
    if arguments.prior is None:
        return None
    with refusing():
        prior = load_prior(Path(arguments.prior))
    for name, spec in uses:
        with refusing(f"{name}: "):
            prior.check(spec or prior.spec)
    return prior


def _print_table1(table: Table1) -> None:
    print_table(table1_page.terminal_rows(table))
    print_definitions(table1_page.DEFINITIONS)
    for failure in table.failures:
        say(f"Failed: {failure.image}, {failure.method or 'all methods'}: {failure.reason}")
    _say_ignored(table.photographs)


def _say_passed_over(photographs: Photographs) -> None:
    for name, reason in photographs.failed.items():
        say(f"Passed over: {name}: {reason}")
    _say_ignored(photographs)


def _say_ignored(photographs: Photographs) -> None:
    if photographs.ignored:
        say(f"Passed over, as no images by their endings: {', '.join(photographs.ignored)}")


def _learn_prior(arguments: Namespace) -> None:
    output = _npz_file(arguments, "a prior")
    if arguments.threads is not None:
        torch.set_num_threads(arguments.threads)
    with refusing():
        spec = _wanted(arguments).spec()
        default_architecture(spec)  # raises before the images are read
    photographs = _lessons(arguments, (least_side(spec.cell_size[0]),) * 2)
    with output_folder(output.parent), refusing():
        _say_passed_over(photographs)
        with counter("nablahog learn prior") as progress:
            prior = learn_prior(
                output, photographs, spec, epochs=arguments.epochs, seed=arguments.seed, progress=progress
            )
    training = prior.training
    say(
        f"Learned prior in {output}: {len(training.images)} images, {training.epochs} epochs, last loss "
        f"{training.losses[-1]:.4f}, {len(prior.weights):,} weights"
    )


def _learn_background(arguments: Namespace) -> None:
    output = _npz_file(arguments, "a background")
    with refusing():
        spec = _wanted(arguments).spec()
        check_spec(spec)
    photographs = _lessons(arguments, least_size(spec, arguments.order))
    with output_folder(output.parent), refusing():
        _say_passed_over(photographs)
        with counter("nablahog learn background") as progress:
            background = learn_background(photographs.images, spec, order=arguments.order, progress=progress)
        background.save(output)
    say(
        f"Background in {output}: {len(background.images)} images, {spec.channels} channels, templates of up to "
        f"{background.order + 1}x{background.order + 1} cells"
    )


def _npz_file(arguments: Namespace, what: str) -> Path:
    output = Path(arguments.output)
    if output.suffix.lower() != ".npz" or output.is_dir():
        raise UserError(f"{what} is one file: expected -o FILE.npz, got {output}")
    return output


def _lessons(arguments: Namespace, least: tuple[int, int]) -> Photographs:
    with refusing():
        return lessons(None if arguments.images is None else Path(arguments.images), least, arguments.size)


_COMMANDS: dict[str, Callable[[Namespace], None]] = {
    "hog": _hog,
    "glyph": _glyph,
    "invert": _invert,
    "demo": _demo,
    "table1": _table1,
    "table2": table2,
    "pose": pose,
    "learn prior": _learn_prior,
    "learn background": _learn_background,
    "learn exemplars": learn_exemplars,
}


def _read(arguments: Namespace) -> list[Source]:
    with refusing():
        return read_sources(
            arguments.inputs,
            _wanted(arguments),
            size=arguments.size,
            device=arguments.device,
            keep_photos=arguments.command == "invert",
        )


def _wanted(arguments: Namespace) -> Wanted:
    return Wanted(arguments.descriptor, arguments.cell, arguments.vote)


def _write_each(arguments: Namespace, ending: str, write: Callable[[Path, Source], None], *, is_file: bool) -> None:
    """One result for each input: the file ``-o`` for a single one, if ``is_file``; else files in the folder ``-o``."""
    sources = _read(arguments)
    output = Path(arguments.output)
    if len(sources) > 1 and output.suffix and ending.endswith(output.suffix.lower()):
        raise UserError(f"several inputs need a folder: expected -o DIR, got the file name {output}")
    if len(sources) == 1 and is_file and not output.is_dir():
        folder, targets = output.parent, [output]
    else:
        folder, targets = output, [output / f"{source.stem}{ending}" for source in sources]
    spare(arguments.inputs, targets)
    with output_folder(folder):
        for target, source in zip(targets, sources, strict=True):
            write(target, source)
    rows = [
        {
            "input": source.path,
            "descriptor": source.spec.name,
            "image_size": list(source.image_size),
            "shape": list(source.descriptor.shape),
            "output": str(target),
        }
        for target, source in zip(targets, sources, strict=True)
    ]
    if arguments.json:
        print(json.dumps(rows, indent=2))
    else:
        print_table(rows)


def _print_figures(inversions: Sequence[Inversion]) -> None:
    print_table([inversion.row() for inversion in inversions])
    print_definitions(DEFINITIONS)
