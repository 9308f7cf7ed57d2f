"""Each option changes something: files, the exit status, or, where the work takes long, what would be computed."""

from __future__ import annotations

import argparse
import re
import socket
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import uvicorn
from PIL import Image

from nablahog import hog, presets
from nablahog.app import server
from nablahog.cli.commands import tables
from nablahog.cli.main import main, parser
from nablahog.io.learner import Learner
from nablahog.requests.inversion import GlyphRequest, HogRequest, InvertRequest
from nablahog.requests.options import list_options
from nablahog.requests.pose import PoseRequest

from ..paper.common import write_prior
from .common import CHELSEA, TETRAHEDRON, WEDGE

REQUESTS = {"hog": HogRequest, "glyph": GlyphRequest, "invert": InvertRequest, "pose": PoseRequest}
HOW = {"help", "output", "quiet", "workers", "cluster"}
"""Options that say how and where, not what."""
CAT, SMALL, EXHAUSTIVE = "cat.png", "cat.png --size 40", "--init=20,10 --method exhaustive"
VIEW, CHAIR = "cat.png --mesh wedge.off --init=20,10", f"cat.png --mesh wedge.off {EXHAUSTIVE}"
FLAT, CAMERA = "--preset uoctti --image-size 32x64", "--intrinsics 90,90,40,30"
LEARNED, IMAGES = "--methods uoctti-learned", "--images images"
MODELS, LIST = "--models models --objects 2 --conditions none", "two.csv"
Cases = dict[str, tuple[str, str]]


def added(words: str, **options: str) -> Cases:
    return {name: (words, f"{words} {option}") for name, option in options.items()}


CASES: dict[str, Cases] = {
    "hog": added(CAT, preset="--preset dpm", settings="--set cell_size=4", size="--size 40"),
    "glyph": {
        **added(CAT, preset="--preset dpm", settings="--set cell_size=4", size="--size 40"),
        "image_size": (f"flat.npy {FLAT}", "flat.npy --preset uoctti --image-size 64x32"),
        "row": (f"matrix.npy {FLAT} --row 0", f"matrix.npy {FLAT} --row 1"),
        "key": ("two.npz --preset uoctti --key a", "two.npz --preset uoctti --key b"),
    },
    "invert": {
        "template": ("weights.npy --preset uoctti --quality fast", "weights.npy --preset uoctti --template"),
        **added(f"{SMALL} --quality fast", prior="--prior none"),
        **added(f"{SMALL} --prior none", quality="--quality fast"),
        **added(f"{SMALL} --preset paper", method="--method paper", samples="--samples 2"),
        **added(f"{SMALL} --prior none --quality fast", seed="--seed 1"),
    },
    "pose": {
        **added(CHAIR, mesh="--mesh other.off", focal="--focal 200", intrinsics=CAMERA),
        **added(f"{CHAIR} --focal 200", principal_point="--principal-point 10,10"),
        **added(f"{CHAIR} {CAMERA}", distortion="--distortion=-.3,.1,0,0"),
        **added(f"{VIEW} --within 30", initial="--init=200,10"),
        **added(VIEW, within="--within 10", seed="--seed 1"),
        "annotations": (f"{CAT} --mesh wedge.off --box 5,5,60,50", ". --mesh wedge.off --annotations list.csv"),
        "method": (CHAIR, f"{VIEW} --method paper"),
        "least_confidence": (f"{VIEW} --least-confidence 0", f"{VIEW} --least-confidence 1"),
        **added(CHAIR, up="--up y", front="--front=+x", box="--box 5,5,60,50", mask="--mask mask.png", page="--page"),
    },
    "table1": {
        **added(LEARNED, images=IMAGES),
        **added(f"{IMAGES} {LEARNED}", seed="--seed 1", limit="--limit 1", size="--size 24"),
        **added(f"{IMAGES} {LEARNED}", max_evaluations="--max-evaluations 9", learned="--learned prior=prior.npz"),
        "methods": (f"{IMAGES} {LEARNED}", f"{IMAGES} --methods dalal-single"),
    },
    "table2": {
        **added("--objects 2 --conditions none", models="--models models"),
        **added(f"{LIST} --models models", objects="--objects 1"),
        **added(MODELS, annotations=LIST, methods="--methods paper", seed="--seed 1", unknown_model="--unknown-model"),
        **added(MODELS, viewpoints="--viewpoints views.csv", pascal3d="--pascal3d images models"),
        "conditions": (MODELS, "--models models --objects 2 --conditions no-box"),
    },
    "learn prior": {
        **added("", images=IMAGES),
        **added(IMAGES, signs="--signs unsigned", start="--start prior.npz", epochs="--epochs 3"),
    },
    "learn background": {
        **added("", images=IMAGES),
        **added(IMAGES, preset="--preset uoctti", settings="--set cell_size=4"),
    },
    "learn hoggles": {
        **added("", images=IMAGES),
        **added(IMAGES, preset="--preset vlfeat", settings="--set cell_size=6", seed="--seed 1"),
    },
    "learn bovw": {**added("", images=IMAGES), **added(IMAGES, size="--size 24", seed="--seed 1")},
    "app": added("", photos="images/0.png", host="--host localhost", port="--port 1234"),
}
"""Of each command, two ways to give it for each option: without it and with it, or with two of its values."""


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("inputs")
    for name in ("images", "models"):
        (folder / name).mkdir()
    Image.fromarray(CHELSEA).save(folder / "cat.png")
    for k in range(3):
        Image.fromarray(CHELSEA).resize((100 + k, 100)).save(folder / "images" / f"{k}.png")
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
    (folder / "models" / "a.off").write_text(TETRAHEDRON)
    (folder / "models" / "b.off").write_text(TETRAHEDRON.replace("0 0 1\n", "0 0 2\n"))
    columns, row = "image,x0,y0,x1,y1,azimuth,elevation,theta,model\n", "cat.png,5,5,60,50,{},10,0,a\n"
    (folder / "list.csv").write_text(columns + row.format(20))
    (folder / "two.csv").write_text(columns + row.format(20) + row.format(40))
    (folder / "views.csv").write_text("azimuth,elevation\n10,5\n")
    write_prior(folder / "prior.npz", presets.uoctti())
    return folder


@pytest.fixture
def computed(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What commands would compute with that take long."""
    calls: list[Any] = []

    def record(*arguments: Any, **more: Any) -> Any:
        calls.append((arguments, {name: value for name, value in more.items() if name not in HOW}))
        raise ValueError("nothing is computed")

    for name in ("run_table1", "run_table2"):
        monkeypatch.setattr(tables, name, record)
    monkeypatch.setattr(tables, "learned_from_samples", lambda kind, progress: Path(kind))
    monkeypatch.setattr(Learner, "learn_to", record)
    monkeypatch.setattr(server, "listen", lambda *where: (calls.append(where), socket.socket())[1])
    monkeypatch.setattr(server, "make_app", lambda *about: calls.append(about))
    monkeypatch.setattr(uvicorn.Server, "run", lambda self, sockets: sockets[0].close())
    return calls


def run(command: str, options: str, inputs: Path, out: Path, computed: list[Any]) -> tuple[int, str, dict[str, Any]]:
    """The exit status; what would be computed, without folders and addresses in memory; the files without times."""
    computed.clear()
    out.mkdir()
    words = [str(inputs / word) if (inputs / word).exists() else word for word in options.split()]
    target = {"hog": "cat.npz", "glyph": "cat.png"}.get(command, "model.npz" if "learn" in command else "results")
    there = [] if command == "app" else ["-o", str(out / target)]
    status = main([*command.split(), *(word.replace("=prior", f"={inputs}/prior") for word in words), *there])
    asked = re.sub("0x[0-9a-f]+", "", repr(computed).replace(str(out), ""))
    return status, asked, {str(path.relative_to(out)): _read(path) for path in out.rglob("*") if path.is_file()}


def _read(path: Path) -> object:
    if path.suffix == ".json":
        return re.sub(r'"seconds": [0-9.e-]+', "", path.read_text())
    return path.read_bytes() if path.suffix in (".png", ".npz") else "has times"


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of tiny photographs
@pytest.mark.usefixtures("two_iterations")
@pytest.mark.parametrize(("command", "option"), [(name, option) for name, cases in CASES.items() for option in cases])
def test_an_option_changes_something(
    command: str, option: str, inputs: Path, tmp_path: Path, computed: list[Any]
) -> None:
    without, changed = (
        run(command, text, inputs, tmp_path / str(k), computed) for k, text in enumerate(CASES[command][option])
    )
    assert without != changed
    if command in REQUESTS:
        assert {without[0], changed[0]} <= {0, 4}
    else:  # it came as far as to compute
        assert option == "pascal3d" or len(changed[1]) > 2


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("command", CASES)
def test_the_same_options_give_the_same(command: str, inputs: Path, tmp_path: Path, computed: list[Any]) -> None:
    options = next(reversed(CASES[command].values()))[command in REQUESTS]
    first, second = (run(command, options, inputs, tmp_path / name, computed) for name in ("first", "second"))
    assert first == second


@pytest.mark.parametrize("command", CASES)
def test_no_option_is_forgotten(command: str) -> None:
    if command in REQUESTS:
        covered = {
            field for name, kind in REQUESTS.items() if issubclass(REQUESTS[command], kind) for field in CASES[name]
        }
        assert {each.name for each in list_options(REQUESTS[command])} == covered
        return
    commands: Any = parser()
    for word in command.split():
        (choices,) = (each.choices for each in commands._actions if isinstance(each, argparse._SubParsersAction))
        commands = choices[word]
    assert {each.dest for each in commands._actions} - HOW == {*CASES[command]}


@pytest.mark.slow
def test_a_seed_that_changes_nothing_says_so(inputs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A search from a learned prior draws no random numbers; samples and other searches do."""
    command = ["invert", str(inputs / "cat.png"), "-o", str(tmp_path / "out"), "--size", "40", "--quality", "fast"]
    for options, said in ([], False), (["--seed", "1"], True), (["--seed", "1", "--prior", "none"], False):
        assert main([*command, *options]) == 0
        assert ("--seed" in capsys.readouterr().err) == said
