"""Links of the pages as they are in the repository, and the check of those of the built site."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from urllib.parse import unquote

import pytest

from docs import check_links

ROOT = Path(__file__).parents[1]
PAGES = [
    page
    for page in (
        *ROOT.glob("*.md"),
        *(ROOT / "docs").rglob("*.md"),
        *(ROOT / "src").rglob("*.md"),
        *ROOT.glob("*/*.md"),
    )
    if not any(part.startswith("auto_") or part == "generated" for part in page.parts)
]
MADE = ("auto_gallery/", "auto_tutorials/")  # by make docs


@pytest.mark.parametrize("page", sorted(set(PAGES)), ids=lambda page: str(page.relative_to(ROOT)))
def test_links_of_markdown(page: Path) -> None:
    text = re.sub(r"```.*?```|`[^`\n]*`", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    targets = [target for target in re.findall(r"\]\(([^)\s]+)\)", text) if "://" not in target]
    files = {unquote(target.split("#")[0]) for target in targets} - {""}
    assert not [name for name in files if not name.startswith(MADE) and not (page.parent / name).exists()]


def test_dead_links(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["check_links", str(tmp_path)])
    (tmp_path / "b.html").write_text('<h1 id="here">b</h1><a href="https://example.org">elsewhere</a>')
    page = tmp_path / "a.html"
    page.write_text('<a href="b.html#here">b</a><a href="#top" id="top">a</a><img src="b.html">')
    assert check_links.main() == 0
    assert capsys.readouterr().out == "2 pages, 3 links, 0 dead\n"
    check_links.page.cache_clear()
    page.write_text(
        '<a href="b.html#there">b</a><a href="c.html">c</a><script src="https://example.org/x.js"></script>'
    )
    assert check_links.main() == 1
    assert capsys.readouterr().out.splitlines() == [
        "a.html loads https://example.org/x.js",
        "a.html: no file c.html",
        "a.html: no place b.html#there",
        "2 pages, 3 links, 3 dead",
    ]
