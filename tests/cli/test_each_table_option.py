"""Each option of the tables, of learning and of the page changes what is computed; the computing itself is left out."""

from __future__ import annotations

import argparse
import re
import socket
from pathlib import Path
from typing import Any

import pytest
import uvicorn
from PIL import Image

from nablahog import presets
from nablahog.app import server
from nablahog.cli.commands import tables
from nablahog.cli.main import main, parser
from nablahog.io.learner import Learner

from ..paper.common import write_prior
from .common import CHELSEA

HOW = {"help", "output", "quiet", "workers", "cluster"}
"""Options that say how and where, not what."""
LEARNED, SMALL = "--methods uoctti-learned", "--images images --methods uoctti-learned"
MODELS, CSV = "--models models --objects 2 --conditions none", "own/list.csv"
CASES: dict[str, dict[str, tuple[str, str]]] = {
    "table1": {
        "images": (LEARNED, f"{LEARNED} --images images"),
        "methods": (SMALL, "--images images --methods dalal-single"),
        "seed": (SMALL, f"{SMALL} --seed 1"),
        "limit": (SMALL, f"{SMALL} --limit 1"),
        "size": (SMALL, f"{SMALL} --size 24"),
        "max_evaluations": (SMALL, f"{SMALL} --max-evaluations 9"),
        "learned": (SMALL, f"{SMALL} --learned prior=prior.npz"),
    },
    "table2": {
        "annotations": (MODELS, f"{CSV} {MODELS}"),
        "methods": (MODELS, f"{MODELS} --methods paper"),
        "seed": (MODELS, f"{MODELS} --seed 1"),
        "objects": (f"{CSV} --models models", f"{CSV} --models models --objects 1"),
        "models": ("--objects 2 --conditions none", MODELS),
        "unknown_model": (MODELS, f"{MODELS} --unknown-model"),
        "conditions": (MODELS, "--models models --objects 2 --conditions no-box"),
        "viewpoints": (MODELS, f"{MODELS} --viewpoints views.csv"),
        "pascal3d": (MODELS, f"{MODELS} --pascal3d images models"),
    },
    "learn prior": {
        "images": ("", "--images images"),
        "signs": ("--images images", "--images images --signs unsigned"),
        "start": ("--images images", "--images images --start prior.npz"),
        "epochs": ("--images images", "--images images --epochs 3"),
    },
    "learn background": {
        "images": ("", "--images images"),
        "preset": ("--images images", "--images images --preset uoctti"),
        "settings": ("--images images", "--images images --set cell_size=4"),
    },
    "learn hoggles": {
        "images": ("", "--images images"),
        "preset": ("--images images", "--images images --preset vlfeat"),
        "settings": ("--images images", "--images images --set cell_size=6"),
        "seed": ("--images images", "--images images --seed 1"),
    },
    "learn bovw": {
        "images": ("", "--images images"),
        "size": ("--images images", "--images images --size 24"),
        "seed": ("--images images", "--images images --seed 1"),
    },
    "app": {
        "photos": ("", "images/0.png"),
        "host": ("", "--host localhost"),
        "port": ("", "--port 1234"),
    },
}
"""Two commands for each option, without it and with it."""


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("inputs")
    for name in ("images", "models", "own"):
        (folder / name).mkdir()
    for k in range(3):
        Image.fromarray(CHELSEA).resize((100 + k, 100)).save(folder / "images" / f"{k}.png")
    for name, height in (("a", 1), ("b", 2)):
        faces = "3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n"
        (folder / "models" / f"{name}.off").write_text(f"OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 {height}\n{faces}")
    Image.fromarray(CHELSEA).save(folder / "own" / "cat.png")
    row = "cat.png,5,5,60,50,{},10,0,a\n"
    (folder / "own" / "list.csv").write_text(
        "image,x0,y0,x1,y1,azimuth,elevation,theta,model\n" + row.format(20) + row.format(40)
    )
    (folder / "views.csv").write_text("azimuth,elevation\n10,5\n")
    write_prior(folder / "prior.npz", presets.uoctti())
    return folder


@pytest.fixture
def computed(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What commands would compute with."""
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


def run(command: str, options: str, inputs: Path, out: Path, computed: list[Any]) -> tuple[int, str]:
    """The exit status, and what the command computes with, without the folder of results and addresses in memory."""
    computed.clear()
    words = [str(inputs / word) if (inputs / word).exists() else word for word in options.split()]
    target = [] if command == "app" else ["-o", str(out / ("model.npz" if "learn" in command else "results"))]
    status = main([*command.split(), *(word.replace("=prior", f"={inputs}/prior") for word in words), *target])
    return status, re.sub("0x[0-9a-f]+", "", repr(computed).replace(str(out), ""))


@pytest.mark.parametrize(("command", "option"), [(name, option) for name, cases in CASES.items() for option in cases])
def test_an_option_changes_something(
    command: str, option: str, inputs: Path, tmp_path: Path, computed: list[Any]
) -> None:
    without, changed = (
        run(command, text, inputs, tmp_path / str(k), computed) for k, text in enumerate(CASES[command][option])
    )
    assert without != changed
    assert (command, option) == ("table2", "pascal3d") or len(changed[1]) > 2  # it came as far as to compute


@pytest.mark.parametrize("command", [*CASES])
def test_the_same_options_ask_for_the_same(command: str, inputs: Path, tmp_path: Path, computed: list[Any]) -> None:
    options = next(reversed(CASES[command].values()))[0]
    first, second = (run(command, options, inputs, tmp_path / name, computed) for name in ("first", "second"))
    assert first == second


@pytest.mark.parametrize("command", [*CASES])
def test_no_option_is_forgotten(command: str) -> None:
    commands: Any = parser()
    for word in command.split():
        (choices,) = (each.choices for each in commands._actions if isinstance(each, argparse._SubParsersAction))
        commands = choices[word]
    assert {each.dest for each in commands._actions} - HOW == {*CASES[command]}
