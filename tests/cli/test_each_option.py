"""Each option of what can be asked changes something: files, or the exit status."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from nablahog import hog
from nablahog.cli.main import main
from nablahog.requests.inversion import GlyphRequest, HogRequest, InvertRequest
from nablahog.requests.options import list_options
from nablahog.requests.pose import PoseRequest

from .commands.test_pose import WEDGE
from .common import CHELSEA

INPUTS = {HogRequest: ("hog", "cat.png"), GlyphRequest: ("glyph", ""), InvertRequest: ("invert", "")}
INPUTS[PoseRequest] = "pose", "cat.png --mesh wedge.off"
SMALL = "cat.png --size 40"
FLAT, VIEW, EXHAUSTIVE = "--preset uoctti --image-size 32x64", "--init=20,10", "--init=20,10 --method exhaustive"
CAMERA = "--intrinsics 90,90,40,30"
CASES: dict[type, dict[str, tuple[str, str]]] = {
    HogRequest: {
        "preset": ("", "--preset dpm"),
        "settings": ("", "--set cell_size=4"),
        "size": ("", "--size 40"),
    },
    GlyphRequest: {
        "preset": ("cat.png", "cat.png --preset dpm"),
        "settings": ("cat.png", "cat.png --set cell_size=4"),
        "size": ("cat.png", "cat.png --size 40"),
        "image_size": (f"flat.npy {FLAT}", "flat.npy --preset uoctti --image-size 64x32"),
        "row": (f"matrix.npy {FLAT} --row 0", f"matrix.npy {FLAT} --row 1"),
        "key": ("two.npz --preset uoctti --key a", "two.npz --preset uoctti --key b"),
    },
    InvertRequest: {
        "template": ("weights.npy --preset uoctti --quality fast", "weights.npy --preset uoctti --template"),
        "quality": (f"{SMALL} --prior none", f"{SMALL} --prior none --quality fast"),
        "method": (f"{SMALL} --preset paper", f"{SMALL} --preset paper --method paper"),
        "prior": (f"{SMALL} --quality fast", f"{SMALL} --quality fast --prior none"),
        "samples": (f"{SMALL} --preset paper", f"{SMALL} --preset paper --samples 2"),
        "seed": (f"{SMALL} --prior none --quality fast", f"{SMALL} --prior none --quality fast --seed 1"),
    },
    PoseRequest: {
        "mesh": (EXHAUSTIVE, f"{EXHAUSTIVE} --mesh other.off"),
        "up": (EXHAUSTIVE, f"{EXHAUSTIVE} --up y"),
        "front": (EXHAUSTIVE, f"{EXHAUSTIVE} --front=+x"),
        "box": (EXHAUSTIVE, f"{EXHAUSTIVE} --box 5,5,60,50"),
        "mask": (EXHAUSTIVE, f"{EXHAUSTIVE} --mask mask.png"),
        "annotations": ("--box 5,5,60,50", "--annotations list.csv"),
        "initial": (f"{VIEW} --within 30", "--init=200,10 --within 30"),
        "within": (VIEW, f"{VIEW} --within 10"),
        "focal": (EXHAUSTIVE, f"{EXHAUSTIVE} --focal 200"),
        "principal_point": (f"{EXHAUSTIVE} --focal 200", f"{EXHAUSTIVE} --focal 200 --principal-point 10,10"),
        "intrinsics": (EXHAUSTIVE, f"{EXHAUSTIVE} {CAMERA}"),
        "distortion": (f"{EXHAUSTIVE} {CAMERA}", f"{EXHAUSTIVE} {CAMERA} --distortion=-.3,.1,0,0"),
        "method": (EXHAUSTIVE, f"{VIEW} --method paper"),
        "least_confidence": (f"{VIEW} --least-confidence 0", f"{VIEW} --least-confidence 1"),
        "seed": (VIEW, f"{VIEW} --seed 1"),
        "page": (EXHAUSTIVE, f"{EXHAUSTIVE} --page"),
    },
}
"""Two commands for each field, without it and with it, or with two of its values."""


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("inputs")
    Image.fromarray(CHELSEA).save(folder / "cat.png")
    mask = np.zeros(CHELSEA.shape[:2], np.uint8)
    mask[10:50, 10:50] = 255
    Image.fromarray(mask).save(folder / "mask.png")
    described = [hog(CHELSEA[k : k + 32, :64] / 255, "uoctti").ravel() for k in (0, 20)]
    np.save(folder / "flat.npy", described[0])
    np.save(folder / "matrix.npy", np.stack(described))
    np.savez(folder / "two.npz", **{name: row.reshape(4, 8, 31) for name, row in zip("ab", described, strict=True)})
    np.save(folder / "weights.npy", (described[0] - described[1]).reshape(4, 8, 31))
    (folder / "wedge.off").write_text(WEDGE)
    (folder / "other.off").write_text(WEDGE.replace("\n0 1 2\n2 1 2", "\n0 1 1\n2 1 1"))
    (folder / "list.csv").write_text("image,x0,y0,x1,y1,azimuth,elevation\ncat.png,5,5,60,50,20,10\n")
    return folder


def run(kind: type, options: str, inputs: Path, out: Path) -> tuple[int, dict[str, Any]]:
    """The exit status, and the files without their times."""
    command, given = INPUTS[kind]
    given = given.replace("cat.png", ".") if "--annotations" in options else given
    words = [str(inputs / word) if (inputs / word).exists() else word for word in f"{given} {options}".split()]
    out.mkdir()
    target = {"hog": out / "cat.npz", "glyph": out / "cat.png"}.get(command, out / "results")
    status = main([command, *words, "-o", str(target), "--quiet"])
    return status, {str(path.relative_to(out)): _read(path) for path in out.rglob("*") if path.is_file()}


def _read(path: Path) -> object:
    if path.suffix == ".json":
        return re.sub(r'"seconds": [0-9.e-]+', "", path.read_text())
    return path.read_bytes() if path.suffix in (".png", ".npz") else "has times"


@pytest.mark.filterwarnings("ignore")  # of tiny photographs
@pytest.mark.usefixtures("two_iterations")
@pytest.mark.parametrize(("kind", "field"), [(kind, field) for kind, fields in CASES.items() for field in fields])
def test_an_option_changes_something(kind: type, field: str, inputs: Path, tmp_path: Path) -> None:
    first, second = (run(kind, text, inputs, tmp_path / str(k)) for k, text in enumerate(CASES[kind][field]))
    assert {first[0], second[0]} <= {0, 4}
    assert first != second


@pytest.mark.filterwarnings("ignore")  # of tiny photographs
@pytest.mark.parametrize("kind", CASES)
def test_the_same_options_give_the_same(kind: type, inputs: Path, tmp_path: Path) -> None:
    options = next(reversed(CASES[kind].values()))[1]
    assert run(kind, options, inputs, tmp_path / "0") == run(kind, options, inputs, tmp_path / "1")


@pytest.mark.parametrize("kind", CASES)
def test_no_option_is_forgotten(kind: type) -> None:
    covered = {field for each in kind.__mro__ for field in CASES.get(each, ())}
    assert {each.name for each in list_options(kind)} == covered


def test_a_seed_that_changes_nothing_says_so(inputs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A search from a learned prior draws no random numbers; samples and other searches do."""
    command = ["invert", str(inputs / "cat.png"), "-o", str(tmp_path / "out"), "--size", "40", "--quality", "fast"]
    for options, said in ([], False), (["--seed", "1"], True), (["--seed", "1", "--prior", "none"], False):
        assert main([*command, *options]) == 0
        assert ("--seed" in capsys.readouterr().err) == said
