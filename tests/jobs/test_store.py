"""Stored results: found by exactly the same work and code only, and whole or not at all."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from nablahog import hog, presets, sample_chairs
from nablahog.cli.commands.invert import InversionJob
from nablahog.cli.commands.pose import ObjectJob
from nablahog.io.dataset_manifest import DESCRIBING, ImageState, Manifest
from nablahog.io.lists import AnnotatedObject
from nablahog.jobs.store import JobResult, do_all, load, save
from nablahog.paper import learned
from nablahog.paper.baselines.exemplar_views import EXEMPLAR_SPEC, ExemplarLibrary
from nablahog.paper.methods import METHODS
from nablahog.paper.pose_methods import Table2Settings
from nablahog.paper.table2 import PoseJob
from nablahog.pose import model
from nablahog.pose.background import default_background
from nablahog.render.models import Model
from nablahog.requests.inversion import InvertRequest
from nablahog.requests.pose import PoseRequest
from nablahog.requests.sources import Source
from nablahog.runtime import cache

from ..paper.common import job
from ..paper.fakes import BRIGHT, DARK, NEAR

RESULT = JobResult([{"cc": 0.1 + 0.2, "ssim": None}], np.full((1, 32, 32), 7, np.uint8), 1.5)


def test_round_trip(tmp_path: Path) -> None:
    save(tmp_path / "new" / "a.npz", RESULT)
    result = load(tmp_path / "new" / "a.npz", job(DARK))
    assert result is not None
    assert (result.figures, result.seconds) == (RESULT.figures, RESULT.seconds)
    assert np.array_equal(result.pictures, RESULT.pictures)


@pytest.mark.slow
def test_progress_tells_what_is_done_and_at_work(tmp_path: Path) -> None:
    """Of a second run, which finds all stored, only that."""
    jobs = {"dark": job(DARK), "bright": job(BRIGHT)}
    calls: list[tuple[int, int, str]] = []
    for _ in range(2):
        results = do_all(tmp_path, jobs, workers=1, label=str, progress=lambda *call: calls.append(call))
        assert [name for name, result in results if isinstance(result, JobResult)] == [*jobs]
    assert calls == [(0, 2, ""), (0, 2, "dark"), (1, 2, ""), (1, 2, "bright"), (2, 2, ""), (2, 2, "")]


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


def keys_of_results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """A key of each kind."""
    photo = tmp_path / "photo.png"
    photo.write_bytes(b"a photograph")
    descriptor = hog(torch.zeros(1, 1, 32, 32), "uoctti")[0]
    source = Source("a.npz", "a", descriptor, presets.uoctti(), (32, 32), None)
    models = (Model("a", photo),)
    keys = {
        "table1": job(DARK).key(),
        "table2": PoseJob(NEAR, np.zeros((1, 8, 8), np.float32), None, models, None, Table2Settings()).key(),
        "inversion": InversionJob(source, InvertRequest()).key(),
        "pose": ObjectJob(AnnotatedObject(1, "photo.png"), photo, PoseRequest(), ()).key(),
        "descriptors": Manifest(presets.uoctti(), 0).add_images([ImageState("a.png")]).key(0),
    }
    mesh = sample_chairs()["wooden-0"]
    with monkeypatch.context() as patch:  # nothing is computed
        patch.setattr(learned, "load", lambda kind, path: None)
        patch.setattr(ExemplarLibrary, "_read_or_learn", lambda library, mesh, key: keys.update(exemplars=key))
        patch.setattr(model, "cached_array", lambda kind, key, shape, _: keys.update(views=key) or np.zeros(shape))
        keys |= {f"learned {kind}": learned.learned_from_samples(kind, print).name for kind in learned.LEARNED}
        ExemplarLibrary(None, default_background(EXEMPLAR_SPEC)).views(mesh)
        model.view_descriptors(model.PreparedModel(mesh), 15.0)
    return keys


def test_every_key_is_of_the_whole_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before, again = (keys_of_results(tmp_path, monkeypatch) for _ in range(2))
    monkeypatch.setattr(cache, "_key_of_package", lambda parts: "with a file edited")
    after = keys_of_results(tmp_path, monkeypatch)
    assert before == again
    assert len(before) == 7 + len(learned.LEARNED)
    assert {kind for kind, key in after.items() if key == before[kind]} == set()


@pytest.mark.slow
def test_the_key_of_a_data_set_is_of_all_that_describes(tmp_path: Path) -> None:
    """What a process loads that writes a shard, and nothing that tells of its progress."""
    code = """
import sys
from nablahog import presets
from nablahog.jobs.describing import ShardJob

ShardJob((sys.argv[1],), presets.uoctti(), 8, sys.argv[2], "").run()
print(*(m.__file__ for n, m in sys.modules.items() if n.startswith("nablahog.") and n != "nablahog.jobs"), sep="\\n")
"""
    photo = tmp_path / "photo.png"
    Image.new("RGB", (16, 16)).save(photo)
    command = [sys.executable, "-c", code, str(photo), str(tmp_path / "part.parquet")]
    loaded = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()
    paths = {Path(file).relative_to(Path(cache.__file__).parents[1]).as_posix() for file in loaded}
    assert {"hog/engine.py", "io/images.py"} < paths
    assert all(path.startswith(DESCRIBING) for path in paths)
    assert not any(path.startswith(DESCRIBING) for path in ("cli/terminal.py", "app/server.py", "jobs/runner.py"))
