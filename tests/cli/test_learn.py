"""`nablahog learn prior` as people use, misuse, interrupt and kill it, and what the prior is for."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from torch import Tensor

from nablahog import LearnedPrior, presets
from nablahog.cli.commands import learn
from nablahog.cli.main import main
from nablahog.invert.network import weight_count

from .common import CHELSEA, names

ONCE = ["--epochs", "1"]
FEW = ["--max-evaluations", "3", "--size", "40"]


def _photographs(folder: Path) -> str:
    folder.mkdir()
    for k in range(3):
        Image.fromarray(CHELSEA[5 * k : 5 * k + 36, 8 * k : 8 * k + 40]).save(folder / f"{k}.png")
    return str(folder)


@pytest.fixture
def images(tmp_path: Path) -> str:
    """Three small photographs."""
    return _photographs(tmp_path / "images")


@pytest.fixture(scope="module")
def prior(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The file that the command writes."""
    folder = tmp_path_factory.mktemp("learned")
    path = folder / "prior.npz"
    assert main(["learn", "prior", "--images", _photographs(folder / "images"), "-o", str(path), *ONCE]) == 0
    return str(path)


def test_learning(tmp_path: Path, images: str, capsys: pytest.CaptureFixture[str]) -> None:
    Image.fromarray(CHELSEA[:20]).save(Path(images, "low.png"))
    Path(images, "x.png").write_bytes(b"no image")
    Path(images, "notes.txt").touch()
    out = tmp_path / "new" / "prior.npz"
    options = ["--cell", "4", "--seed", "3", "--epochs", "2", "--threads", "1"]
    assert main(["learn", "prior", "--images", images, "-o", str(out), *options]) == 0
    prior = LearnedPrior.load(out)
    assert prior.spec == presets.uoctti(4)
    assert prior.training.images == ("0.png", "1.png", "2.png")
    assert (prior.training.epochs, prior.training.seed, len(prior.training.losses)) == (2, 3, 2)
    assert len(prior.weights) == weight_count(prior.spec, prior.architecture)
    printed = capsys.readouterr()
    assert printed.err == ""
    assert printed.out.splitlines() == [
        "Passed over: x.png: expected an image, got a file of no format that Pillow reads",
        "Passed over: low.png: expected at least 32x32 pixels, got 20x80",
        "Passed over, as no images by their endings: notes.txt",
        f"Learned prior in {out}: 3 images, 2 epochs, last loss {prior.training.losses[-1]:.4f}, "
        f"{len(prior.weights):,} weights",
    ]
    assert names(tmp_path / "new") == ["prior.npz"]


def test_the_photographs_of_scikit_image(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shapes = {}

    def learn(images: dict[str, Tensor], *args: object, **options: object) -> None:
        shapes.update({name: tuple(image.shape) for name, image in images.items()})
        raise KeyboardInterrupt

    monkeypatch.setattr(learn, "train_prior", learn)
    assert main(["learn", "prior", "-o", str(tmp_path / "p.npz"), "--size", "100"]) == 130
    assert len(shapes) == 8
    assert shapes["coffee"] == (67, 100)  # whole


def test_inverting_with_it(
    tmp_path: Path, photo: str, descriptor: str, prior: str, capsys: pytest.CaptureFixture[str]
) -> None:
    made = []
    for number, options in enumerate(([], ["--prior", prior])):
        out = tmp_path / f"out{number}"
        capsys.readouterr()
        assert main(["invert", photo, descriptor, "-o", str(out), *FEW, *options]) == 0
        assert capsys.readouterr().err == ""
        made.append([(out / f"{stem}_preimage.png").read_bytes() for stem in ("cat", "stored")])
    assert all(learned != plain for plain, learned in zip(made[0], made[1], strict=True))
    results = json.loads((tmp_path / "out1" / "results.json").read_text())
    assert all(0 < result["distance"] < 1 for result in results)


def test_the_table_with_it(tmp_path: Path, images: str, prior: str, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["table1", "--images", images, "-o", str(tmp_path / "out"), *FEW, "--workers", "1", "--limit", "1"]
    assert main([*command, "--prior", prior, "--methods", "uoctti-learned"]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    assert "left out" not in printed.out
    remark = "The prior file was learned from images of the same names as 1 of these"
    html = (tmp_path / "out" / "index.html").read_text()
    assert remark in printed.out
    assert remark in html
    assert "uoctti-learned" in html
    assert len(names(tmp_path / "out" / "work" / "uoctti-learned")) == 1


@pytest.mark.usefixtures("here")
def test_the_table_without_it(
    tmp_path: Path, images: str, learned_files: dict[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    others = [option for kind, path in learned_files.items() for option in (f"--{kind}", path)]
    command = ["table1", "--images", images, "-o", str(tmp_path / "out"), *FEW, "--limit", "1"]
    assert main([*command, *others]) == 0
    remark = "uoctti-learned is left out: it needs --prior FILE, see `nablahog learn prior`."
    assert remark in capsys.readouterr().out.splitlines()
    assert remark in (tmp_path / "out" / "index.html").read_text()
    assert "uoctti-learned" not in names(tmp_path / "out" / "work")
    assert main([*command, "--methods", "dalal-single"]) == 0
    assert remark not in capsys.readouterr().out  # nobody asked for it


def test_the_table_asked_for_it_without_a_prior(tmp_path: Path, images: str, refused: Callable[..., None]) -> None:
    options = ["--methods", "uoctti-single,uoctti-learned"]
    message = "uoctti-learned needs --prior FILE, see `nablahog learn prior`"
    refused("table1", "--images", images, "-o", str(tmp_path / "out"), *options, message=message)


def test_priors_that_do_not_fit(tmp_path: Path, photo: str, prior: str, refused: Callable[..., None]) -> None:
    options = ["-o", str(tmp_path / "out"), "--prior", prior]
    refused("invert", photo, *options, "--cell", "4", message=f"{photo}: the prior was learned for another spec: its ")
    refused("invert", photo, *options, "--descriptor", "paper", message="for another spec")
    refused("invert", photo, *options, "--vote", "hard", message="its vote is 'linear', the uoctti descriptor's 'hard'")


def test_priors_for_other_cells(
    tmp_path: Path, images: str, photo: str, descriptor: str, refused: Callable[..., None]
) -> None:
    other = tmp_path / "other.npz"
    assert main(["learn", "prior", "--images", images, "-o", str(other), *ONCE, "--cell", "2"]) == 0
    options = ["-o", str(tmp_path / "out"), "--prior", str(other)]
    message = "the prior was learned for another spec: its cell_size is (2, 2), the uoctti descriptor's (8, 8)"
    refused("invert", descriptor, *options, message=f"{descriptor}: {message}")
    refused("table1", "--images", images, *options, message=f"uoctti-learned: {message}")


def test_damaged_priors(tmp_path: Path, images: str, photo: str, prior: str, refused: Callable[..., None]) -> None:
    whole = Path(prior).read_bytes()
    bad = tmp_path / "bad.npz"
    options = ["-o", str(tmp_path / "out"), "--prior", str(bad)]
    refused("invert", photo, *options, message=f"{bad}: no such file")
    refused("table1", "--images", images, *options, message=f"{bad}: no such file")
    for content, message in [
        (whole[: len(whole) // 2], "expected a learned prior (.npz), but it cannot be read"),
        (whole[:10_000] + b"\xff" * 100 + whole[10_100:], "the archive is damaged"),
        (b"hello", "expected a learned prior (.npz)"),
    ]:
        bad.write_bytes(content)
        refused("invert", photo, *options, message=f"{bad}: {message}")
        refused("table1", "--images", images, *options, message=f"{bad}: {message}")
    np.savez(bad, format=np.array([{}], dtype=object))
    refused("invert", photo, *options, message="expected a learned prior, but the archive lacks spec, widths")


def test_bad_inputs(tmp_path: Path, images: str, refused: Callable[..., None]) -> None:
    to = ["-o", str(tmp_path / "out" / "prior.npz")]
    empty = tmp_path / "empty"
    empty.mkdir()
    refused("learn", "prior", "--images", f"{images}x", *to, message=f"{images}x: no such folder")
    refused("learn", "prior", "--images", str(empty), *to, message="expected a folder of images, but it holds none")
    message = f"{images}: no image is usable; the first: 0.png: expected at least 32x32 pixels, got 18x20"
    refused("learn", "prior", "--images", images, *to, "--size", "20", message=message)
    refused("learn", "prior", "--images", images, *to, "--cell", "32", message="pixels only, got 32x32")
    refused("learn", "prior", "--images", images, *to, "--cell", "8x4", message="pixels only, got 8x4")
    refused("learn", "prior", "--images", images, *to, "--descriptor", "paper", message="for signed gradients only")
    (empty / "x.npz").mkdir()
    for output in ("prior", "prior.png", "empty", "empty/x.npz"):
        refused(
            "learn", "prior", "--images", images, "-o", str(tmp_path / output), message="a prior is one file: expected"
        )
    refused("learn", "prior", "--images", images, "-o", f"{images}/0.png/p.npz", message="is not a folder")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--epochs", "0"], "at least 1, got '0'"),
        (["--threads", "100000"], "at most 1024, got '100000'"),
        (["--seed", "x"], "got 'x'"),
        (["--vote", "soft"], "invalid choice: 'soft'"),
    ],
)
def test_bad_options(tmp_path: Path, refused: Callable[..., None], options: list[str], message: str) -> None:
    refused("learn", "prior", "-o", str(tmp_path / "p.npz"), *options, message=message, status=2)


def test_no_kind(refused: Callable[..., None]) -> None:
    refused("learn", message="the following arguments are required: WHAT", status=2)
    refused("learn", "poses", message="invalid choice: 'poses'", status=2)


def test_checkpoints_of_another_training(tmp_path: Path, images: str, refused: Callable[..., None]) -> None:
    output = tmp_path / "p.npz"
    kept = tmp_path / "p.npz.checkpoint"
    kept.write_bytes(b"hello")
    command = ["learn", "prior", "--images", images, "-o", str(output), *ONCE]
    refused(*command, message=f"{kept}: expected a checkpoint of a training")
    assert kept.read_bytes() == b"hello"


def test_interrupted_and_repeated(tmp_path: Path, images: str, monkeypatch: pytest.MonkeyPatch) -> None:
    command = ["learn", "prior", "--images", images, "--epochs", "3", "-o"]
    assert main([*command, str(tmp_path / "undisturbed.npz")]) == 0

    def stop(done: int, total: int, what: str) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(learn, "counter", lambda name: nullcontext(stop))
        assert main([*command, str(tmp_path / "p.npz")]) == 130
    assert names(tmp_path) == ["images", "p.npz.checkpoint", "undisturbed.npz"]
    assert _epochs(tmp_path / "p.npz.checkpoint") == 2
    assert main([*command, str(tmp_path / "p.npz")]) == 0
    assert names(tmp_path) == ["images", "p.npz", "undisturbed.npz"]
    _check_same(tmp_path / "p.npz", tmp_path / "undisturbed.npz")


@contextmanager
def _started(command: list[str], checkpoint: Path) -> Iterator[subprocess.Popen[str]]:
    """The command as a process, once it has kept an epoch since."""
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
    kept = tmp_path / "out" / "p.npz.checkpoint"
    command = [*options, "-o", str(out)]
    with _started(command, kept) as process:
        process.send_signal(signal.SIGINT)
        error = process.communicate(timeout=60)[1]
    assert (process.returncode, error) == (130, "nablahog learn prior: error: interrupted\n")
    assert names(tmp_path / "out") == ["p.npz.checkpoint"]
    epochs = _epochs(kept)
    with _started(command, kept) as process:
        process.kill()
        process.wait()
    assert process.returncode == -signal.SIGKILL
    assert not out.exists()
    assert 0 < epochs < _epochs(kept) < 12

    assert main(command) == 0
    assert main([*options, "-o", str(undisturbed)]) == 0
    assert not kept.exists()
    assert os.listdir(undisturbed.parent) == ["p.npz"]
    _check_same(out, undisturbed)


def _check_same(*files: Path) -> None:
    found, expected = map(LearnedPrior.load, files)
    assert torch.equal(found.weights, expected.weights)
    assert found.training == expected.training


def _epochs(checkpoint: Path) -> int:
    with np.load(checkpoint, allow_pickle=False) as archive:
        return len(archive["losses"])
