"""The directive ``citation``: BibTeX of the paper and of the software, from CITATION.cff."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

CFF = Path(__file__).parents[2] / "CITATION.cff"


class Citation(SphinxDirective):
    """Both entries, each a block to copy."""

    def run(self) -> list[nodes.Node]:
        self.env.note_dependency(str(CFF))
        software = yaml.safe_load(CFF.read_text(encoding="utf-8"))
        paper = software["preferred-citation"]
        entries = {
            "The paper": bibtex(
                "inproceedings",
                "chiu2015see",
                author=authors(paper),
                title=paper["title"],
                booktitle=paper["collection-title"],
                year=paper["year"],
                url=paper["url"],
            ),
            "The software": bibtex(
                "software",
                "nablahog",
                author=authors(software),
                title=software["title"],
                version=software["version"],
                license=software["license"],
            ),
        }
        shown: list[nodes.Node] = []
        for title, text in entries.items():
            shown += [nodes.rubric(title, title), nodes.literal_block(text, text, language="bibtex")]
        return shown


def authors(of: dict[str, Any]) -> str:
    """The authors as BibTeX has them."""
    names = (
        f"{each['family-names']}, {each['given-names']}" if "given-names" in each else f"{{{each['name']}}}"
        for each in of["authors"]
    )
    return " and ".join(names)


def bibtex(kind: str, key: str, **fields: Any) -> str:
    """One entry."""
    lines = (f"  {name} = {{{value}}}," for name, value in fields.items())
    return "\n".join([f"@{kind}{{{key},", *lines, "}"])


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by Sphinx."""
    app.add_directive("citation", Citation)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
