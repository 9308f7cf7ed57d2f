"""``nablahog table1``: the table of pre-images."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Mapping, Sequence
from pathlib import Path

from ...io.files import output_folder, write_text
from ...jobs.runner import cores
from ...paper import table1_page
from ...paper.learned import learned_from_samples, load, shipped_files
from ...paper.methods import Method, Table1Settings, choose
from ...paper.photographs import Photographs, read_folder, sample_photographs
from ...paper.table1 import run_table1, write_table1
from ..errors import UserError, as_user_error
from ..results.failures import say_failures, say_ignored
from ..terminal import counter, print_table, say, say_page


def table1(arguments: Namespace) -> None:
    """Makes the table of ``arguments.methods`` on ``arguments.images``.

    Raises:
        UserError: an input is unusable, or there is no result for any image.
        OSError: a file or folder is missing or cannot be written.
    """
    with as_user_error():
        files = {kind: Path(file).resolve() for kind, file in arguments.learned or ()}
        shipped = shipped_files()
        methods, left_out = choose(arguments.methods, files, shipped)
    _check_files(files, methods)
    files = {kind: path for kind, path in shipped.items() if any(kind in each.needs for each in methods)} | files
    photographs, origin = _photographs(arguments)
    with output_folder(arguments.output) as folder:
        settings = Table1Settings(arguments.seed, arguments.max_evaluations, files | _learn_missing(files, methods))
        remarks = table1_page.remarks(left_out, settings.learned, photographs)
        with counter("nablahog table1") as progress, as_user_error():
            workers = arguments.workers or cores()
            table = run_table1(
                folder, photographs, methods, settings, workers=workers, cluster=arguments.cluster, progress=progress
            )
        if not any(table.seconds.values()):
            first = table.failures[0]
            raise UserError(f"there is no result for any image; the first: {first.image}: {first.reason}")
        write_table1(folder, table)
        write_text(folder / "index.html", table1_page.page(table, settings, origin, remarks))
    print_table(table1_page.terminal_rows(table))
    say(f"Ran: {', '.join(method.name for method in methods)}")
    say_failures(table)
    say_ignored(photographs)
    for remark in remarks:
        say(remark)
    say_page(folder / "index.html")


def _check_files(files: Mapping[str, Path], methods: Sequence[Method]) -> None:
    """Raises UserError if a learned file cannot be read or is for other descriptors than those of its methods."""
    for kind, path in files.items():
        with as_user_error():
            model = load(kind, path)
        for method in methods:
            if method.needs[:1] == (kind,) and method.spec is not None:
                with as_user_error(f"{method.name}: "):
                    model.check(method.spec)


def _learn_missing(files: Mapping[str, Path], methods: Sequence[Method]) -> dict[str, Path]:
    """Learns, from bundled photographs, the files that methods need and no option gives."""
    learned = {}
    for kind in dict.fromkeys(kind for method in methods for kind in method.needs if kind not in files):
        with counter(f"nablahog table1, learning {kind}") as progress:
            learned[kind] = learned_from_samples(kind, progress)
    return learned


def _photographs(arguments: Namespace) -> tuple[Photographs, str]:
    """The images for the table, and a sentence that says where they are from."""
    if arguments.images is None:
        photographs = sample_photographs(size=arguments.size, limit=arguments.limit)
        return photographs, f"{len(photographs.images)} photographs that come with scikit-image, their middle squares."
    folder = Path(arguments.images)
    with as_user_error():
        photographs = read_folder(folder, size=arguments.size, limit=arguments.limit)
    number = len(photographs.images) + len(photographs.failed)
    return photographs, f"{number} images of the folder {folder.resolve().name}."
