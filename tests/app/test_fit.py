"""A chair that is turned over a photograph of it."""

from __future__ import annotations

import base64
import io
import json
import time
from typing import Any
from unittest.mock import Mock
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image
from starlette.testclient import TestClient

from nablahog.app.fit import Fitting
from nablahog.app.messages import Pose
from nablahog.pose import result

from .conftest import HOST, documented_fields

FIT = f"ws://{HOST}/api/fit"
SCENE = {"photo": "scene-chair", "mesh": "chair-wooden-0"}
TRUE = 35.0  # azimuth


def box(client: TestClient) -> list[float]:
    samples = client.get("/api/about").json()["samples"]
    sides: list[float] = next(each for each in samples if each["id"] == SCENE["photo"])["box"]
    return sides


def until(socket: Any, *kinds: str) -> list[dict[str, Any]]:
    answers = [json.loads(socket.receive_text())]
    while answers[-1]["type"] not in kinds:
        answers.append(json.loads(socket.receive_text()))
    assert all({*answer} - {"type"} == documented_fields(answer["type"]) for answer in answers)
    return answers


@pytest.mark.parametrize(
    ("side", "answer"), [(7, "small.png: expected a photograph of at least 8x8 pixels, got 7x40"), (8, "ready")]
)
def test_the_least_photograph(client: TestClient, side: int, answer: str) -> None:
    file = io.BytesIO()
    Image.effect_noise((40, side), 50).save(file, "PNG")
    photo = client.post("/api/photos?name=small.png", content=file.getvalue()).json()["id"]
    with client.websocket_connect(FIT) as socket:
        socket.send_json({"type": "open", "photo": photo, "mesh": SCENE["mesh"], "box": [0, 0, 40, 8]})
        said = json.loads(socket.receive_text())
    assert said.get("error", said["type"]).startswith(answer)


@pytest.mark.slow
def test_it_is_turned_and_fitted(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(result, "SECOND_CONFIDENCE", -1.0)  # any runner-up is a second answer
    with client.websocket_connect(FIT) as socket:
        socket.send_json({"type": "open", **SCENE, "box": box(client)})
        (ready,) = until(socket, "ready")
        assert ready["crop"]["side"] == 128
        began = time.perf_counter()
        socket.send_json({"type": "pose", "n": 7, "pose": [30, 20, 3, 0, 0, 0], "place": True})
        (view,) = until(socket, "view")
        assert 0 < view["milliseconds"] < 1000 * (time.perf_counter() - began)
        assert view["n"] == 7
        image = Image.open(io.BytesIO(base64.b64decode(view["image"])))
        assert (image.mode, image.size) == ("LA", (128, 128))
        gray, opaque = (np.asarray(band) for band in image.split())
        assert 0.02 < (opaque == 255).mean() < 0.9 < np.isin(opaque, (0, 255)).mean()  # but at its outline
        assert len(np.unique(gray[opaque == 255])) > 3  # surfaces that are lit
        assert len(view["derivative"]) == 6
        socket.send_json({"type": "curve", "pose": view["pose"]})
        parts = [json.loads(socket.receive_text()) for _ in range(5)]
        assert all({*part} - {"type"} == documented_fields("curve") for part in parts)
        assert [part["done"] for part in parts] == [False] * 4 + [True]
        curve = ElementTree.fromstring(parts[-1]["chart"]["svg"])
        points = [line.attrib["points"].split() for line in curve.iterfind(".//{*}polyline[@class='l-curve']")]
        similarities, derivatives = (np.array([point.split(",") for point in line], float) for line in points)
        assert len(similarities) == len(derivatives) == 181  # the circle is closed
        left, right = (share * float(curve.attrib["width"]) for share in parts[-1]["chart"]["across"])
        best = (similarities[similarities[:, 1].argmin(), 0] - left) / (right - left) * 360
        assert abs(best - TRUE) < 15
        socket.send_json({"type": "fit"})
        answers = until(socket, "fitted", "error")
        fitted = answers[-1]
        assert {answer["type"] for answer in answers[:-1]} == {"progress", "step"}
        assert abs(fitted["pose"][0] - TRUE) < 5
        assert abs(fitted["result"]["azimuth"] - TRUE) < 10  # for the middle of the photograph
        assert fitted["result"]["second"] == max(fitted["result"]["runners_up"], key=lambda rival: rival["confidence"])
        first, second = (
            Image.open(io.BytesIO(base64.b64decode(fitted[name]))) for name in ("overlay", "second_overlay")
        )
        assert first.size == second.size == (224, 224)
        assert first.tobytes() != second.tobytes()


def test_only_the_newest_pose_is_answered(client: TestClient) -> None:
    with client.websocket_connect(FIT) as socket:
        socket.send_json({"type": "open", **SCENE})
        until(socket, "ready")
        for n in range(40):
            socket.send_json({"type": "pose", "n": n, "pose": [n, 20, 3, 0, 0, 0]})
        answered = [json.loads(socket.receive_text())]
        while answered[-1]["n"] != 39:
            answered.append(json.loads(socket.receive_text()))
        numbers = [answer["n"] for answer in answered]
        assert numbers == sorted(numbers)


def test_it_is_stopped(client: TestClient) -> None:
    with client.websocket_connect(FIT) as socket:
        socket.send_json({"type": "open", **SCENE})
        until(socket, "ready")
        socket.send_json({"type": "fit", "method": "paper"})
        socket.send_json({"type": "stop"})
        assert until(socket, "stopped")[-1]["type"] == "stopped"


@pytest.mark.parametrize(
    ("message", "sentence"),
    [
        ("x", "expected JSON: "),
        ('{"type": "turn"}', "type must be one of"),
        ('{"type": "pose", "n": 1, "pose": [1]}', "pose must be 6 finite numbers"),
        ('{"type": "fit"}', "expected a photograph and a model first"),
        ('{"type": "open", "photo": "a", "mesh": "b"}', "the server no longer has this file"),
        (
            '{"type": "open", "photo": "sample-camera", "mesh": "chair-wooden-0", "box": [0, 0, 2, 2]}',
            "the box must be x0, y0",
        ),
        (
            '{"type": "pose", "n": 1, "pose": [0, 0, 3, 0, 0, 1000001]}',
            "each of pose must be a finite number in -1e+06",
        ),
        (
            '{"type": "pose", "n": 1, "pose": [-1000000, 0, 3, 0, 0, 1000000]}',
            "expected a photograph and a model first",
        ),
        ("x" * 16_384, "expected JSON: "),
        ("x" * 16_385, "expected a message of at most 16,384 characters"),
    ],
)
def test_a_sentence_says_what_is_wrong(client: TestClient, message: str, sentence: str) -> None:
    with client.websocket_connect(FIT) as socket:
        socket.send_text(message)
        answer = json.loads(socket.receive_text())
        assert answer["type"] == "error"
        assert answer["error"].startswith(sentence), answer


@pytest.mark.parametrize(
    ("asked", "shown"),
    [
        ((370, 91, 0.9, 5, 6, 7), [10, 90, 1, 5, 6, 7]),
        ((-10, -91, 101, 0, 0, 0), [350, -90, 100, 0, 0, 0]),
        ((0, 89, 1.1, 0, 0, 0), [0, 89, 1.1, 0, 0, 0]),
    ],
)
def test_poses_stay_within_what_can_be_rendered(asked: Pose, shown: list[float]) -> None:
    assert Fitting._poses(Mock(), asked, False).tolist() == [pytest.approx(shown)]


def test_the_camera_of_the_photograph(client: TestClient) -> None:
    asked = {**SCENE, "box": box(client), "initial": [30, 20], "method": "exhaustive"}
    lens = {"focal": [320, 300], "principal_point": [100, 120]}
    figures = client.post("/api/pose", json={**asked, **lens}).json()
    assert figures["photograph_camera"]["camera_matrix"] == [[320, 0, 100], [0, 300, 120], [0, 0, 1]]
    assert figures["principal_point"] == [100, 128]
    assert figures["box"] == box(client)
    answer = client.post("/api/pose", json={**asked, "principal_point": [100, 120]})
    assert answer.status_code == 422
    assert "needs a known focal length" in answer.json()["error"]


def test_a_calibrated_camera(client: TestClient) -> None:
    """The numbers of a camera's file are those of the photograph, in which it is undistorted."""
    asked = {**SCENE, "box": box(client)}
    file = "1 OPENCV 224 224 320 300 100 120 -0.2 0.05 0 0"
    numbers = client.post("/api/cameras?name=cameras.txt&photo=scene-chair", content=file).json()
    assert numbers == {"intrinsics": [320, 300, 100, 120], "distortion": [-0.2, 0.05, 0, 0, 0]}
    with client.websocket_connect(FIT) as socket:
        socket.send_json({"type": "open", **asked, **numbers})
        until(socket, "ready")
        socket.send_json({"type": "fit", "initial": [30, 20], "method": "exhaustive"})
        fitted = until(socket, "fitted", "error")[-1]
    camera = fitted["result"]["photograph_camera"]
    assert camera["camera_matrix"] == [[320, 0, 100], [0, 300, 120], [0, 0, 1]]
    assert camera["dist_coeffs"] == numbers["distortion"]
    assert "intrinsics=(320.0, 300.0, 100.0, 120.0), distortion=(-0.2, 0.05" in fitted["snippets"]["python"]
    figures = client.post("/api/pose", json={**asked, **numbers, "initial": [30, 20], "method": "exhaustive"}).json()
    assert figures["azimuth"] == fitted["result"]["azimuth"]


def test_no_camera_of_another_photograph(client: TestClient) -> None:
    answer = client.post("/api/cameras?name=a.txt&photo=scene-chair", content="1 PINHOLE 448 448 640 600 200 240")
    assert answer.status_code == 422
    assert "a.txt: `intrinsics` is for photographs of 448x448 pixels" in answer.json()["error"]
    assert "320,300,100,120" in answer.json()["error"]
    for intrinsics in ("cameras.txt", [320, 300]):
        answer = client.post("/api/pose", json={**SCENE, "intrinsics": intrinsics})
        assert answer.status_code == 422
        assert "intrinsics must be a camera matrix (3, 3), or fx, fy, cx, cy" in answer.json()["error"]


def test_no_similarity_is_computed_that_nobody_gets(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Fitting, "similarity", None)
    asked = {**SCENE, "box": box(client), "initial": [30, 20], "method": "best"}
    answer = client.post("/api/pose", json=asked)
    assert answer.status_code == 200, answer.text
