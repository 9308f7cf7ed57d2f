"""The command ``nablahog``: reads and checks all inputs, does the work, writes the results."""

from __future__ import annotations

import io
import json
import os
import sys
from argparse import Namespace
from collections.abc import Callable, Sequence
from pathlib import Path

from PIL import Image

from .arguments import parser
from .demo import run_demo
from .descriptor_file import save_descriptor
from .draw import glyphs
from .evaluate import table1_page
from .evaluate.methods import METHODS, Method, Settings
from .evaluate.photographs import Photographs, read_folder, shipped
from .evaluate.runner import cores
from .evaluate.table1 import Table1, run_table1, write_tables
from .images import write_image
from .inversion import Inversion, batches, invert_batch, result_names
from .metrics import DEFINITIONS
from .output import output_folder, replacing
from .sources import PRESETS, Source, Wanted, read_sources
from .terminal import counter, print_definitions, print_table, progress_bars, say

INTERRUPTED = 130  # what shells report of a command ended by Ctrl-C


class UserError(Exception):
    """Something the user can mend; its message is one sentence."""


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
    folder = Path(arguments.output)
    _spare_inputs(arguments, [folder / name for source in sources for name in result_names(source)])
    done: dict[int, Inversion] = {}
    with output_folder(folder):
        for number, batch in enumerate(groups := batches(sources), start=1):
            about = f"batch {number} of {len(groups)}, {len(batch)} x {sources[batch[0]].spec.name}"
            with progress_bars() as progress:
                done.update(zip(batch, _inverted([sources[i] for i in batch], arguments, progress(about)), strict=True))
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
        tasks = {name: progress(name) for name in PRESETS}
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
    methods = [METHODS[name] for name in METHODS if name in (arguments.methods or METHODS)]
    settings = Settings(arguments.seed, arguments.max_evaluations, _prior(arguments, methods))
    photographs, origin = _photographs(arguments)
    with output_folder(arguments.output) as folder:
        with counter("nablahog table1") as progress:
            workers = arguments.workers or cores()
            table = run_table1(folder, photographs, methods, settings, workers=workers, progress=progress)
        if not any(table.seconds.values()):
            first = table.failures[0]
            raise UserError(f"there is no result for any image; the first: {first.image}: {first.reason}")
        write_tables(folder, table)
        with replacing(folder / "index.html") as file:
            file.write(table1_page.page(table, settings, origin).encode())
    _print_table1(table)
    say(f"Look at {folder / 'index.html'}")


def _photographs(arguments: Namespace) -> tuple[Photographs, str]:
    """The images for the table, and a sentence that says where they are from."""
    if arguments.images is None:
        photographs = shipped(size=arguments.size, limit=arguments.limit)
        return photographs, f"{len(photographs.images)} photographs that come with scikit-image, their middle squares."
    folder = Path(arguments.images)
    try:
        photographs = read_folder(folder, size=arguments.size, limit=arguments.limit)
    except ValueError as error:
        raise UserError(str(error)) from None
    number = len(photographs.images) + len(photographs.failed)
    return photographs, f"{number} images of the folder {folder.resolve().name}."


def _prior(arguments: Namespace, methods: Sequence[Method]) -> Path | None:
    if arguments.prior is None:
        return None
    path = Path(arguments.prior)
    if not path.is_file():
        raise UserError(f"{path}: no such file" if not path.exists() else f"{path}: expected a file of a prior")
    if not any(method.uses_prior for method in methods):
        names = ", ".join(method.name for method in METHODS.values() if method.uses_prior)
        raise UserError(f"none of the methods asked for uses --prior; these do: {names}")
    return path.resolve()


def _print_table1(table: Table1) -> None:
    print_table(table1_page.terminal_rows(table))
    print_definitions(table1_page.DEFINITIONS)
    for failure in table.failures:
        say(f"Failed: {failure.image}, {failure.method or 'all methods'}: {failure.reason}")
    if table.photographs.ignored:
        say(f"Passed over, as no images by their endings: {', '.join(table.photographs.ignored)}")


_COMMANDS: dict[str, Callable[[Namespace], None]] = {
    "hog": _hog,
    "glyph": _glyph,
    "invert": _invert,
    "demo": _demo,
    "table1": _table1,
}


def _read(arguments: Namespace) -> list[Source]:
    try:
        return read_sources(
            arguments.inputs,
            Wanted(arguments.descriptor, arguments.cell, arguments.vote),
            size=arguments.size,
            device=arguments.device,
            keep_photos=arguments.command == "invert",
        )
    except ValueError as error:
        raise UserError(str(error)) from None


def _inverted(sources: list[Source], arguments: Namespace, progress: Callable[[int, int], None]) -> list[Inversion]:
    try:
        return invert_batch(
            sources,
            device=arguments.device,
            seed=arguments.seed,
            max_evaluations=arguments.max_evaluations,
            progress=progress,
        )
    except ValueError as error:
        raise UserError(f"{', '.join(source.path for source in sources)}: {error}") from None


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
    _spare_inputs(arguments, targets)
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


def _spare_inputs(arguments: Namespace, targets: Sequence[Path]) -> None:
    inputs = {os.path.realpath(path) for path in arguments.inputs}
    for target in targets:
        if os.path.realpath(target) in inputs:
            raise UserError(f"the result {target} would overwrite an input: expected another -o")


def _print_figures(inversions: Sequence[Inversion]) -> None:
    print_table([inversion.row() for inversion in inversions])
    print_definitions(DEFINITIONS)
