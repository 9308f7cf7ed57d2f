"""Stored results: found by exactly the same work only, and whole or not at all."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from nablahog.jobs.store import JobResult, load, save
from nablahog.paper.methods import METHODS

from ..paper.common import job
from ..paper.fakes import BRIGHT, DARK

RESULT = JobResult([{"cc": 0.1 + 0.2, "ssim": None}], np.full((1, 32, 32), 7, np.uint8), 1.5)


def test_round_trip(tmp_path: Path) -> None:
    save(tmp_path / "new" / "a.npz", RESULT)
    result = load(tmp_path / "new" / "a.npz", job(DARK))
    assert result is not None
    assert (result.figures, result.seconds) == (RESULT.figures, RESULT.seconds)
    assert np.array_equal(result.pictures, RESULT.pictures)


def test_damage(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    assert load(path, job(DARK)) is None
    save(path, RESULT)
    whole = path.read_bytes()
    for damaged in (b"", b"hello", whole[:-30], whole[: len(whole) // 2]):
        path.write_bytes(damaged)
        assert load(path, job(DARK)) is None
    for position in range(130, len(whole), 97):
        path.write_bytes(whole[:position] + bytes([whole[position] ^ 1]) + whole[position + 1 :])
        result = load(path, job(DARK))
        assert result is None or (result.figures == RESULT.figures and np.array_equal(result.pictures, RESULT.pictures))


def test_keys_tell_work_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    first.write_bytes(b"1")
    second.write_bytes(b"2")
    base = job(DARK)
    learned = METHODS["uoctti-learned"]
    brighter = base.image.copy()
    brighter[0, 0] = np.nextafter(brighter[0, 0], np.float32(2))
    jobs = [
        base,
        job(DARK, seed=1),
        job(DARK, max_evaluations=3),
        job(BRIGHT),
        job(METHODS["dalal-single"]),
        job(learned),
        job(learned, learned={"prior": first}),
        job(learned, learned={"prior": second}),
        replace(base, image=brighter),
        replace(base, image=base.image.reshape(16, 64)),
    ]
    keys = {variant.key() for variant in jobs}
    assert len(keys) == len(jobs)
    assert job(DARK).key() == base.key()
    assert job(DARK, learned={"prior": first}).key() == base.key()  # which it does not use
    first.write_bytes(b"2")
    assert job(learned, learned={"prior": first}).key() == job(learned, learned={"prior": second}).key()
    monkeypatch.setattr(torch, "__version__", "0")
    assert base.key() not in keys
