"""A photograph, a descriptor file, and what a refusal looks like."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from functools import partial
from html import unescape
from pathlib import Path

import pytest
from PIL import Image

from nablahog.cli import terminal
from nablahog.cli.arguments.parsers import KINDS
from nablahog.cli.main import main
from nablahog.cli.results import inversion

from ..paper.common import run_in_this_process
from .common import CHELSEA


@pytest.fixture(autouse=True)
def no_lines_of_progress(monkeypatch: pytest.MonkeyPatch) -> None:
    """A busy machine may take longer than a test expects, and stderr has lines of progress then."""
    monkeypatch.setattr(terminal, "FIRST_LINE", math.inf)


@pytest.fixture(autouse=True)
def lines_of_progress_begin_with_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of any command that a test runs."""

    class Named(terminal._Lines):
        def __init__(self, name: str, items: str) -> None:
            assert name.startswith("nablahog ")
            assert re.fullmatch("[a-z]+s", items)
            super().__init__(name, items)

    monkeypatch.setattr(terminal, "_Lines", Named)


@pytest.fixture(autouse=True)
def pages_lead_to_each_other(tmp_path: Path) -> Iterator[None]:
    """The pages that a test leaves lead to those that are there, and to all but the first of a folder."""
    yield
    pages = {*tmp_path.rglob("*.html")}
    links = {page: re.findall('href="(?!data:|#)(.+?)"', page.read_text(encoding="utf-8")) for page in pages}
    linked = {page.parent / unescape(link) for page in pages for link in links[page]}
    assert linked | {page for page in pages if page.name == "index.html"} == pages


@pytest.fixture
def photo(tmp_path: Path) -> str:
    """A colour photograph of 60x80 pixels."""
    path = tmp_path / "in" / "cat.png"
    path.parent.mkdir()
    Image.fromarray(CHELSEA).save(path)
    return str(path)


@pytest.fixture
def images(tmp_path: Path) -> str:
    """Three small photographs."""
    folder = tmp_path / "images"
    folder.mkdir()
    for k in range(3):
        Image.fromarray(CHELSEA[5 * k : 5 * k + 40, 8 * k : 8 * k + 48]).save(folder / f"{k}.png")
    return str(folder)


@pytest.fixture
def descriptor(tmp_path: Path, photo: str) -> str:
    """A UoCTTI descriptor file of an image of 36x48 pixels."""
    path = tmp_path / "in" / "stored.npz"
    assert main(["hog", photo, "-o", str(path), "--size", "48"]) == 0
    return str(path)


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tables are made in this process."""
    run_in_this_process(monkeypatch)


@pytest.fixture
def two_iterations(monkeypatch: pytest.MonkeyPatch) -> None:
    """The paper's search ends after two iterations."""
    monkeypatch.setattr(inversion, "AsPublished", partial(inversion.AsPublished, iterations=2))


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Callable[..., None]:
    """Runs the command and checks that it says one line, ending in failure, and leaves nothing on disk."""

    def check(*argv: str, message: str, status: int = 1) -> None:
        before = sorted(tmp_path.rglob("*"))
        capsys.readouterr()
        assert main(argv) == status
        printed = capsys.readouterr()
        assert printed.out == ""
        command = " ".join(argv[:2]) if argv[:2] in {("learn", kind) for kind in KINDS} else argv[0]
        assert printed.err.startswith(f"nablahog {command}: error: ")
        assert printed.err.count("\n") == 1
        assert message in printed.err
        assert sorted(tmp_path.rglob("*")) == before

    return check
