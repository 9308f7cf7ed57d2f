"""Descriptors, cells and dialects, as the page asks for them."""

from __future__ import annotations

import base64
import io
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from starlette.testclient import TestClient

from nablahog import hog, load_descriptor, presets
from nablahog.io.images import read_image
from nablahog.viz import glyphs


def test_what_there_is(client: TestClient) -> None:
    about = client.get("/api/about").json()
    assert {each["name"] for each in about["presets"]} == {*presets.__all__}
    uoctti = next(each for each in about["presets"] if each["name"] == "uoctti")
    assert uoctti["signed"]
    assert uoctti["title"] == (presets.uoctti.__doc__ or "").split("\n")[0]
    cell = next(each for each in uoctti["parameters"] if each["name"] == "cell_size")
    assert (cell["kind"], cell["default"], cell["least"]) == ("integer", "8", 2)
    assert not next(each for each in about["presets"] if each["name"] == "aubry")["signed"]
    assert any(each["id"] == "sample-astronaut" for each in about["samples"])
    assert about["meshes"]
    assert about["priors"] == {"signed": True, "unsigned": True}


@pytest.mark.parametrize("preset", ["paper", "uoctti", "opencv"])
def test_a_descriptor(client: TestClient, photo: str, photo_file: bytes, preset: str, tmp_path: Path) -> None:
    path = tmp_path / "p.png"
    path.write_bytes(photo_file)
    answer = client.post("/api/hog", json={"photo": photo, "preset": preset})
    assert answer.status_code == 200, answer.json()
    said, spec = answer.json(), getattr(presets, preset)()
    with torch.no_grad():
        expected = hog(read_image(path)[None], spec)[0]
    assert said["shape"] == list(expected.shape)
    drawn = said["glyphs"]
    shown = np.asarray(Image.open(io.BytesIO(base64.b64decode(drawn["image"])))) / 255
    pixels, rest = divmod(len(shown), drawn["rows"])
    assert (rest, shown.shape[1] % drawn["cols"]) == (0, 0)
    np.testing.assert_allclose(shown, glyphs(expected, spec, pixels), atol=0.003)
    path.write_bytes(client.get(f"/api/hog/{said['key']}/file").content)
    stored = load_descriptor(path)
    assert stored.spec == spec
    torch.testing.assert_close(stored.descriptor, expected)


def test_a_cell_by_name(client: TestClient, photo: str) -> None:
    said = client.post("/api/hog", json={"photo": photo, "preset": "opencv"}).json()
    cell = client.get(f"/api/hog/{said['key']}/cell?row=3&col=2").json()
    assert cell["box"] == [16, 24, 24, 32]
    assert (cell["block"]["box"][2] - cell["block"]["box"][0], len(cell["entries"])) == (16, 36)
    for preset, around in (("uoctti", [8, 16, 32, 40]), ("paper", [0, 0, 48, 64])):
        key = client.post("/api/hog", json={"photo": photo, "preset": preset}).json()["key"]
        assert client.get(f"/api/hog/{key}/cell?row=3&col=2").json()["block"]["box"] == around
    assert cell["entries"][0]["name"] == "cell 0, 0 of the block: 10°"
    assert len(cell["histogram"]) == len(cell["angles"]) == 9


def test_a_cell_that_is_left_out(client: TestClient, photo: str) -> None:
    said = client.post("/api/hog", json={"photo": photo, "preset": "dpm"}).json()
    cell = client.get(f"/api/hog/{said['key']}/cell?row=0&col=0").json()
    assert (cell["histogram"], cell["block"], cell["entries"]) == (None, None, [])
    assert client.get(f"/api/hog/{said['key']}/cell?row=99&col=0").json()["error"].startswith("expected a cell")
    assert client.get(f"/api/hog/{said['key']}/cell?row=x").json()["error"].startswith("row must be an integer")
