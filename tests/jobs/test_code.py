"""The key of every kind of stored result changes with the code and the data of the package."""

from __future__ import annotations

import subprocess
import sys
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
from nablahog.paper import learned
from nablahog.paper.baselines.exemplar_views import EXEMPLAR_SPEC, ExemplarLibrary
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
from ..paper.fakes import DARK, NEAR


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
