"""Links to files of the repository that pages of the site include go to these pages; others to a copy of the file."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from sphinx.addnodes import download_reference, pending_xref
from sphinx.application import Sphinx
from sphinx.transforms.post_transforms import SphinxPostTransform

ROOT = Path(__file__).parents[2]
PAGES = {
    "benchmarks/README": "benchmarks",
    "src/nablahog/invert/prior/default_priors/README": "default_priors",
    "src/nablahog/pose/default_viewpoints/README": "default_viewpoints",
    "CHANGELOG": "changelog",
    "CONTRIBUTING": "contributing",
    "README": "index",
}


class ToPages(SphinxPostTransform):
    """Gives such a link, or one to a script of the gallery, the page as its target."""

    default_priority = 8  # myst resolves links at 9

    def run(self, **kwargs: Any) -> None:
        for node in list(self.document.findall(download_reference)):
            script = re.fullmatch(r"(?:.*/)?(gallery|tutorials)/(plot_\w+)\.py", str(node.get("reftarget")))
            if script and node.get("reftype") == "myst":
                target = f"auto_{script[1]}/{script[2]}"
                link = pending_xref("", *node.children, refdoc=node["refdoc"], reftype="myst", refexplicit=True)
                link["refdomain"], link["reftarget"], link["reftargetid"] = "doc", target, None
                node.replace_self(link)
        for node in self.document.findall(pending_xref):
            if node.get("reftype") == "myst":
                target, _, anchor = str(node["reftarget"]).removesuffix(".md").partition(".md#")
                for base in (Path(self.env.srcdir), ROOT):
                    page = PAGES.get(str((base / target).resolve()).removeprefix(f"{ROOT}/"))
                    if page is not None:
                        node["refdomain"], node["reftarget"] = "doc", page
                        node["reftargetid"] = anchor or node.get("reftargetid")


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by Sphinx."""
    app.add_post_transform(ToPages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
