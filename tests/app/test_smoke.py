"""The page, a photograph that is uploaded, and its descriptor."""

from __future__ import annotations

from starlette.testclient import TestClient


def test_a_photograph(client: TestClient, photo_file: bytes) -> None:
    assert "<html" in client.get("/").text
    photo = client.post("/api/photos?name=noise.png", content=photo_file).json()["id"]
    answer = client.post("/api/hog", json={"photo": photo, "preset": "uoctti", "settings": {}})
    assert answer.status_code == 200
    assert answer.json()["shape"] == [8, 6, 31]  # of 64x48 pixels
    assert client.post("/api/hog", json={"photo": photo, "preset": "none", "settings": {}}).status_code == 422
