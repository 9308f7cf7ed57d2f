"""Mutated requests to each address: one sentence each, no traceback, and the server goes on."""

from __future__ import annotations

import json
import random
from typing import Any
from urllib.parse import quote

from starlette.testclient import TestClient

from .conftest import HOST

JSON: dict[str, dict[str, Any]] = {
    "/api/hog": {"photo": "sample-camera", "preset": "uoctti", "settings": {"cell_size": "16"}, "size": 64},
    "/api/invert": {"photo": "sample-camera", "preset": "paper", "size": 32, "quality": "fast", "prior": "none"},
    "/api/pose": {"photo": "scene-chair", "mesh": "chair-wooden-0", "box": [0, 0, 100, 100], "initial": [0, 20]},
}
UPLOADS = [
    "/api/photos?name=a.png",
    "/api/descriptors?name=a.npy&preset=uoctti",
    "/api/meshes?name=a.off",
    "/api/cameras?photo=scene-chair&name=a.json",
]
GETS = [
    "/api/photos/sample-camera?size=64",
    "/api/hog/x/cell?row=1&col=1",
    "/api/hog/x/file",
    "/static/main.js",
    "/api/about",
]
FIT = {"type": "pose", "n": 1, "pose": [0, 0, 3, 0, 0, 0], "place": True}
ODD = [None, True, -1, 0, 1e308, 10**30, "", "x" * 300, "../../etc/passwd", "\0", [], [[]] * 50, {}, {"a": {"b": []}}]


def mutated(value: Any, rng: random.Random) -> Any:
    """A copy with one value replaced, removed or added."""
    copy = json.loads(json.dumps(value))
    key = rng.choice([*copy, "more"])
    kind = rng.random()
    if kind < 0.2:
        copy.pop(key, None)
    elif isinstance(copy.get(key), dict) and kind < 0.6:
        copy[key] = mutated(copy[key], rng)
    else:
        copy[key] = rng.choice(ODD)
    return copy


def noise(text: bytes, rng: random.Random) -> bytes:
    """Bytes with some of them replaced, or cut off."""
    made = bytearray(text)
    for _ in range(rng.randint(1, 4)):
        made[rng.randrange(len(made))] = rng.randrange(256)
    return bytes(made[: rng.randint(0, len(made))])


def test_garbage(client: TestClient, photo_file: bytes) -> None:
    rng = random.Random(0)
    for _ in range(60):
        kind = rng.random()
        if kind < 0.4:
            address, asked = rng.choice([*JSON.items()])
            body = json.dumps(mutated(asked, rng)).encode()
            answer = client.post(address, content=noise(body, rng) if rng.random() < 0.4 else body)
        elif kind < 0.6:
            answer = client.post(rng.choice(UPLOADS), content=noise(photo_file, rng))
        elif kind < 0.85:
            address = noise(rng.choice(GETS).encode(), rng).decode("latin-1")
            answer = client.get("/" + quote(address.lstrip("/"), safe="/?=&%"))
        else:
            method = rng.choice(["PUT", "DELETE", "PATCH", "POST", "HEAD", "OPTIONS"])
            answer = client.request(method, rng.choice(GETS))
        assert answer.status_code < 500 or answer.status_code == 503, answer.content
        if answer.headers.get("content-type", "").startswith("application/json") and answer.status_code >= 400:
            assert not answer.content or {*answer.json()} <= {"error", "question"}, answer.content
            assert b"Traceback" not in answer.content
    for number in range(6):
        text = json.dumps(mutated(FIT, rng)) if number % 2 else noise(json.dumps(FIT).encode(), rng).decode("latin-1")
        with client.websocket_connect(f"ws://{HOST}/api/fit") as socket:
            socket.send_text(text)
            assert json.loads(socket.receive_text())["type"] in ("error", "stopped")
    assert client.get("/api/about").status_code == 200
