"""What is written by a program because it repeats what is said elsewhere; `make generated` writes it, and
`tests/test_generated.py` says what is stale.

* The stubs of parts, from the definitions in their folders: what is a preset, a normaliser or a minimiser.
* The tables and lists of the pages in `docs`, from specs and docstrings.
* The stored public surface, from the package and its command; and drawings of the pages.

It is in `tests`, because it reads the stored outputs there, and the package must not know its pages.
"""

from __future__ import annotations

import ast
import json
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "nablahog"
COMMENTS = {".md": "<!-- {} -->", ".rst": ".. {}", ".pyi": "# {}"}

MINIMISERS = '''"""The minimisers by name, written by `make generated`: functions here that return a Minimum."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, TypeAlias

{functions}from .problems import Minimum

Minimiser: TypeAlias = Literal[{names}]
MINIMISERS: dict[Minimiser, Callable[..., Minimum]] = {{{table}}}
'''


def write() -> None:
    """Stubs come first: the others are made from the package that has them."""
    for make in (stubs, others):
        for path, text in make().items():
            path.write_text(text, encoding="utf-8")


def stubs() -> dict[Path, str]:
    """What the stubs and the table of minimisers must contain."""
    presets, normalizers = definitions("hog/presets"), definitions("hog/normalizers")
    kinds = {module: [name for name, node in nodes.items() if has_kind(node)] for module, nodes in normalizers.items()}
    minimisers = sorted(
        name
        for nodes in definitions("optimize").values()
        for name, node in nodes.items()
        if isinstance(node, ast.FunctionDef) and node.returns and ast.unparse(node.returns) == "Minimum"
    )
    names = ", ".join(f'"{name}"' for name in minimisers)
    table = ", ".join(f'"{name}": {name}' for name in minimisers)
    hog, optimize = PACKAGE / "hog", PACKAGE / "optimize"
    functions = "".join(f"from .{name} import {name}\n" for name in minimisers)
    return {
        hog / "presets" / "__init__.pyi": imports(presets) + "\n__all__: list[str]\n",
        hog / "normalizers" / "__init__.pyi": imports(normalizers),
        **within(
            hog / "__init__.pyi",
            normalizers=imports({"normalizers": sorted(name for names in kinds.values() for name in names)}),
        ),
        **within(optimize / "__init__.pyi", minimisers=imports({name: [name] for name in minimisers})),
        optimize / "minimisers.py": MINIMISERS.format(functions=functions, names=names, table=table),
    }


def definitions(folder: str) -> dict[str, dict[str, ast.ClassDef | ast.FunctionDef]]:
    """The public classes and functions of each module of a folder of the package, by name."""
    return {
        path.stem: {
            node.name: node
            for node in ast.parse(path.read_text(encoding="utf-8")).body
            if isinstance(node, ast.ClassDef | ast.FunctionDef) and node.name[0] != "_"
        }
        for path in sorted((PACKAGE / folder).glob("*.py"))
    }


def has_kind(node: ast.ClassDef | ast.FunctionDef) -> bool:
    """Whether a class is a part that specs can have."""
    return isinstance(node, ast.ClassDef) and any(
        isinstance(line, ast.AnnAssign) and line.value and ast.unparse(line.target) == "kind" for line in node.body
    )


def others() -> dict[Path, str]:
    """What the pages and the stored surface must contain."""
    from docs import preset_tables
    from nablahog.hog import presets
    from nablahog.hog.normalizers import Normalizer
    from nablahog.hog.poolings import Pooling
    from tests.public_surface import surface
    from tests.viz import drawings

    docs = ROOT / "docs"
    parts = [*Normalizer.kinds.values(), *Pooling.kinds.values()]
    ours = [part.__name__ for part in parts if part.__module__.startswith("nablahog.")]
    return {
        **within(docs / "getting_started.md", presets=preset_tables.choices()),
        **within(docs / "which_hog.md", counts=preset_tables.counts(), conventions=preset_tables.conventions()),
        **within(docs / "poses.md", figures=pose_figures()),
        **within(docs / "api" / "describe.rst", presets=summaries(presets.__all__), parts=summaries(ours)),
        ROOT / "tests" / "viz" / "similarity_by_azimuth.svg": drawings.similarity_by_azimuth(),
        ROOT / "tests" / "viz" / "chart.svg": drawings.chart(),
        ROOT / "tests" / "public_surface.json": json.dumps(surface(), indent=1, ensure_ascii=False) + "\n",
    }


def pose_figures() -> str:
    """A table of the figures of poses; columns of poses.csv are bold."""
    from docs.preset_tables import table
    from nablahog.cli.results.pose_files import COLUMNS
    from nablahog.cli.results.pose_table import DEFINITIONS

    def write(name: str) -> str:
        return f"**`{name}`**" if name in COLUMNS else f"`{name}`"

    rows = ((", ".join(map(write, names.split(", "))), text) for names, text in DEFINITIONS.items())
    return table(("figure", "meaning"), *rows)


def summaries(names: list[str]) -> str:
    """A table of names with links to their pages."""
    lines = "".join(f"   {name}\n" for name in names)
    return f".. autosummary::\n   :toctree: generated\n   :nosignatures:\n\n{lines}"


def within(path: Path, **blocks: str) -> dict[Path, str]:
    """A file with other text between the comments ``generated: NAME`` and ``end of NAME``."""
    text = path.read_text(encoding="utf-8")
    comment = COMMENTS[path.suffix]
    for name, block in blocks.items():
        first, last = comment.format(f"generated: {name}"), comment.format(f"end of {name}")
        before, found, rest = text.partition(f"{first}\n")
        _, ended, after = rest.partition(last)
        if not (found and ended):
            raise ValueError(f"{path} must have the lines {first!r} and {last!r}")
        text = f"{before}{found}\n{block}\n{last}{after}"
    return {path: text}


def imports(modules: dict[str, Any]) -> str:
    """Lines of a stub, as ruff formats them."""
    lines = []
    for module, names in modules.items():
        both = [f"{name} as {name}" for name in sorted(names)]
        line = f"from .{module} import {', '.join(both)}\n"
        if len(line) > 121:
            each = "".join(f"    {name},\n" for name in both)
            line = f"from .{module} import (\n{each})\n"
        lines += [line] if both else []
    return "".join(lines)


if __name__ == "__main__":
    write()
