"""Stored results: found by exactly the same work and code only, and whole or not at all."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from nablahog import hog, presets, sample_chairs
from nablahog.cli.commands.invert import InversionJob
from nablahog.cli.commands.pose import ObjectJob
from nablahog.inputs.boxes import Box
from nablahog.io.dataset_manifest import DESCRIBING, ImageState, Manifest
from nablahog.io.input_file import InputFile
from nablahog.io.lists import AnnotatedObject
from nablahog.jobs.store import JobResult, do_all, load, save
from nablahog.paper import learned
from nablahog.paper.baselines.exemplar_views import EXEMPLAR_SPEC, ExemplarLibrary
from nablahog.paper.methods import METHODS
from nablahog.paper.pose_methods import Table2Settings
from nablahog.paper.table2 import PoseJob
from nablahog.pose import model
from nablahog.pose.background import default_background
from nablahog.render import load_mesh
from nablahog.render.models import Model
from nablahog.requests.inversion import GlyphRequest, InvertRequest
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


def test_keys_of_objects_are_of_all_that_is_known_of_them(tmp_path: Path) -> None:
    """Of files the contents count, not the names; and what changes no result does not."""
    a, b, again = (tmp_path / name for name in ("a", "b", "again"))
    for path in (a, b, again):
        path.write_bytes(path.name[:1].encode())
    base = ObjectJob(AnnotatedObject(1, "x.png", Box(0, 0, 9, 8), (10, 20)), a, PoseRequest(), (Model("m", a),))
    options: dict[str, Any] = {
        **{"up": "y", "front": "x", "within": 90.0, "focal": 300.0, "principal_point": (4.0, 5.0), "mask": str(a)},
        **{"intrinsics": (9.0, 9.0, 4.0, 4.0), "distortion": (0.1, 0, 0, 0), "method": "paper", "seed": 1},
    }
    known = {"box": Box(0, 0, 8, 9), "view": (20, 10), "polygons": ((0, 0, 9, 0, 9, 8),)}
    models = ((Model("n", a),), (Model("m", b),), (Model("m", a), Model("n", b)), (Model("n", b), Model("m", a)))
    paged, masked = (replace(base, request=PoseRequest(**each)) for each in ({"page": True}, {"mask": str(b)}))
    jobs = [
        *(base, paged, masked, replace(base, photo=b), *(replace(base, models=each) for each in models)),
        *(replace(base, request=PoseRequest(**{name: value})) for name, value in options.items()),
        *(replace(base, listed=replace(base.listed, **{name: value})) for name, value in known.items()),
        replace(paged, listed=replace(base.listed, image="y.png")),  # whose page names it
    ]
    assert len({each.key() for each in jobs}) == len(jobs)
    unread = {"mesh": str(a), "annotations": str(b), "least_confidence": 0.9}
    assert {each.name for each in fields(PoseRequest)} == {*options, *unread, "page", "box", "initial"}
    for same in (
        *(replace(base, request=PoseRequest(**{name: value})) for name, value in unread.items()),
        replace(base, photo=again, models=(Model("m", again),), listed=replace(base.listed, id=2, image="y.png")),
    ):
        assert same.key() == base.key()


def test_keys_of_inversions_are_of_descriptor_photograph_and_options(tmp_path: Path) -> None:
    a, b, again = (tmp_path / name for name in ("a", "b", "again"))
    for path in (a, b, again):
        path.write_bytes(path.name[:1].encode())
    descriptor = hog(torch.rand(1, 1, 32, 32), "paper")[0]
    source = Source("a.npz", "a", descriptor, presets.paper(), (32, 32), None)
    base = InversionJob(source, InvertRequest())
    parts: dict[str, Any] = {
        **{"descriptor": descriptor + 0.01, "spec": replace(presets.paper(), name="other"), "image_size": (32, 33)},
        "photo": torch.zeros(1, 32, 32),
    }
    options = {"template": True, "quality": "fast", "method": "paper", "samples": 2, "seed": 1}
    jobs = [
        *(base, *(replace(base, source=replace(source, **{name: value})) for name, value in parts.items())),
        *(replace(base, request=InvertRequest(**{name: value})) for name, value in options.items()),
        replace(base, source=replace(source, photo=torch.ones(1, 32, 32))),
        *(replace(base, request=InvertRequest(prior=prior)) for prior in ("none", str(a), str(b))),
    ]
    assert len({each.key() for each in jobs}) == len(jobs)
    own = {each.name for each in fields(InvertRequest)} - {each.name for each in fields(GlyphRequest)}
    assert own == {*options, "prior"}
    assert replace(base, source=replace(source, path="b", stem="b", part="c", remark="d")).key() == base.key()
    assert replace(jobs[-2], request=InvertRequest(prior=str(again))).key() == jobs[-2].key()


def test_keys_of_views_are_of_mesh_camera_elevation_and_background(monkeypatch: pytest.MonkeyPatch) -> None:
    keys: list[str] = []
    monkeypatch.setattr(model, "cached_array", lambda kind, key, shape, _: keys.append(key) or np.zeros(shape))
    mesh = load_mesh(InputFile("m.off", b"OFF\n4 2 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 2 3\n"))
    background = default_background(model.coarse_background()[0].spec)
    for changed in (
        mesh,
        replace(mesh, vertices=mesh.vertices * torch.tensor([1, 1, 0.9])),
        replace(mesh, faces=mesh.faces.flip(0)),
        replace(mesh, brightness=mesh.brightness * 0.9),
    ):
        model.view_descriptors(model.PreparedModel(changed), 15.0)
    prepared = model.PreparedModel(mesh)
    for elevation, own in (
        (20.0, None),
        (15.0, background),
        (15.0, replace(background, covariance=1.1 * background.covariance)),
    ):
        model.view_descriptors(prepared, elevation, own)
    prepared = model.PreparedModel(mesh)
    prepared.camera = replace(prepared.camera, focal=2 * prepared.camera.focal)
    model.view_descriptors(prepared, 15.0)
    assert len({*keys}) == len(keys) == 8
    model.view_descriptors(model.PreparedModel(mesh), 15.0)
    assert keys[-1] == keys[0]


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
