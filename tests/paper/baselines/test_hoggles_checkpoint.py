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
from nablahog.invert import checkpoint
from nablahog.paper.baselines import dictionary_learning, hoggles_learning
from nablahog.paper.baselines.hoggles import PairedDictionary
from nablahog.paper.baselines.hoggles_learning import learn_hoggles

from ...invert.photographs import photograph
from ...io.archives import arrays_of, damages, rewrite

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


def _state(**changed: Any) -> Any:
    """Of the generator of random numbers."""
    return np.array(json.dumps({**np.random.default_rng(0).bit_generator.state, **changed}))


WRONG: dict[str, Callable[[dict[str, Any]], dict[str, Any]]] = {
    "fewer atoms": lambda old: {"dictionary": old["dictionary"][1:]},
    "NaN": lambda old: {"dictionary": old["dictionary"] * np.float32(np.nan)},
    "Inf": lambda old: {"products": old["products"] + np.float32(np.inf)},
    "integers": lambda old: {"codes": old["codes"].astype(int)},
    "other codes": lambda old: {"codes": old["codes"][:, 1:]},
    "batches": lambda old: {"batches": np.array([3])},
    "half a batch": lambda old: {"batches": np.array(3.5)},
    "negative batches": lambda old: {"batches": np.array(-3)},
    "more batches than iterations": lambda old: {"batches": np.array(ITERATIONS + 1)},
    "no objectives": lambda old: {"objective": np.array("x")},
    "one objective": lambda old: {"objective": np.array(0.1)},
    "objectives of NaN": lambda old: {"objective": np.array([np.nan])},
    "no generator": lambda old: {"random": np.array("{}")},
    "no JSON": lambda old: {"random": np.array("x")},
    "endless JSON": lambda old: {"random": np.array("[" * 100_000)},
    "a list": lambda old: {"random": np.array("[]")},
    "another generator": lambda old: {"random": _state(bit_generator="MT19937")},
    "no number": lambda old: {"random": _state(uinteger="x")},
    "a generator beyond its range": lambda old: {"random": _state(uinteger=-1)},
    "no identity": lambda old: {"identity": np.array("{}")},
    "endless identity": lambda old: {"identity": np.array("[" * 100_000)},
    "a number": lambda old: {"identity": np.array(1)},
    "formats": lambda old: {"format": np.array([1, 1])},
    "no codes": lambda old: {"codes": None},
    "pickled": lambda old: {"random": np.array([{}], dtype=object)},
}


def _check_set_aside(path: Path, log: pytest.LogCaptureFixture) -> None:
    """Checks that the learning starts afresh, with the result of one that was never disturbed."""
    damaged, progress = path.read_bytes(), _Stop()
    log.clear()
    _check_same(_learned(checkpoint=path, progress=progress), _learned())
    assert progress.seen == [0, *range(ITERATIONS + 1)]
    assert path.with_name("kept.damaged").read_bytes() == damaged
    (message,) = log.messages
    assert message == f"{path} is damaged: it is now called kept.damaged, and the dictionary pair starts afresh"
    assert arrays_of(path)["batches"] == ITERATIONS


@pytest.mark.parametrize("what", WRONG)
def test_impossible_contents(tmp_path: Path, what: str, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "kept"
    _learned(checkpoint=path)
    rewrite(path, **WRONG[what](arrays_of(path)))
    _check_set_aside(path, caplog)


def test_damaged_files(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "kept"
    _learned(checkpoint=path)
    for damaged in damages(path.read_bytes()):
        path.write_bytes(damaged)
        _check_set_aside(path, caplog)


def test_a_later_version(tmp_path: Path) -> None:
    path = tmp_path / "kept"
    _learned(checkpoint=path)
    rewrite(path, format=np.array(2))
    with pytest.raises(ValueError, match="this version reads checkpoints of format 1, got 2"):
        _learned(checkpoint=path)
    assert os.listdir(tmp_path) == ["kept"]


def test_what_is_no_file(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="expected a checkpoint of a dictionary pair, got a folder"):
        _learned(checkpoint=tmp_path)


def test_what_may_not_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It may be whole."""
    path = tmp_path / "kept"
    path.write_bytes(b"hello")

    def refuse(*args: object) -> None:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(checkpoint, "open", refuse, raising=False)
    with pytest.raises(PermissionError):
        _learned(checkpoint=path)
    assert path.read_bytes() == b"hello"
