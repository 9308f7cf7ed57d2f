"""The scripts of examples/ run, with small settings, and each writes its picture."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import pytest
from PIL import Image

FOLDER = Path(__file__).parent.parent / "examples"
SETTINGS = {
    "detector_score": ["--steps", "2"],
    "detector_template": ["--quality", "fast"],
    "hog_as_a_loss": ["--size", "64", "--steps", "3"],
    "invert": ["--size", "64", "--quality", "fast"],
    "render_and_fit": ["--size", "64", "--steps", "3"],
}


def run(name: str, out: Path) -> None:
    runpy.run_path(str(FOLDER / f"{name}.py"))["main"]([*SETTINGS[name], "--out", str(out)])
    with Image.open(out) as picture:
        low, high = picture.convert("L").getextrema()
    assert high - low > 100  # it shows something


def test_every_example_is_run() -> None:
    assert sorted(SETTINGS) == sorted(path.stem for path in FOLDER.glob("*.py"))


@pytest.mark.parametrize("name", SETTINGS)
def test_it_writes_its_picture(name: str, tmp_path: Path) -> None:
    run(name, tmp_path / "picture.png")


def test_a_detector_is_learned_without_opencv(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cv2", None)
    run("detector_template", tmp_path / "picture.png")


@pytest.mark.parametrize("name", SETTINGS)
def test_it_is_short_and_uses_the_public_face_alone(name: str) -> None:
    lines = (FOLDER / f"{name}.py").read_text().splitlines()
    assert len(lines) < 60
    assert not any("from nablahog" in line or "import nablahog." in line for line in lines)
