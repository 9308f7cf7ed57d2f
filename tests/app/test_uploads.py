"""Uploads to the page: what it accepts, and what it asks about them."""

from __future__ import annotations

import io
import json
import os
import tempfile
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from PIL import Image
from skimage.data import camera
from starlette.testclient import TestClient

from nablahog import hog, presets, save_descriptor
from nablahog.app import server, uploads

from .conftest import npy, npz

CUBE = b"OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n"
NO_NUMBERS = npy(np.full((4, 4, 31), np.nan, np.float32))


def test_a_photograph(client: TestClient, photo_file: bytes) -> None:
    said = client.post("/api/photos?name=..%2Fa%5Cb.png", content=photo_file).json()
    assert (said["name"], said["width"], said["height"]) == ("b.png", 48, 64)
    answer = client.get(f"/api/photos/{said['id']}?size=32")
    assert Image.open(io.BytesIO(answer.content)).size == (24, 32)
    assert client.post("/api/photos", content=photo_file).json()["id"] == said["id"]  # by content


def test_ids_are_of_the_file_and_of_how_it_is_read(client: TestClient, photo: str, descriptor_file: bytes) -> None:
    asked: list[dict[str, Any]] = [
        {"photo": photo},
        {"photo": photo, "preset": "dpm"},
        {"photo": photo, "settings": {"cell_size": "4"}},
        {"photo": photo, "size": 40},
        {"descriptor": client.post("/api/descriptors?name=d.npz", content=descriptor_file).json()["id"]},
    ]
    keys = [client.post("/api/hog", json=each).json()["key"] for each in asked]
    array = npy(np.random.default_rng(0).random((4, 4, 31), np.float32))
    for query in (
        "d.npy&preset=uoctti",
        *(f"e.npy&preset={query}" for query in ("uoctti", "uoctti&as=template", "uoctti&image_size=33x32", "vlfeat")),
    ):
        said = client.post(f"/api/descriptors?name={query}", content=array).json()
        keys.append(said["id"])
    meshes = [client.post(f"/api/meshes?name=m.off{axes}", content=CUBE) for axes in ("", "&up=y", "&up=y&front=x")]
    keys += [said.json()["id"] for said in meshes]
    assert len({*keys}) == len(keys)


def test_too_many_pixels_are_refused_before_they_are_decoded(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(uploads, "read_image", Mock(side_effect=ValueError("decoded")))
    too_many = (413, "large.png: expected at most 24,000,000 pixels, got 24,006,000")
    for height, said in ((4000, (422, "decoded")), (4001, too_many)):
        file = io.BytesIO()
        Image.new("1", (6000, height)).save(file, format="PNG")
        answer = client.post("/api/photos?name=large.png", content=file.getvalue())
        assert (answer.status_code, answer.json()["error"]) == said


def test_an_upload_that_takes_too_long_makes_room_for_others(
    client: TestClient, photo_file: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(server, "UPLOAD_SECONDS", 0.0)
        for _ in range(server.UPLOADS_AT_ONCE):
            answer = client.post("/api/photos", content=photo_file)
            assert (answer.status_code, answer.json()["error"][:27]) == (408, "the upload took more than 0")
    assert client.post("/api/photos", content=photo_file).status_code == 200


@pytest.mark.parametrize(
    ("error", "status", "sentence"),
    [
        (MemoryError(), 503, "not enough memory: a smaller size needs less"),
        (RuntimeError("DefaultCPUAllocator: can't allocate memory"), 503, "not enough memory: a smaller size"),
        (RuntimeError("shapes differ"), 500, "an error in the program, please report it: RuntimeError: shapes"),
    ],
)
def test_memory_that_runs_out_is_no_error_in_the_program(
    client: TestClient,
    photo_file: bytes,
    monkeypatch: pytest.MonkeyPatch,
    error: Exception,
    status: int,
    sentence: str,
) -> None:
    monkeypatch.setattr(uploads, "read_image", Mock(side_effect=error))
    answer = client.post("/api/photos", content=photo_file)
    assert (answer.status_code, answer.json()["error"][: len(sentence)]) == (status, sentence)


@pytest.fixture(scope="module")
def descriptor_file() -> bytes:
    """A UoCTTI descriptor, (8, 6, 31), of an image of 64x48 pixels."""
    file = io.BytesIO()
    save_descriptor(file, hog(np.eye(64, 48, dtype=np.float32), "uoctti"), "uoctti", (64, 48))
    return file.getvalue()


def test_a_descriptor_file(client: TestClient, descriptor_file: bytes) -> None:
    said = client.post("/api/descriptors?name=d.npz", content=descriptor_file).json()
    expected = {"preset": "uoctti", "shape": [8, 6, 31], "image_size": [64, 48], "template": False}
    assert {name: said[name] for name in expected} == expected
    seen = client.post("/api/hog", json={"descriptor": said["id"]}).json()
    assert (seen["glyphs"]["rows"], seen["glyphs"]["cols"]) == (8, 6)


@pytest.mark.parametrize(
    ("limit", "most", "sentence"),
    [
        ("MOST_CELLS", 48, "d.npz: expected at most 47 cells, got 8x6"),
        ("MOST_NUMBERS", 48 * 31, "d.npz: expected a descriptor of at most 1,487 numbers, got 1,488"),
    ],
)
def test_the_largest_descriptor(
    client: TestClient, descriptor_file: bytes, monkeypatch: pytest.MonkeyPatch, limit: str, most: int, sentence: str
) -> None:
    monkeypatch.setattr(uploads, limit, most)
    assert client.post("/api/descriptors?name=d.npz", content=descriptor_file).status_code == 200
    monkeypatch.setattr(uploads, limit, most - 1)
    answer = client.post("/api/descriptors?name=d.npz", content=descriptor_file)
    assert (answer.status_code, answer.json()["error"]) == (413, sentence)


@pytest.mark.slow
def test_an_array_is_asked_about_if_its_numbers_do_not_decide(client: TestClient) -> None:
    image = camera()[100:228, 200:264]
    array = hog(image, presets.opencv(), layout="native")
    said = client.post("/api/descriptors?name=h.npy", content=npy(array)).json()
    assert (said["preset"], said["image_size"]) == ("opencv", [128, 64])
    assert "clipped at 0.2" in said["decided_by"]
    data = npy(hog(image[:64], "paper"))
    asked = client.post("/api/descriptors?name=h.npy", content=data)
    assert asked.status_code == 422
    assert asked.json()["error"].startswith("h.npy: an array does not say which library it is from")
    paper = {"preset": "paper", "settings": {}, "image_size": None}
    assert paper in asked.json()["question"]["fitting"]
    scaled = {"name": "h.npy", "preset": "opencv"}
    assert "divided by 3" in client.post("/api/descriptors", params=scaled, content=npy(array * 3)).json()["remark"]
    said = client.post("/api/descriptors", params={"name": "h.npy", "preset": "paper"}, content=data).json()
    assert (said["preset"], said["image_size"], said["decided_by"]) == ("paper", [64, 64], "")


def test_the_rows_of_a_matrix_are_parts(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    images = camera()[100:228, 200:328].reshape(128, 2, 64).swapaxes(0, 1)
    data = npy(np.stack([hog(image, presets.opencv(), layout="native") for image in images]))
    monkeypatch.setattr(uploads, "MOST_PARTS", 2)
    said = client.post("/api/descriptors?name=h.npy", content=data).json()
    assert [part["name"] for part in said["parts"]] == ["row 0", "row 1"]
    seen = client.post("/api/hog", json={"descriptor": said["parts"][1]["id"]}).json()
    assert "--row 1" in seen["snippets"]["command"]
    monkeypatch.setattr(uploads, "MOST_PARTS", 1)
    refused = client.post("/api/descriptors?name=h.npy", content=data)
    assert (refused.status_code, refused.json()["error"]) == (413, "h.npy: expected at most 1 descriptors, got 2")


@pytest.mark.parametrize("length", [3780, 3781])
def test_the_weights_of_a_detector_are_asked_about_as_such(client: TestClient, length: int) -> None:
    """With a bias after them or without: the first suggestion is OpenCV's people detector."""
    weights = npy(np.random.default_rng(0).standard_normal(length).astype(np.float32))
    question = client.post("/api/descriptors?name=svm.npy", content=weights).json()["question"]
    assert question["weights"]
    query = {"name": "svm.npy", "as": "template", "preset": question["fitting"][0]["preset"]}
    said = client.post("/api/descriptors", params=query, content=weights).json()
    assert (said["template"], said["preset"], said["image_size"]) == (True, "opencv", [128, 64])


def test_a_mesh(client: TestClient) -> None:
    said = client.post("/api/meshes?name=m.off&up=y&front=-z", content=CUBE).json()
    assert (said["name"], said["vertices"], said["faces"]) == ("m.off", 4, 4)


@pytest.mark.parametrize(
    ("address", "sent", "status", "sentence"),
    [
        ("meshes?name=m.obj.exe", CUBE, 422, "m.obj.exe: expected a mesh file (.off, .obj, .ply, .stl, .glb, .gltf)"),
        ("meshes?name=m.off&up=q", CUBE, 422, "up must be one of x, y and z, with a sign or without, got 'q'"),
        ("meshes?name=m.off", b"OFF\n", 422, "m.off: "),
        ("descriptors?name=d.pdf", b"x", 422, "d.pdf: expected a descriptor (.npy, .npz, .mat) or a detector"),
        ("descriptors?name=d.pkl", b"x", 422, "d.pkl: a pickle is never loaded"),
        ("descriptors?name=d.npy&preset=uoctti", b"x", 422, "d.npy: expected an array (.npy), but it cannot be read"),
        ("descriptors?name=w.npy&as=template&preset=uoctti", NO_NUMBERS, 422, "w.npy: the weights must be finite"),
        ("descriptors?name=w.npy&as=template", NO_NUMBERS, 422, "w.npy: the weights must be finite"),
        ("descriptors?name=d.npy&settings=%7B", b"x", 400, "expected JSON: "),
        ("hog", [], 422, "the request does not fit: Expected `object`"),
        ("hog", {}, 422, "expected a photo or a descriptor, got neither"),
        ("hog", {"photo": "nothing"}, 410, "the server no longer has this file, as after a restart: open it again"),
        ("invert", {"photo": "nothing"}, 410, "the server no longer has this file, as after a restart: open it again"),
        ("hog", {"photo": "sample-camera", "preset": "hog"}, 422, "preset must be one of 'aubry'"),
        ("hog", {"photo": "sample-camera", "settings": {"cell": "4"}}, 422, "no preset has a parameter 'cell'"),
        (
            "hog",
            {"photo": "sample-camera", "settings": {"cell_size": "600"}},
            422,
            "camera.png: the image must hold at least one cell of 600x600 pixels (height x width), got an image of 512",
        ),
        ("hog", {"photo": "sample-camera", "size": 5}, 422, "size must be an integer in 8"),
        ("hog", {"photo": "sample-camera", "sise": 5}, 422, "there is no field 'sise'; there are"),
    ],
)
def test_a_sentence_says_what_is_wrong(client: TestClient, address: str, sent: Any, status: int, sentence: str) -> None:
    answer = client.post(f"/api/{address}", content=sent if isinstance(sent, bytes) else json.dumps(sent))
    assert (answer.status_code, answer.json()["error"][: len(sentence)]) == (status, sentence)
    assert tempfile.gettempdir() not in answer.json()["error"]


def test_nothing_is_left_behind(
    client: TestClient, photo_file: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    client.post("/api/photos", content=photo_file)
    client.post("/api/photos", content=b"x")
    client.post("/api/meshes?name=m.off", content=CUBE)
    client.post("/api/descriptors?name=d.npy", content=b"x")
    assert os.listdir(tmp_path) == []


@pytest.mark.slow
def test_no_sentence_has_options_of_the_command(client: TestClient) -> None:
    random = np.random.default_rng(0)
    row, cells = (npy(random.random(shape, dtype=np.float32)) for shape in (252, (8, 8, 31)))
    integers, infinite = npy(np.ones((8, 8, 31), np.int64)), npy(np.full(3780, np.nan, np.float32))
    several = npz(left=np.zeros((8, 6, 31), np.float32), right=np.ones((8, 6, 31), np.float32))
    asked: tuple[tuple[bytes, dict[str, str]], ...] = (
        (row, {}),
        (row, {"preset": "skimage"}),
        (row, {"preset": "opencv", "image_size": "100x100"}),
        (row, {"preset": "opencv", "image_size": "100x100", "settings": '{"win_size": "64x64"}'}),
        (row, {"as": "template"}),
        (row, {"key": "left"}),
        (cells, {}),
        (cells, {"preset": "skimage"}),
        (cells, {"preset": "skimage", "settings": '{"orientations": "x"}'}),
        (npy(random.random((3, 8, 8, 31), dtype=np.float32)), {"preset": "uoctti"}),
        (several, {}),
        (several, {"key": "middle"}),
        (integers, {}),
        (infinite, {}),
    )
    for content, query in asked:
        answer = client.post("/api/descriptors", params={"name": "a.npz", **query}, content=content)
        assert answer.status_code == 422, query
        assert "--" not in answer.json()["error"], query
        unasked = content in (integers, infinite) or query == {"key": "left"} or "orientations" in str(query)
        assert (answer.json().get("question") is None) == unasked, query


def test_arrays_of_an_archive_are_offered_by_their_whole_names(client: TestClient) -> None:
    shapes = {"hog-8": (8, 6, 31), "hog.16": (4, 3, 31)}
    file = npz(**{name: np.zeros(shape, np.float32) for name, shape in shapes.items()})
    keys = client.post("/api/descriptors?name=d.npz", content=file).json()["question"]["keys"]
    assert keys == [*shapes]
    for key in keys:
        query = {"name": "d.npz", "preset": "uoctti", "key": key}
        assert client.post("/api/descriptors", params=query, content=file).json()["shape"] == [*shapes[key]]
