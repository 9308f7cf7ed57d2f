"""`nablahog learn` as people use, misuse and interrupt it."""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import nullcontext
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
from nablahog.cli.arguments.parsers import KINDS, TRAINING_SIZE
from nablahog.cli.commands import learn
from nablahog.cli.main import main
from nablahog.invert.prior.provenance import digest_of_weights
from nablahog.invert.prior.signed_network import Architecture
from nablahog.paper.learned import LEARNED
from nablahog.pose.whitening import Background

from ...io.archives import arrays_of
from ..common import CHELSEA, names

CELL = ["--set", "cell_size=4"]
OPTIONS = {
    "prior": ["--epochs", "1"],
    "background": ["--preset", "uoctti", "--set", "cell_size=2x3", "--set", "vote=hard"],
    "hoggles": [*CELL, "--seed", "3"],
    "bovw": ["--seed", "3"],
}
SUMMARIES = {
    "prior": r"Prior in OUT: 3 images, 1 epoch, last loss \d\.\d{4}, [\d,]+ weights",
    "background": r"Background in OUT: 3 images, 31 channels, templates of up to \d+x\d+ cells",
    "hoggles": "Dictionary in OUT: 20 pairs of atoms, 3 images",
    "bovw": r"Vocabulary in OUT: \d words, 3 images",
}
every_kind = pytest.mark.parametrize("kind", KINDS)


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tiny network, a dictionary of a few atoms, and few words."""
    tiny: dict[str, dict[str, Any]] = {"prior": {"architecture": Architecture((4, 4, 4), (0, 0, 0))}}
    for kind, few in {**tiny, "hoggles": {"atoms": 20, "iterations": 7}, "bovw": {"words": 3}}.items():
        learner = LEARNED[kind]
        monkeypatch.setitem(LEARNED, kind, replace(learner, learn=partial(learner.learn, **few)))


@pytest.mark.slow
@every_kind
def test_learning(tmp_path: Path, images: str, kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path(images, "x.png").write_bytes(b"no image")
    Path(images, "notes.txt").touch()
    if kind != "bovw":
        Image.fromarray(CHELSEA[:20]).save(Path(images, "low.png"))
    out = tmp_path / "new" / "model.npz"
    assert main(["learn", kind, "--images", images, "-o", str(out), *OPTIONS[kind]]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    *passed_over, summary = printed.out.splitlines()
    assert passed_over[0].startswith("Skipped: x.png: expected an image")
    assert kind == "bovw" or passed_over[1].startswith("Skipped: low.png: expected at least ")
    assert passed_over[-1] == "Skipped, because their names do not end like those of images: notes.txt"
    assert re.fullmatch(SUMMARIES[kind].replace("OUT", re.escape(str(out))), summary)
    assert names(out.parent) == [out.name]
    if kind == "background":
        assert Background.load(out).spec == presets.uoctti((2, 3), vote="hard")
    else:
        model: Any = LEARNED[kind].model.load(out)
        assert model.learning.images == ("0.png", "1.png", "2.png")
        assert kind == "bovw" or model.spec == presets.uoctti(8 if kind == "prior" else 4)


@pytest.mark.slow
def test_going_on_from_a_prior(tmp_path: Path, images: str, refused: Callable[..., None]) -> None:
    start, out = tmp_path / "start.npz", tmp_path / "p.npz"
    options = ["--images", images, "--epochs", "1"]
    assert main(["learn", "prior", *options, "-o", str(start)]) == 0
    assert main(["learn", "prior", *options, "-o", str(out), "--start", str(start)]) == 0
    assert LearnedPrior.load(out).learning.start == digest_of_weights(LearnedPrior.load(start).weights)
    unsigned = [*options, "--signs", "unsigned", "-o", str(out), "--start", str(start)]
    refused("learn", "prior", *unsigned, message="is for signed descriptors, but a paper descriptor is unsigned")


def test_the_photographs_of_scikit_image(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shapes: dict[str, dict[str, tuple[int, ...]]] = {}

    def stop(images: dict[str, Tensor], *args: object, kind: str, **options: object) -> None:
        shapes[kind] = {name: tuple(image.shape) for name, image in images.items()}
        raise KeyboardInterrupt

    for kind in ("hoggles", "bovw"):
        monkeypatch.setitem(LEARNED, kind, replace(LEARNED[kind], learn=partial(stop, kind=kind)))
        assert main(["learn", kind, "-o", str(tmp_path / "p.npz")]) == 130
    assert len(shapes["hoggles"]) == 8
    assert max(shapes["hoggles"]["coffee"]) == TRAINING_SIZE
    assert set(shapes["bovw"].values()) == {(128, 128)}


def test_what_cannot_be_learned(
    tmp_path: Path, images: str, refused: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("images.npz").mkdir()
    for status, message, words in (
        (1, "no image is usable; the first: 0.png: expected at least 96x96 pixels, got 40x48", "background"),
        (1, "a locally normalised descriptor", "background --preset paper"),
        (1, "windows of 32x32 pixels", "bovw --size 20"),
        (2, "uoctti has no parameter 'a'", "hoggles --set a=b"),
        (2, "invalid choice: 'poses'", "poses"),
        (1, "none: no such folder", "prior --images none"),
        (2, "a prior is one file: expected -o FILE.npz", "prior -o x.png"),
        (2, "a vocabulary is one file: expected -o FILE.npz", "bovw -o images.npz"),
        (1, "is not a folder", "hoggles --set cell_size=4 -o images/0.png/x.npz"),
    ):
        kind, *options = words.split()
        refused("learn", kind, "--images", images, "-o", "x.npz", *options, message=message, status=status)


@pytest.mark.slow
def test_interrupted_and_repeated(
    tmp_path: Path, images: str, monkeypatch: pytest.MonkeyPatch, refused: Callable[..., None]
) -> None:
    command = ["learn", "prior", "--images", images, "--epochs", "2", "-o"]
    out, undisturbed, checkpoint = (tmp_path / name for name in ("x.npz", "undisturbed.npz", "x.npz.checkpoint"))
    assert main([*command, str(undisturbed)]) == 0

    def stop(done: int, total: int, what: str) -> None:
        if done == 1:
            raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(learn, "counter", lambda name, items: nullcontext(stop))
        assert main([*command, str(out)]) == 130
    assert names(tmp_path) == ["images", "undisturbed.npz", "x.npz.checkpoint"]
    assert len(torch.load(checkpoint, weights_only=True)["losses"]) == 1
    refused(*command, str(out), "--signs", "unsigned", message=f"{checkpoint} is the checkpoint of another ")
    assert main([*command, str(out)]) == 0
    assert names(tmp_path) == ["images", "undisturbed.npz", "x.npz"]
    arrays, expected = arrays_of(out), arrays_of(undisturbed)
    assert set(arrays) == set(expected)
    for name, array in arrays.items():
        np.testing.assert_array_equal(array, expected[name])
