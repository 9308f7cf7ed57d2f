"""Who imports whom: downwards only, read from all import statements, those inside functions and for types included."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path
from typing import NamedTuple

import nablahog

PACKAGE = Path(nablahog.__file__).parent

# A room is a folder of the package, or a module beside the folders; "nablahog" is the package's own __init__.  A room
# may import itself and the rooms that are named with it.  Rooms are listed from the bottom: all arrows point upwards
# in this list, so that there is no cycle.
MAY_IMPORT: dict[str, set[str]] = {
    "runtime": set(),
    "native": {"runtime"},
    "inputs": {"runtime"},  # what people pass
    "hog": {"inputs", "runtime"},  # no optimiser
    "io": {"hog", "inputs", "runtime"},
    "metrics": {"inputs", "runtime"},
    "optimize": {"runtime"},
    "render": {"inputs", "io", "runtime"},  # no HOG
    "viz": {"hog", "inputs", "io", "runtime"},
    "compat": {"hog", "inputs", "io", "runtime"},
    "jobs": {"hog", "inputs", "io", "runtime"},
    "invert": {"hog", "inputs", "io", "metrics", "optimize", "runtime"},  # no pose
    "pose": {"hog", "inputs", "io", "metrics", "optimize", "render", "runtime"},  # no inversion
}
MAY_IMPORT["nablahog"] = {*MAY_IMPORT} - {"jobs"}
MAY_IMPORT["paper"] = {*MAY_IMPORT} - {"nablahog"}
MAY_IMPORT["requests"] = {"compat", "hog", "inputs", "invert", "io", "pose", "runtime"}  # what front ends can be asked
MAY_IMPORT["app"] = {*MAY_IMPORT} - {"nablahog", "paper"}
MAY_IMPORT["cli"] = {*MAY_IMPORT} - {"nablahog"}  # one of its commands starts the page
MAY_IMPORT["__main__"] = {"cli"}
for _name in {*MAY_IMPORT} - {"native", "runtime", "__main__"}:
    MAY_IMPORT[_name].add("native")  # compiled loops, which know nothing of HOG


class Arrow(NamedTuple):
    """An import of the module ``target`` at a line of the file ``source``; both relative to the package."""

    source: Path
    line: int
    target: Path


def room(module: Path) -> str:
    if module == Path("__init__.py"):
        return "nablahog"
    return module.parts[0].removesuffix(".py")


@cache
def arrows() -> list[Arrow]:
    """All imports of modules of the package by modules of the package."""
    return [
        Arrow(file.with_suffix(".py").relative_to(PACKAGE), node.lineno, target.relative_to(PACKAGE))
        for file in sorted([*PACKAGE.rglob("*.py"), *PACKAGE.rglob("*.pyi")])
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom | ast.Import)
        for target in targets(node, file)
    ]


def targets(node: ast.ImportFrom | ast.Import, file: Path) -> Iterator[Path]:
    if isinstance(node, ast.Import):
        for alias in node.names:
            if alias.name.split(".")[0] == PACKAGE.name:
                yield from module(PACKAGE.parent.joinpath(*alias.name.split(".")))
    elif node.level or (node.module or "").split(".")[0] == PACKAGE.name:
        base = file.parents[node.level - 1] if node.level else PACKAGE.parent
        path = base.joinpath(*(node.module or "").split("."))
        for alias in node.names:
            yield from module(path / alias.name) or module(path)


def module(path: Path) -> list[Path]:
    return [file for file in (path.with_name(f"{path.name}.py"), path / "__init__.py") if file.is_file()][:1]


def test_rooms_are_listed_from_the_bottom() -> None:
    rooms = list(MAY_IMPORT)
    for number, (name, below) in enumerate(MAY_IMPORT.items()):
        assert below <= set(rooms[:number]), name


def test_every_room_has_its_rule() -> None:
    assert {room(file.relative_to(PACKAGE)) for file in PACKAGE.rglob("*.py")} == set(MAY_IMPORT)


def test_imports_point_downwards() -> None:
    wrong = [
        f"src/nablahog/{source}:{line} imports {target}: the room {room(source)} may import only "
        f"{', '.join(sorted(MAY_IMPORT[room(source)])) or 'nothing'}"
        for source, line, target in arrows()
        if room(target) not in {room(source), *MAY_IMPORT[room(source)]}
    ]
    assert not wrong, "\n".join(wrong)


def test_there_is_no_circle_inside_a_room() -> None:
    behind: dict[str, set[str]] = {}
    for source, _, target in arrows():
        if room(source) == room(target) and source != target:
            behind.setdefault(str(source), set()).add(str(target))
    TopologicalSorter(behind).prepare()  # raises CycleError, with the circle


def test_inner_rooms_belong_to_one_room() -> None:
    """Native loops and kernels are called through ``hog.descriptor``, and commands are run by name."""
    wrong = [
        f"src/nablahog/{source}:{line} imports {target}: only {room(target)}/ may"
        for source, line, target in arrows()
        for inner in ("hog/kernels", "hog/triton", "cli/commands")
        if target.is_relative_to(inner) and room(source) != room(target)
    ]
    assert not wrong, "\n".join(wrong)


def test_only_the_tables_know_the_paper() -> None:
    """``nablahog table1``, ``table2`` and ``learn``, which learns what Table 1 compares with, and their arguments."""
    knowing = {"cli/commands/tables.py", "cli/commands/learn.py", "cli/arguments/parsers.py"}
    wrong = {str(source) for source, _, target in arrows() if room(target) == "paper" != room(source)} - knowing
    assert not wrong


def test_the_command_goes_one_way() -> None:
    """Arguments know nothing else, inputs no results, and nothing but the entrance knows the commands."""
    names = "errors.py terminal.py interruption.py arguments input_files.py inputs.py image_lists.py results commands"
    order = [*names.split(), "main.py"]
    wrong = [
        f"src/nablahog/{source}:{line} imports {target}: in cli/, each may import only what is before it in {order}"
        for source, line, target in arrows()
        if room(source) == room(target) == "cli"
        and min(source.parts[1], target.parts[1]) != "__init__.py"
        and order.index(target.parts[1]) > order.index(source.parts[1])
    ]
    assert not wrong, "\n".join(wrong)
