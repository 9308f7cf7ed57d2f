"""`nablahog learn` as people use, misuse, interrupt and kill it."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from torch import Tensor

from nablahog import LearnedPrior, presets
from nablahog.cli.arguments.learn import KINDS
from nablahog.cli.commands import learn
from nablahog.cli.main import main
from nablahog.invert.provenance import digest_of_weights
from nablahog.paper.learned import LEARNED
from nablahog.paper.photographs import read_folder
from nablahog.pose.background import learn_background
from nablahog.pose.whitening import Background

from ...io.archives import arrays_of
from ..common import CHELSEA, names

CELL = ["--cell", "4"]
OPTIONS = {
    "prior": ["--seed", "3", "--epochs", "2", "--threads", "1"],
    "background": [*CELL, "--order", "3"],
    "hoggles": [*CELL, "--seed", "3"],
    "bovw": ["--seed", "3"],
    "viewpoints": ["--seed", "3", "--scenes", "1", "--epochs", "2"],
}
SUMMARIES = {
    "prior": r"Prior in OUT: 3 images, 2 epochs, last loss \d\.\d{4}, [\d,]+ weights",
    "background": "Background in OUT: 3 images, 9 channels, templates of up to 4x4 cells",
    "hoggles": "Dictionary in OUT: 20 pairs of atoms, 3 images",
    "bovw": r"Vocabulary in OUT: \d words, 3 images",
    "viewpoints": r"Viewpoint prior in OUT: 250 scenes, 2 epochs, last loss \d\.\d{4}",
}
LEAST = {
    "prior": "32x32",
    "background": "24x24",
    "hoggles": "28x28",
}  # pixels of an image, for cells of 4

FEW: dict[str, dict[str, Any]] = {
    "hoggles": {"atoms": 20, "iterations": 7},
    "bovw": {"words": 3},
}  # of cells of 4

every_kind = pytest.mark.parametrize("kind", KINDS)


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Dictionaries of a few atoms, and few words."""
    for kind, few in FEW.items():
        learner = LEARNED[kind]
        monkeypatch.setitem(LEARNED, kind, replace(learner, learn=partial(learner.learn, **few)))


def test_every_kind_has_arguments_and_a_learner() -> None:
    others = {"unsigned-prior"}  # is learned as the other prior is, of another preset
    assert set(KINDS) == {*LEARNED, "background", "viewpoints"} - others


@every_kind
def test_learning(tmp_path: Path, images: str, kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path(images, "x.png").write_bytes(b"no image")
    Path(images, "notes.txt").touch()
    if kind in LEAST:
        Image.fromarray(CHELSEA[:20]).save(Path(images, "low.png"))
    out = tmp_path / "new" / "model.npz"
    assert main(["learn", kind, "--images", images, "-o", str(out), *OPTIONS[kind]]) == 0
    *passed_over, summary = _printed(capsys)
    low = [f"Passed over: low.png: expected at least {LEAST[kind]} pixels, got 20x80"] if kind in LEAST else []
    assert passed_over == [
        "Passed over: x.png: expected an image, got a file of no format that Pillow reads",
        *low,
        "Passed over, as no images by their endings: notes.txt",
    ]
    assert re.fullmatch(SUMMARIES[kind].replace("OUT", re.escape(str(out))), summary)
    assert names(out.parent) == [out.name]
    if kind in ("background", "viewpoints"):
        return
    model: Any = LEARNED[kind].model.load(out)
    assert (model.learning.images, model.learning.seed) == (("0.png", "1.png", "2.png"), 3)
    assert kind == "bovw" or model.spec == presets.uoctti(8 if kind == "prior" else 4)


def _printed(capsys: pytest.CaptureFixture[str]) -> list[str]:
    printed = capsys.readouterr()
    assert printed.err == ""
    return printed.out.splitlines()


def test_a_prior(tmp_path: Path, images: str) -> None:
    out = tmp_path / "p.npz"
    assert main(["learn", "prior", "--images", images, "-o", str(out), *OPTIONS["prior"]]) == 0
    prior = LearnedPrior.load(out)
    assert (prior.learning.epochs, len(prior.learning.losses)) == (2, 2)


def test_going_on_from_a_prior(tmp_path: Path, images: str, refused: Callable[..., None]) -> None:
    start, out = tmp_path / "start.npz", tmp_path / "p.npz"
    options = ["--images", images, *OPTIONS["prior"]]
    assert main(["learn", "prior", *options, "-o", str(start)]) == 0
    assert main(["learn", "prior", *options, "-o", str(out), "--start", str(start)]) == 0
    assert LearnedPrior.load(out).learning.start == digest_of_weights(LearnedPrior.load(start).weights)
    refused("learn", "prior", *options, "-o", str(out), "--start", "none.npz", message="none.npz: no such file")
    unsigned = [*options, "--signs", "unsigned", "-o", str(out), "--start", str(start)]
    refused("learn", "prior", *unsigned, message="was learned for signed descriptors, a paper descriptor is unsigned")


def test_a_background(tmp_path: Path, images: str) -> None:
    out = tmp_path / "b.npz"
    assert main(["learn", "background", "--images", images, "-o", str(out), *OPTIONS["background"]]) == 0
    background = Background.load(out)
    assert (background.spec, background.order) == (presets.aubry(4), 3)
    expected = learn_background(read_folder(Path(images), size=0).images, presets.aubry(4), order=3)
    assert torch.equal(background.covariance, expected.covariance)


@pytest.mark.parametrize(
    ("options", "spec"),
    [
        (["--descriptor", "uoctti"], presets.uoctti(4)),
        (["--vote", "hard"], presets.aubry(4, vote="hard")),
        (["--cell", "4x5"], presets.aubry((4, 5))),
    ],
)
def test_other_descriptors(tmp_path: Path, images: str, options: list[str], spec: object) -> None:
    out = tmp_path / "b.npz"
    command = ["learn", "background", "--images", images, "-o", str(out), *OPTIONS["background"]]
    assert main([*command, *options]) == 0
    assert Background.load(out).spec == spec


def test_random_windows_as_atoms(tmp_path: Path, images: str) -> None:
    out = tmp_path / "h.npz"
    assert main(["learn", "hoggles", "--images", images, "-o", str(out), "--fast", *CELL]) == 0
    pair: Any = LEARNED["hoggles"].model.load(out)
    assert pair.learning.iterations == 0


def test_the_photographs_of_scikit_image(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shapes: dict[str, dict[str, tuple[int, ...]]] = {}

    def stop(images: dict[str, Tensor], *args: object, kind: str, **options: object) -> None:
        shapes[kind] = {name: tuple(image.shape) for name, image in images.items()}
        raise KeyboardInterrupt

    kinds = {*LEARNED} & {*KINDS}
    for kind in kinds:
        monkeypatch.setitem(LEARNED, kind, replace(LEARNED[kind], learn=partial(stop, kind=kind)))
        assert main(["learn", kind, "-o", str(tmp_path / "p.npz"), "--size", "100"]) == 130
    for kind in kinds - {"bovw"}:
        assert len(shapes[kind]) == 8
        assert shapes[kind]["coffee"] == (67, 100)  # whole
    assert set(shapes["bovw"].values()) == {(128, 128)}


def test_a_background_of_the_photographs_of_scikit_image(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["learn", "background", "-o", str(tmp_path / "b.npz"), "--size", "60", *OPTIONS["background"]]) == 0
    assert "8 images, 9 channels" in capsys.readouterr().out


@every_kind
def test_bad_inputs(tmp_path: Path, images: str, kind: str, refused: Callable[..., None]) -> None:
    command = ["learn", kind, "--images"]
    to = ["-o", str(tmp_path / "out" / "x.npz")]
    empty = tmp_path / "empty"
    empty.mkdir()
    refused(*command, f"{images}x", *to, message=f"{images}x: no such folder")
    refused(*command, str(empty), *to, message="expected a folder of images, but it holds none")
    (empty / "x.npz").mkdir()
    for output in ("x", "x.png", "empty", "empty/x.npz"):
        noun = SUMMARIES[kind].split(" in OUT")[0].lower()
        message = f"a {noun} is one file: expected -o FILE.npz, got {tmp_path / output}"
        refused(*command, images, "-o", str(tmp_path / output), message=message)
    refused(*command, images, "-o", f"{images}/0.png/x.npz", *OPTIONS[kind], message="is not a folder")
    refused(*command, images, *to, *OPTIONS[kind], "--size", "x", message="got 'x'", status=2)


SMALL = {
    "prior": (["--size", "20"], "0.png: expected at least 32x32 pixels, got 17x20"),
    "background": ([], "0.png: expected at least 96x96 pixels, got 40x48"),
    "hoggles": ([], "0.png: expected at least 56x56 pixels, got 40x48"),
}


@pytest.mark.parametrize("kind", SMALL)
def test_too_small_images(tmp_path: Path, images: str, kind: str, refused: Callable[..., None]) -> None:
    options, message = SMALL[kind]
    command = ["learn", kind, "--images", images, "-o", str(tmp_path / "x.npz"), *options]
    refused(*command, message=f"{images}: no image is usable; the first: {message}")


@pytest.mark.parametrize(
    ("kind", "options", "message"),
    [
        ("background", ["--descriptor", "paper"], "locally normalised descriptors only"),
        ("bovw", ["--size", "20"], "windows of 32x32 pixels"),
    ],
)
def test_what_cannot_be_learned(
    tmp_path: Path, images: str, refused: Callable[..., None], kind: str, options: list[str], message: str
) -> None:
    refused("learn", kind, "--images", images, "-o", str(tmp_path / "x.npz"), *options, message=message)


@pytest.mark.parametrize(
    ("kind", "options", "message"),
    [
        ("prior", ["--epochs", "0"], "at least 1, got '0'"),
        ("prior", ["--signs", "both"], "invalid choice: 'both'"),
        ("prior", ["--threads", "100000"], "at most 1024, got '100000'"),
        ("prior", ["--seed", "x"], "got 'x'"),
        ("prior", ["--precision", "half"], "invalid choice: 'half'"),
        ("background", ["--order", "101"], "at most 100, got '101'"),
    ],
)
def test_bad_options(tmp_path: Path, refused: Callable[..., None], kind: str, options: list[str], message: str) -> None:
    refused("learn", kind, "-o", str(tmp_path / "p.npz"), *options, message=message, status=2)


def test_no_kind(refused: Callable[..., None]) -> None:
    refused("learn", message="the following arguments are required: WHAT", status=2)
    refused("learn", "poses", message="invalid choice: 'poses'", status=2)


# --- interrupted

RESUMED = {
    "prior": (["--epochs", "3"], 2, "losses", "training"),
}  # options, steps before the interruption, an array of the checkpoint, what it is of


@pytest.mark.parametrize("kind", RESUMED)
def test_damaged_checkpoints(tmp_path: Path, images: str, kind: str, caplog: pytest.LogCaptureFixture) -> None:
    checkpoint = tmp_path / "x.npz.checkpoint"
    checkpoint.write_bytes(b"hello")
    options, _, _, what = RESUMED[kind]
    assert main(["learn", kind, "--images", images, "-o", str(tmp_path / "x.npz"), *options]) == 0
    assert f"{checkpoint} is damaged: it is now called {checkpoint.name}.damaged, and the {what} " in caplog.text
    assert names(tmp_path) == ["images", "x.npz", "x.npz.checkpoint.damaged"]


@pytest.mark.parametrize("kind", RESUMED)
def test_interrupted_and_repeated(
    tmp_path: Path, images: str, kind: str, monkeypatch: pytest.MonkeyPatch, refused: Callable[..., None]
) -> None:
    options, steps, array, what = RESUMED[kind]
    command = ["learn", kind, "--images", images, *options, "-o"]
    out, undisturbed = tmp_path / "x.npz", tmp_path / "undisturbed.npz"
    assert main([*command, str(undisturbed)]) == 0

    def stop(done: int, total: int, what: str) -> None:
        if done == steps:
            raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(learn, "counter", lambda name: nullcontext(stop))
        assert main([*command, str(out)]) == 130
    assert names(tmp_path) == ["images", "undisturbed.npz", "x.npz.checkpoint"]
    assert len(arrays_of(tmp_path / "x.npz.checkpoint")[array]) == 2
    refused(*command, str(out), "--seed", "1", message=f"{out}.checkpoint: the checkpoint of another {what}")
    assert main([*command, str(out)]) == 0
    assert names(tmp_path) == ["images", "undisturbed.npz", "x.npz"]
    _check_same(out, undisturbed)


def _check_same(*files: Path) -> None:
    arrays, expected = map(arrays_of, files)
    assert set(arrays) == set(expected)
    for name, array in arrays.items():
        np.testing.assert_array_equal(array, expected[name])


@contextmanager
def _started(command: list[str], checkpoint: Path) -> Iterator[subprocess.Popen[str]]:
    """The command as a process, once it has saved an epoch since."""
    before = _written(checkpoint)
    # a test run in the background may have told its children to ignore interrupts
    program = "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); " + (
        "from nablahog.cli.main import main; sys.exit(main())"
    )
    started = [sys.executable, "-c", program, *command]
    with subprocess.Popen(started, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as process:
        try:
            while _written(checkpoint) == before and process.poll() is None:
                time.sleep(0.005)
            yield process
        finally:
            process.kill()


def _written(path: Path) -> int:
    return path.stat().st_mtime_ns if path.exists() else 0


@pytest.mark.slow
def test_interrupted_killed_and_repeated(tmp_path: Path, images: str) -> None:
    """Ctrl-C, `kill -9`, and a third run that ends: the prior of a run that was never disturbed."""
    options = ["learn", "prior", "--images", images, "--threads", "1", "--epochs", "12"]
    out, undisturbed = tmp_path / "out" / "p.npz", tmp_path / "undisturbed" / "p.npz"
    checkpoint = tmp_path / "out" / "p.npz.checkpoint"
    command = [*options, "-o", str(out)]
    with _started(command, checkpoint) as process:
        process.send_signal(signal.SIGINT)
        error = process.communicate(timeout=60)[1]
    assert (process.returncode, error) == (130, "nablahog learn prior: error: interrupted\n")
    assert names(tmp_path / "out") == ["p.npz.checkpoint"]
    epochs = len(arrays_of(checkpoint)["losses"])
    with _started(command, checkpoint) as process:
        process.kill()
        process.wait()
    assert process.returncode == -signal.SIGKILL
    assert not out.exists()
    assert 0 < epochs < len(arrays_of(checkpoint)["losses"]) < 12

    assert main(command) == 0
    assert main([*options, "-o", str(undisturbed)]) == 0
    assert not checkpoint.exists()
    assert os.listdir(undisturbed.parent) == ["p.npz"]
    _check_same(out, undisturbed)
