"""The command and the lines of Python that the page shows do what the page did, with the user's own file."""

from __future__ import annotations

import io
import json
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import ExifTags, Image
from skimage import data, feature
from starlette.testclient import TestClient

from nablahog import hog, load_descriptor, presets, sample_chairs, save_descriptor
from nablahog.cli.main import main
from nablahog.compat.opencv import HOGDescriptor
from nablahog.invert import template

from ..cli.common import write_off
from ..io.dpm_models import written
from .conftest import npy, npz
from .test_fit import box, until
from .test_invert import events

NAMES = ("my cat's photo.jpg", "-o.png", "@list.png", "größe $HOME.png")
Run = Callable[[dict[str, str]], dict[str, Any]]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Runs both, in the folder of the file; the variables of the Python."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(template, "TEMPLATE_SAMPLES", 2)

    def run_snippets(snippets: dict[str, str]) -> dict[str, Any]:
        words = shlex.split(snippets["command"], comments=True)
        assert words[0] == "nablahog"
        assert main([*words[1:], "-q"]) in (0, 4)  # 4: a pose that is not sure
        names: dict[str, Any] = {}
        exec(snippets["python"], names)
        return names

    return run_snippets


@pytest.mark.parametrize("name", NAMES)
def test_of_a_photograph(client: TestClient, tmp_path: Path, photo_file: bytes, name: str, run: Run) -> None:
    (tmp_path / name).write_bytes(photo_file)
    of = client.post("/api/photos", params={"name": name}, content=photo_file).json()["id"]
    asked = {"preset": "skimage", "settings": {"orientations": "8", "cells_per_block": "2x2"}, "size": 50}
    said = client.post("/api/hog", json={"photo": of, **asked}).json()
    names = run(said["snippets"])
    stored = client.get(f"/api/hog/{said['key']}/file").content
    (tmp_path / "page.npz").write_bytes(stored)
    expected = load_descriptor("page.npz").descriptor.numpy()
    (made,) = (path for path in tmp_path.glob("*.npz") if path.name != "page.npz")
    np.testing.assert_allclose(load_descriptor(made).descriptor, expected, atol=1e-6)
    np.testing.assert_allclose(names["descriptor"], expected, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("prior", ["default", "none"])
def test_of_its_pre_image(client: TestClient, tmp_path: Path, photo_file: bytes, prior: str, run: Run) -> None:
    (tmp_path / NAMES[0]).write_bytes(photo_file)
    of = client.post("/api/photos", params={"name": NAMES[0]}, content=photo_file).json()["id"]
    done = events(client, photo=of, preset="uoctti", prior=prior, seed=2)[-1][1]
    names = run(done["snippets"])
    assert float(names["result"].distance[0]) == pytest.approx(done["distance"], abs=1e-3)
    (written,) = json.loads(Path("out/results.json").read_text(encoding="utf-8"))
    assert written["distance"] == pytest.approx(done["distance"], abs=1e-3)
    again = events(client, photo=of, prior=prior, start=done["id"])[-1][1]
    assert again["snippets"]["command"].startswith("# from the beginning")


def files() -> dict[str, tuple[str, dict[str, str], bytes]]:
    """Files by a name of what is tested: the file's name, what was answered about it, and what it holds."""
    random = np.random.default_rng(0)
    image = data.camera()[100:164, 200:264].astype(np.float32) / 255
    blocks = feature.hog(image, cells_per_block=(2, 2), feature_vector=False).astype(np.float32)
    asked = {"preset": "skimage", "settings": '{"cells_per_block": "2x2"}'}
    uoctti, stored = hog(image, "uoctti"), io.BytesIO()
    save_descriptor(stored, uoctti, "uoctti", (64, 64))
    opencv = hog(image, presets.opencv(win_size=(64, 64)), layout="native")
    cells = random.standard_normal((4, 4, 31)).astype("f4")
    return {
        "row": ("a b.npy", {**asked, "image_size": "64x64"}, npy(blocks.ravel())),
        "blocks": ("b.npy", asked, npy(blocks)),
        "blocks of float64": ("d.npy", asked, npy(blocks.astype(np.float64) / 3)),
        "cells of another layout": ("c.npy", {"preset": "opencv"}, npy(hog(image, presets.opencv(win_size=(64, 64))))),
        "opencv": ("o.npy", {"preset": "opencv", "settings": '{"win_size": "64x64"}'}, npy(opencv)),
        "column": ("v.npy", {"preset": "opencv", "settings": '{"win_size": "64x64"}'}, npy(opencv.reshape(-1, 1))),
        "key": ("k.npz", {"preset": "uoctti", "key": "left"}, npz(left=uoctti, right=uoctti)),
        "descriptor file": ("it's.npz", {}, stored.getvalue()),
        "template": ("svm.npy", {"as": "template"}, npy(random.standard_normal(3781).astype(np.float32))),
        "template of cells": ("w.npy", {"as": "template", "preset": "uoctti"}, npy(cells)),
    }


@pytest.mark.slow
@pytest.mark.parametrize("which", [*files()])
def test_of_a_file(client: TestClient, tmp_path: Path, which: str, run: Run) -> None:
    name, answers, held = files()[which]
    (tmp_path / name).write_bytes(held)
    of = client.post("/api/descriptors", params={"name": name, **answers}, content=held).json()
    said = client.post("/api/hog", json={"descriptor": of["id"]}).json()
    assert name in shlex.split(said["snippets"]["command"])
    names = run(said["snippets"])
    (tmp_path / "page.npz").write_bytes(client.get(f"/api/hog/{said['key']}/file").content)
    made = names["weights" if "as" in answers else "descriptor"]
    np.testing.assert_array_equal(made, load_descriptor("page.npz").descriptor)
    if which in ("row", "blocks of float64", "descriptor file", "template of cells"):
        quality = "best" if of["template"] else "fast"  # the search of a template has no other
        done = events(client, descriptor=of["id"], quality=quality)[-1][1]
        assert float(run(done["snippets"])["result"].distance[0]) == pytest.approx(done["distance"], abs=1e-3)


@pytest.mark.slow
def test_of_a_detector_that_opencv_saved(client: TestClient, tmp_path: Path, run: Run) -> None:
    detector, file = HOGDescriptor(), tmp_path / "people.yml.gz"
    detector.setSVMDetector(np.random.default_rng(0).standard_normal(3781).astype(np.float32))
    detector.save(str(file))
    of = client.post(f"/api/descriptors?name={file.name}", content=file.read_bytes()).json()
    assert (of["template"], of["image_size"]) == (True, [128, 64])
    said = client.post("/api/hog", json={"descriptor": of["id"]}).json()
    weights = run(said["snippets"])["weights"]
    (tmp_path / "page.npz").write_bytes(client.get(f"/api/hog/{said['key']}/file").content)
    np.testing.assert_array_equal(weights, load_descriptor("page.npz").descriptor)


@pytest.mark.slow
def test_of_a_filter_of_a_model(client: TestClient, tmp_path: Path, run: Run) -> None:
    """Of voc-release5, the second."""
    file = written(tmp_path / "toy.mat")
    of = client.post(f"/api/descriptors?name={file.name}&as=template", content=file.read_bytes()).json()
    said = client.post("/api/hog", json={"descriptor": of["parts"][1]["id"]}).json()
    weights = run(said["snippets"])["weights"]
    (tmp_path / "page.npz").write_bytes(client.get(f"/api/hog/{said['key']}/file").content)
    np.testing.assert_array_equal(weights, load_descriptor("page.npz").descriptor)


@pytest.mark.slow
@pytest.mark.parametrize("camera", [{"focal": None}, {"focal": [400.0, 410.0], "principal_point": [100.5, 120.0]}])
def test_of_a_pose(client: TestClient, tmp_path: Path, camera: dict[str, Any], run: Run) -> None:
    """Of a photograph whose file says a focal length, which the page may be told to ignore, and of a mesh with axes."""
    scene = Image.open(io.BytesIO(client.get("/api/photos/scene-chair").content)).convert("RGB")
    exif = Image.Exif()
    exif[ExifTags.IFD.Exif] = {ExifTags.Base.FocalLengthIn35mmFilm: 50}
    scene.save(tmp_path / "a chair.png", exif=exif)
    chair = sample_chairs()["wooden-0"]
    turned = chair.vertices[:, [0, 2, 1]] * torch.tensor([1, 1, -1])  # y up, front to z
    write_off(tmp_path / "my chair.off", turned, chair.faces)
    photo, mesh = (
        client.post(f"/api/{kind}", params=query, content=(tmp_path / query["name"]).read_bytes()).json()
        for kind, query in (
            ("photos", {"name": "a chair.png"}),
            ("meshes", {"name": "my chair.off", "up": "y", "front": "z"}),
        )
    )
    assert photo["focal"] == pytest.approx(366.0, abs=1)
    opened = {"photo": photo["id"], "mesh": mesh["id"], "box": box(client), **camera}
    with client.websocket_connect("ws://127.0.0.1:8765/api/fit") as socket:
        socket.send_json({"type": "open", **opened})
        until(socket, "ready")
        socket.send_json({"type": "fit"})
        fitted = until(socket, "fitted", "error")[-1]
    found = fitted["result"]
    assert found["focal_length_from"] == ("assumed" if camera["focal"] is None else "given")
    pose = run(fitted["snippets"])["pose"]
    (written,) = json.loads(Path("out/poses.json").read_text(encoding="utf-8"))["annotations"]
    for name in ("azimuth", "elevation", "distance", "confidence"):
        assert getattr(pose, name) == pytest.approx(found[name], abs=0.02), name
        assert written[name] == pytest.approx(found[name], abs=0.02), name
