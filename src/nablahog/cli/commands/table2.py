"""``nablahog table2``: the table of poses."""

from __future__ import annotations

from argparse import Namespace

from ...io.files import output_folder, write_text
from ...jobs.runner import cores
from ...paper import table2_page
from ...paper.pose_methods import POSE_METHODS, Table2Settings
from ...paper.table2 import run_table2, write_table2
from ..errors import UserError, as_user_error
from ..inputs.objects import objects
from ..results.failures import say_failures
from ..terminal import counter, print_table, say, say_page


def table2(arguments: Namespace) -> None:
    """Makes the table of ``arguments.methods``.

    Raises:
        UserError: an input is unusable, or there is no pose of any object.
        OSError: a file or folder is missing or cannot be written.
    """
    methods = [method for name, method in POSE_METHODS.items() if name in (arguments.methods or POSE_METHODS)]
    with as_user_error():
        of = objects(arguments)
    with output_folder(arguments.output) as folder:
        settings = Table2Settings(arguments.seed, folder / "exemplars")
        if arguments.cluster is not None:
            (folder / "exemplars").mkdir(exist_ok=True)  # so that workers see that they share the folder
        with counter("nablahog table2") as progress, as_user_error():
            table = run_table2(
                folder,
                of.examples,
                methods,
                settings,
                of.conditions,
                workers=arguments.workers or cores(),
                cluster=arguments.cluster,
                progress=progress,
            )
        if not any(table.seconds.values()):
            first = next(failure for failure in table.failures if failure.method is not None)
            raise UserError(f"there is no pose of any object; the first: {first.image}: {first.reason}")
        write_table2(folder, table)
        write_text(folder / "index.html", table2_page.page(table, settings))
    say(table.examples.origin)
    print_table(table2_page.terminal_rows(table))
    print_table(table2_page.terminal_rotations(table))
    if table.conditions:
        print_table(table2_page.terminal_conditions(table))
    say(f"Ran: {', '.join(method.name for method in methods)}")
    say_failures(table)
    for name, reason in of.passed_over.items():
        say(f"Passed over: {name}: {reason}")
    say_page(folder / "index.html")
