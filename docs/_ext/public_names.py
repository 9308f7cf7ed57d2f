"""References to a name where it is defined go to the page of its public name.

A type in a signature is ``nablahog.hog.spec.HOGSpec``, its page that of ``nablahog.HOGSpec``. What exists but has no
page, such as a module that a docstring points to, is shown as code without a link. A name that does not exist is left
to Sphinx, which warns of it.
"""

from __future__ import annotations

import pkgutil
import re
import sys
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from typing import Any

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.ext.autodoc import Options
from sphinx.util.nodes import make_refnode

import nablahog

DOCUMENTED: dict[int, str] = {}
"""The names with a page, by the identity of what they name."""


@cache
def modules() -> tuple[str, ...]:
    """The names of all modules of the package."""
    return "nablahog", *(each.name for each in pkgutil.walk_packages(nablahog.__path__, "nablahog."))


def named(target: str, context: str | None) -> Iterator[Any]:
    """What a reference may mean: a module by the end of its name, and then a name in it, or in one of its classes."""
    parts = target.split(".")
    for module in modules():
        for count in range(len(parts) + 1):
            if count:
                meant = f".{module}".endswith("." + ".".join(parts[:count]))
            else:  # of the module that the reference is in
                meant = module == context or (module.startswith(f"{context}.") and module in sys.modules)
            if meant:
                yield from inside(import_module(module), parts[count:])
    if len(parts) == 1 and context in modules():
        for each in vars(import_module(context)).values():
            if isinstance(each, type) and each.__module__ == context:
                yield from inside(each, parts)


def inside(value: Any, path: list[str]) -> Iterator[Any]:
    """The attribute of an attribute of … the value, if there is one."""
    for name in path:
        value = getattr(value, name, None)
    if value is not None:
        yield value


def page_of(value: Any, env: BuildEnvironment) -> str | None:
    """The public name under which ``value`` has a page."""
    objects = env.domains.python_domain.objects
    if not DOCUMENTED:
        for name, entry in objects.items():
            if not entry.aliased:
                DOCUMENTED.update({id(each): name for each in inside(nablahog, name.split(".")[1:])})
    return DOCUMENTED.get(id(value))


def resolve(app: Sphinx, env: BuildEnvironment, node: pending_xref, shown: nodes.TextElement) -> nodes.Node | None:
    """Called by Sphinx for each reference that it cannot resolve."""
    if node.get("refdomain") != "py":
        return None
    target = node["reftarget"].lstrip(".~!")
    there = False
    for value in named(target, node.get("py:module")):
        there = True
        if (name := page_of(value, env)) is not None:
            entry = env.domains.python_domain.objects[name]
            return make_refnode(app.builder, node["refdoc"], entry.docname, entry.node_id, [shown], name)
    if there:
        return shown
    return None


PAGE = re.compile(r"``docs/(\w+)\.md``")
SEVERAL = re.compile(r"^( +)(\w+(?:, \w+)+): ")


def for_napoleon(app: Sphinx, what: str, name: str, of: Any, options: Options, lines: list[str]) -> None:
    """Makes of a docstring what napoleon reads as it is meant.

    In "x, y: pixels" it would take x for a type, and in a property's "(H, W): of the image" what is before the colon.
    Bars are those of mathematics, and pages of the documentation are linked.
    """
    lines[:] = [line if line.lstrip()[:3] in (">>>", "...") else _bars(PAGE.sub(r":doc:`/\1`", line)) for line in lines]
    if what in ("attribute", "data", "property") and lines:
        lines.insert(0, "\\ ")
    for number in reversed(range(len(lines))):
        if (match := SEVERAL.match(lines[number])) and _in_section(lines[:number]):
            indent, names = match[1], match[2].split(", ")
            end = number + 1
            while end < len(lines) and lines[end].startswith(f"{indent} "):
                end += 1
            text, rest = lines[number][match.end() :], lines[number + 1 : end]
            lines[number:end] = [line for each in names for line in (f"{indent}{each}: {text}", *rest)]


def _bars(line: str) -> str:
    parts = line.split("``")
    return "``".join(part if number % 2 else part.replace("|", "\\|") for number, part in enumerate(parts))


def _in_section(above: list[str]) -> bool:
    heads = [line for line in above if line and not line.startswith(" ")]
    return bool(heads) and heads[-1] in ("Args:", "Attributes:")


def without_factories(app: Sphinx, *of: Any) -> tuple[str, str | None] | None:
    """The signature of a dataclass, with defaults that Sphinx can read."""
    *_, signature, result = of
    return (signature.replace("<factory>", "..."), result) if "<factory>" in (signature or "") else None


def is_field(app: Sphinx, what: str, name: str, of: Any, skip: bool, options: Options) -> bool | None:
    """Leaves out the fields of a NamedTuple, which its own docstring describes."""
    return True if type(of).__name__ == "_tuplegetter" else None


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by Sphinx."""
    app.connect("autodoc-process-docstring", for_napoleon, priority=400)  # napoleon has 500
    app.connect("autodoc-process-signature", without_factories)
    app.connect("autodoc-skip-member", is_field)
    app.connect("missing-reference", resolve)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
