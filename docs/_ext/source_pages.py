"""The pages with the source code, as sphinx.ext.viewcode makes them, with links that lead back to where they should.

viewcode takes it that all names of a module are public in one package, but ``nablahog.stream`` and
``nablahog.hog.DescriptorStrip`` are of one file.
"""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx

BACK = re.compile(r'api/generated/(?P<page>[\w.]+)\.html#(?P<place>[\w.]+)"')


def whole_names(app: Sphinx, page: str, template: str, context: dict[str, Any], tree: nodes.document | None) -> None:
    """Links back lead to the name that the page has."""
    if page.startswith("_modules/"):
        context["body"] = BACK.sub(_back, context["body"])


def _back(link: re.Match[str]) -> str:
    page, place = link["page"], link["place"]
    return f'api/generated/{page}.html#{place if place.startswith(page) else page}"'


def without_missing(app: Sphinx) -> list[tuple[str, dict[str, Any], str]]:
    """Forgets modules without a source file, which the index would list all the same; no pages of its own."""
    modules = getattr(app.env, "_viewcode_modules", {})
    for name in [name for name, entry in modules.items() if not entry]:
        del modules[name]
    return []


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by Sphinx."""
    app.connect("html-page-context", whole_names)
    app.connect("html-collect-pages", without_missing, priority=400)  # viewcode has 500
    return {"parallel_read_safe": True, "parallel_write_safe": True}
