"""The table of pre-images, as ``nablahog table1`` makes it."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from .evaluate import table1_page
from .evaluate.methods import Settings, choose
from .evaluate.photographs import Photographs, read_folder, shipped
from .evaluate.runner import cores
from .evaluate.table1 import Table1, run_table1, write_tables
from .output import output_folder, replacing
from .prior_option import prior_for
from .refusal import UserError, refusing
from .terminal import counter, print_definitions, print_table, say


def table1(arguments: Namespace) -> None:
    """Makes the table as the command line asks for it.

    Raises:
        UserError: an input is unusable, or there is no result for any image.
        OSError: a file or folder is missing or cannot be written.
    """
    with refusing():
        methods, left_out = choose(arguments.methods, with_prior=arguments.prior is not None)
    prior = prior_for(arguments, ((method.name, method.spec) for method in methods if method.uses_prior))
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
    _print(table)
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


def _print(table: Table1) -> None:
    print_table(table1_page.terminal_rows(table))
    print_definitions(table1_page.DEFINITIONS)
    for failure in table.failures:
        say(f"Failed: {failure.image}, {failure.method or 'all methods'}: {failure.reason}")
    say_ignored(table.photographs)


def say_ignored(photographs: Photographs) -> None:
    """A line about the files of the folder that are no images, if any."""
    if photographs.ignored:
        say(f"Passed over, as no images by their endings: {', '.join(photographs.ignored)}")
