"""Learning HOGgles neither depends on interruptions, nor goes on from what is not its own."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from nablahog import presets
from nablahog.invert.baselines import dictionary_learning, hoggles_learning
from nablahog.invert.baselines.hoggles import PairedDictionary
from nablahog.invert.baselines.hoggles_learning import learn_hoggles

from ...io.archives import arrays_of, damages, rewrite
from ..photographs import photograph

SPEC = presets.uoctti(4, orientations=3)
ITERATIONS = 8
EVERY = 3


@pytest.fixture(autouse=True)
def _often(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is learned is kept every three iterations, and atoms give way at once, to windows drawn at random."""
    monkeypatch.setattr(hoggles_learning, "REPORTED", EVERY)
    monkeypatch.setattr(dictionary_learning, "PATIENCE", 1)
    monkeypatch.setattr(dictionary_learning, "UNUSED", 0.03)
    monkeypatch.setattr(hoggles_learning, "BATCH", 60)


def _images() -> dict[str, Tensor]:
    return {name: photograph(64, name)[0, 0] for name in ("camera", "coins")}


def _learned(**options: Any) -> PairedDictionary:
    return learn_hoggles(**{"images": _images(), "spec": SPEC, "atoms": 30, "iterations": ITERATIONS, **options})


class _Stop:
    """Progress that is interrupted when ``at`` iterations are done."""

    def __init__(self, at: int | None = None) -> None:
        self.at = at
        self.seen: list[int] = []

    def __call__(self, done: int, total: int, what: str) -> None:
        if done == self.at and what != "describing the images":
            raise KeyboardInterrupt
        self.seen.append(done)


def _check_same(result: PairedDictionary, expected: PairedDictionary) -> None:
    assert torch.equal(result.gray, expected.gray)
    assert torch.equal(result.hog, expected.hog)
    assert result.learning == expected.learning


@pytest.mark.parametrize(("at", "kept"), [(0, 0), (1, 0), (3, 3), (5, 3), (7, 6), (8, 8)])
def test_interrupted_and_repeated(tmp_path: Path, at: int, kept: int) -> None:
    undisturbed, path = _learned(), tmp_path / "kept"
    with pytest.raises(KeyboardInterrupt):
        _learned(checkpoint=path, progress=_Stop(at))
    assert path.exists() == (kept > 0)
    resumed = _Stop()
    _check_same(_learned(checkpoint=path, progress=resumed), undisturbed)
    assert resumed.seen == [0, *range(kept, ITERATIONS + 1)]  # 0: the images are described again


def test_interrupted_again_and_again(tmp_path: Path) -> None:
    path = tmp_path / "kept"
    for at in (4, 5, 7, 7):
        with pytest.raises(KeyboardInterrupt):
            _learned(checkpoint=path, progress=_Stop(at))
    _check_same(_learned(checkpoint=path), _learned())


def test_the_file_stays_behind(tmp_path: Path) -> None:
    undisturbed, path = _learned(checkpoint=tmp_path / "kept"), tmp_path / "kept"
    assert os.listdir(tmp_path) == ["kept"]
    before = path.read_bytes()
    again = _Stop()
    _check_same(_learned(checkpoint=path, progress=again), undisturbed)
    assert again.seen == [0, ITERATIONS]
    assert path.read_bytes() == before
    assert arrays_of(path)["objective"].tolist() == list(undisturbed.learning.objective)
    assert len(undisturbed.learning.objective) == 3


def test_what_is_random_goes_on(tmp_path: Path) -> None:
    """Or the tests above would pass if it began anew."""
    path = tmp_path / "kept"
    with pytest.raises(KeyboardInterrupt):
        _learned(checkpoint=path, progress=_Stop(EVERY))
    rewrite(path, random=np.array(json.dumps(np.random.default_rng(9).bit_generator.state)))
    assert not torch.equal(_learned(checkpoint=path).gray, _learned().gray)


def test_random_windows_need_none(tmp_path: Path) -> None:
    _learned(fast=True, checkpoint=tmp_path / "kept")
    assert not os.listdir(tmp_path)


@pytest.mark.parametrize(
    ("changed", "names"),
    [
        ({"seed": 1}, "seed"),
        ({"atoms": 20}, "atoms"),
        ({"sparsity": 0.05}, "sparsity"),
        ({"iterations": 9}, "iterations"),
        ({"windows": 70}, "windows"),
        ({"spec": presets.uoctti(4)}, "spec"),
        ({"images": {"camera": _images()["camera"]}}, "images"),
        ({"images": {**_images(), "coins": _images()["camera"]}}, "images"),
        ({"seed": 1, "atoms": 20}, "atoms, seed"),
    ],
)
def test_of_another_learning(tmp_path: Path, changed: dict[str, Any], names: str) -> None:
    path = tmp_path / "kept"
    _learned(checkpoint=path)
    before = path.read_bytes()
    with pytest.raises(ValueError, match=rf"checkpoint of another dictionary pair \(of other {names}\); finish that"):
        _learned(checkpoint=path, **changed)
    assert path.read_bytes() == before


DAMAGED = "the checkpoint is damaged"


def _state(**changed: Any) -> Any:
    """Of the generator of random numbers."""
    return np.array(json.dumps({**np.random.default_rng(0).bit_generator.state, **changed}))


WRONG: dict[str, tuple[Callable[[dict[str, Any]], dict[str, Any]], str]] = {
    "fewer atoms": (lambda old: {"dictionary": old["dictionary"][1:]}, DAMAGED),
    "NaN": (lambda old: {"dictionary": old["dictionary"] * np.float32(np.nan)}, DAMAGED),
    "Inf": (lambda old: {"products": old["products"] + np.float32(np.inf)}, DAMAGED),
    "integers": (lambda old: {"codes": old["codes"].astype(int)}, DAMAGED),
    "other codes": (lambda old: {"codes": old["codes"][:, 1:]}, DAMAGED),
    "batches": (lambda old: {"batches": np.array([3])}, DAMAGED),
    "half a batch": (lambda old: {"batches": np.array(3.5)}, DAMAGED),
    "no objectives": (lambda old: {"objective": np.array("x")}, DAMAGED),
    "one objective": (lambda old: {"objective": np.array(0.1)}, DAMAGED),
    "no generator": (lambda old: {"random": np.array("{}")}, DAMAGED),
    "no JSON": (lambda old: {"random": np.array("x")}, DAMAGED),
    "a list": (lambda old: {"random": np.array("[]")}, DAMAGED),
    "another generator": (lambda old: {"random": _state(bit_generator="MT19937")}, DAMAGED),
    "no number": (lambda old: {"random": _state(uinteger="x")}, DAMAGED),
    "no identity": (lambda old: {"identity": np.array("{}")}, "the checkpoint cannot be read: 'images'"),
    "a number": (lambda old: {"identity": np.array(1)}, "cannot be read: identity must be one string, got int64"),
    "a later format": (lambda old: {"format": np.array(2)}, "this version reads checkpoints of format 1, got 2"),
    "no codes": (
        lambda old: {"codes": None},
        "a checkpoint of a dictionary pair, but the archive lacks codes",
    ),
    "pickled": (lambda old: {"random": np.array([{}], dtype=object)}, "pickled objects, which are never loaded"),
}
ACCEPTED: dict[str, dict[str, Any]] = {
    "negative batches": {"batches": np.array(-3)},
    "more batches than iterations": {"batches": np.array(ITERATIONS + 1)},
    "objectives of NaN": {"objective": np.array([np.nan])},
    "a generator beyond its range": {"random": _state(uinteger=-1)},
    "endless JSON": {"random": np.array("[" * 100_000)},
}


def _check_refused(path: Path, message: str) -> None:
    before = path.read_bytes()
    with pytest.raises(ValueError, match=message) as caught:
        _learned(checkpoint=path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    assert path.read_bytes() == before


@pytest.mark.parametrize("what", WRONG)
def test_wrong_contents(tmp_path: Path, what: str) -> None:
    path, (change, message) = tmp_path / "kept", WRONG[what]
    _learned(checkpoint=path)
    rewrite(path, **change(arrays_of(path)))
    _check_refused(path, message)


@pytest.mark.parametrize("what", ACCEPTED)
def test_impossible_contents(tmp_path: Path, what: str) -> None:
    path = tmp_path / "kept"
    _learned(checkpoint=path)
    rewrite(path, **ACCEPTED[what])
    _check_refused(path, DAMAGED)


def test_damaged_files(tmp_path: Path) -> None:
    path = tmp_path / "kept"
    _learned(checkpoint=path)
    for damaged in damages(path.read_bytes()):
        path.write_bytes(damaged)
        _check_refused(path, r"expected a checkpoint of a dictionary pair|damaged")
