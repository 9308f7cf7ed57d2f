"""Links of the pages as they are in the repository, and the check of those of the built site."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pytest
from PIL import Image

from docs import check_site
from nablahog.runtime.extras import INSTALL_COMMANDS, PACKAGES

ROOT = Path(__file__).parents[1]
PAGES = [
    page
    for page in {*ROOT.glob("*.md"), *ROOT.glob("*/*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("src/**/*.md")}
    if not any(part.startswith("auto_") or part == "generated" for part in page.parts)
]
MADE = ("auto_gallery/", "auto_tutorials/")  # by make docs


@pytest.mark.parametrize("page", sorted(PAGES), ids=lambda page: str(page.relative_to(ROOT)))
def test_links_of_markdown(page: Path) -> None:
    text = re.sub(r"```.*?```|`[^`\n]*`", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    targets = [target for target in re.findall(r"\]\(([^)\s]+)\)", text) if "://" not in target]
    files = {unquote(target.split("#")[0]) for target in targets} - {""}
    assert not [name for name in files if not name.startswith(MADE) and not (page.parent / name).exists()]


def test_limits_are_those_of_the_package() -> None:
    """Each that the table names a constant of: three digits of its amount, in the order of the row."""
    table = (ROOT / "docs/security.md").read_text(encoding="utf-8").split("## Limits")[1].split("## ")[0]
    units = {"": 1, "million": 1e6, "MiB": 2**20, "GiB": 2**30}
    stated, true = {}, {}
    for _, _, limits, places, _ in (row.split("|") for row in table.splitlines() if row.startswith("|")):
        names = re.findall(r"nablahog\.[\w.]+", places)
        amounts = [amount.replace(",", "").split() for amount in limits.split(";")]
        for name, (number, *unit) in zip(names, amounts * (len(names) if len(amounts) == 1 else 1), strict=True):
            module, _, constant = name.rpartition(".")
            stated[name] = float(number) * units["".join(unit)]
            true[name] = getattr(import_module(module), constant)
    assert len(stated) > 30
    assert stated == pytest.approx(true, rel=5e-3)


def test_extras_are_those_of_the_package() -> None:
    tomllib = pytest.importorskip("tomllib")  # Python 3.11
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]

    def packages(name: str) -> Iterator[str]:
        for requirement in extras[name]:
            inner = re.match(r"nablahog\[(.*)\]", requirement)
            if inner:
                yield from (package for extra in inner[1].split(",") for package in packages(extra))
            else:
                yield re.split(r"[^\w.-]", requirement)[0]

    assert {name: " ".join(packages(name)) for name in extras if name not in ("docs", "dev")} == PACKAGES


def test_install_commands_of_the_pages() -> None:
    """Extras are installed on each page by the command that errors show."""
    extras = {package for packages in PACKAGES.values() for package in packages.split()}
    seen = set()
    for page in {*PAGES, *ROOT.glob("docs/**/*.rst"), *ROOT.glob("src/**/*.py")} - {ROOT / "CHANGELOG.md"}:
        for command in re.findall(r"pip install [^`#\n]*[^`#\s]", page.read_text(encoding="utf-8")):
            assert "nablahog" not in command, page
            if extras & set(command.split()):
                seen.add(command)
                assert command in INSTALL_COMMANDS.values(), page
    assert {INSTALL_COMMANDS[name] for name in ("app", "cluster", "dataset")} <= seen


def test_dead_links(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["check_site", str(tmp_path)])
    (tmp_path / "b.html").write_text('<h1 id="here">b</h1><a href="https://example.org">elsewhere</a>')
    page = tmp_path / "a.html"
    page.write_text('<a href="b.html#here">b</a><a href="#top" id="top">a</a><img src="b.html">')
    assert check_site.main() == 0
    assert "0 dead" in capsys.readouterr().out
    check_site.page.cache_clear()
    page.write_text(
        '<a href="b.html#there">b</a><a href="c.html">c</a><script src="https://example.org/x.js"></script>'
    )
    assert check_site.main() == 1
    assert capsys.readouterr().out.splitlines() == [
        "a.html loads https://example.org/x.js",
        "a.html: no file c.html",
        "a.html: no place b.html#there",
        "2 pages, 3 links, 3 dead, 0 pictures missing or empty",
    ]


def test_empty_pictures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["check_site", str(tmp_path)])
    (tmp_path / "_images").mkdir()
    for name, levels in (("white", [255, 255]), ("faint", [155, 255]), ("drawn", [154, 255])):
        Image.fromarray(np.uint8([levels])).save(tmp_path / "_images" / f"sphx_glr_plot_{name}_001.png")
    for name in ("white", "faint", "drawn", "a"):
        picture = f'<img src="_images/sphx_glr_plot_{name}_001.png">'
        (tmp_path / f"plot_{name}.html").write_text(picture if name != "a" else "")
    assert check_site.main() == 1
    assert [line.partition(":")[0] for line in capsys.readouterr().out.splitlines()[:-1]] == [
        "plot_a.html",
        "plot_faint.html",
        "plot_white.html",
    ]
