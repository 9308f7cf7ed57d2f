"""What the result files of each command say is defined, in the JSON file itself or on the page beside it."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Iterator
from html import unescape
from pathlib import Path

import pytest
from PIL import Image

from nablahog.cli import terminal
from nablahog.cli.main import main

from .common import CHELSEA, TETRAHEDRON

CONTAINERS = {
    *("info", "description", "version", "images", "categories", "annotations", "failed", "definitions")
}  # the outline of COCO's format


def keys(value: object) -> Iterator[str]:
    """The keys of JSON, but not those of its definitions."""
    if isinstance(value, list):
        for item in value:
            yield from keys(item)
    elif isinstance(value, dict):
        for name, item in value.items():
            yield name
            yield from () if name == "definitions" else keys(item)


def figures(rows: list[dict[str, str]]) -> Iterator[str]:
    """The columns of a table, and the figures that its rows name."""
    for row in rows:
        yield from row
        yield from (row[column] for column in ("figure", "metric") if column in row)


def undefined(folder: Path) -> set[str]:
    """The keys and columns of all files of a folder that no definition names."""
    pages = [unescape(page.read_text()) for page in folder.glob("index.html")]
    definitions = [name for page in pages for name in re.findall("<dt>(.*?)</dt>", page)]
    names = set[str]()
    for file in folder.glob("*.json"):
        found = json.loads(file.read_text())
        definitions += found["definitions"] if isinstance(found, dict) else []
        names |= {*keys(found)}
    for file in folder.glob("*.csv"):
        with open(file, newline="") as lines:
            reader = csv.DictReader(lines)
            names |= {*(reader.fieldnames or ()), *figures([*reader])}
    assert names
    return names - {part for name in definitions for part in (name, name.lower(), *name.split(", "))} - CONTAINERS


COMMANDS = {
    "invert": "PHOTOS --preset paper --samples 2 --quality fast",
    "pose": "PHOTOS --annotations PHOTOS/objects.csv --mesh PHOTOS/model.off --focal 80 --distortion=0.1,0,0,0",
    "table1": "--images PHOTOS --methods uoctti-single --max-evaluations 2",
    "table2": "--objects 1 --methods exhaustive --conditions exact",
}
COUNTED = {"invert": "evaluations", "pose": "objects", "table1": "results", "table2": "results"}  # by lines of progress
HEADINGS = {  # of the page, before the definitions
    "invert": ["0.png, paper", "1.png, paper", "Skipped inputs"],
    "pose": ["Outlines", "Positions", "Doubtful poses", "No pose"],
    "table1": ["Failed: 1", "Pictures"],
    "table2": ["Rotation", "Harder conditions", "Pictures"],
}


@pytest.mark.slow
@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("command", COMMANDS)
def test_all_is_defined(
    tmp_path: Path, command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of two photographs, and a file that is none; lines of progress and the page's headings are the command's."""
    monkeypatch.setattr(terminal, "FIRST_LINE", 0.0)
    photographs, out = tmp_path / "photographs", tmp_path / "out"
    photographs.mkdir()
    for k in range(2):
        Image.fromarray(CHELSEA[8 * k : 8 * k + 64, :64]).save(photographs / f"{k}.png")
    (photographs / "bad.png").write_bytes(b"no image")
    (photographs / "model.off").write_text(TETRAHEDRON)
    (photographs / "objects.csv").write_text("image,x0,y0,x1,y1\n0.png,5,5,60,60\nbad.png,5,5,60,60\n")
    main([command, *COMMANDS[command].replace("PHOTOS", str(photographs)).split(), "-o", str(out)])
    assert not undefined(out)
    assert re.search(rf"^nablahog {command}: \d+ of \d+ {COUNTED[command]} done", capsys.readouterr().err, re.MULTILINE)
    headings = re.findall("<h2>(.*?)</h2>", (out / "index.html").read_text())
    assert headings == [*HEADINGS[command], "What the figures mean"]
