"""A pre-image that grows, and its end."""

from __future__ import annotations

import base64
import io
import json
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from starlette.testclient import TestClient

from nablahog.app import invert as invert_module
from nablahog.app import store as store_module
from nablahog.app.invert import invert
from nablahog.app.messages import InvertMessage
from nablahog.app.store import Store, requested_descriptor
from nablahog.app.uploads import store_photograph
from nablahog.app.work_queue import Cancelled, CancelToken
from nablahog.invert import Reconstruction
from nablahog.invert.prior import choice
from nablahog.requests.sources import from_photo

from .conftest import documented_fields, npy

Event = tuple[str, dict[str, Any]]


def events(client: TestClient, **asked: object) -> list[Event]:
    fast = {} if asked.get("method") == "paper" else {"quality": "fast"}
    answer = client.post("/api/invert", json={**fast, **asked})
    assert answer.status_code == 200, answer.text
    return [read(block) for block in answer.text.strip().split("\n\n")]


def read(block: str) -> Event:
    name, data = block.split("\n")
    return name.removeprefix("event: "), json.loads(data.removeprefix("data: "))


def picture(text: str) -> Image.Image:
    return Image.open(io.BytesIO(base64.b64decode(text)))


@pytest.mark.parametrize(
    ("preset", "asked"),
    [
        pytest.param("paper", {"method": "paper"}, marks=pytest.mark.slow),
        pytest.param("paper", {}, marks=pytest.mark.slow),
        ("uoctti", {}),
        ("uoctti", {"prior": "none"}),
    ],
)
def test_it_grows(client: TestClient, photo: str, preset: str, asked: dict[str, str]) -> None:
    made = events(client, photo=photo, preset=preset, **asked)
    names = [name for name, _ in made]
    assert names[:2] == ["queued", "start"]
    assert names[-1] == "done"
    assert {*names[2:-1]} == {"frame"}
    assert all({*data} == documented_fields(name) for name, data in made)
    start, done = made[1][1], made[-1][1]
    assert (start["image_size"], picture(start["photograph"]).size) == ([64, 48], (48, 64))
    assert all(picture(frame["image"]).size == (48, 64) for name, frame in made if name == "frame")
    assert picture(done["image"]).size == (48, 64)
    assert all(-1 <= done[name] <= 1 for name in ("cc", "ssim"))
    assert (done["polarity"] is None) == (done["faded"] is None) == (preset == "uoctti" or asked != {})
    assert done["faded"] is None or picture(done["faded"]).size == (48, 64)
    assert 0 < len(done["history"]) <= 200
    assert "distance" in done["definitions"]


def test_going_on(client: TestClient, photo: str) -> None:
    done = events(client, photo=photo, prior="none")[-1][1]
    again = events(client, photo=photo, prior="none", start=done["id"], seed=1)[-1]
    assert again[0] == "done"
    name, refused = events(client, photo=photo, start="sample-camera")[-1]
    assert (name, refused["error"]) == ("error", "an image to continue from must have 64x48 pixels, got 512x512")


def test_without_the_priors_of_the_package(
    client: TestClient, photo: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As without a prior."""
    without = events(client, photo=photo, size=24, prior="none")[-1][1]
    monkeypatch.setattr(choice, "PRIOR_FOLDER", tmp_path)
    name, done = events(client, photo=photo, size=24)[-1]
    assert (name, done.get("image")) == ("done", without["image"])


def test_a_descriptor_alone(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    file = npy(np.random.default_rng(0).random((4, 3, 31), dtype=np.float32))
    of = client.post("/api/descriptors?name=d.npy&preset=uoctti", content=file).json()
    monkeypatch.setattr(invert_module, "INVERT_SIZE", 32)
    done = events(client, descriptor=of["id"])[-1][1]
    assert (done["cc"], done["ssim"]) == (None, None)
    assert done["snippets"]["command"] == "nablahog invert d.npy -o out --preset uoctti --quality fast"
    monkeypatch.setattr(invert_module, "INVERT_SIZE", 31)
    name, refused = events(client, descriptor=of["id"])[-1]
    assert (name, refused["error"]) == ("error", "expected an image of at most 31 pixels a side, got 32x24")


def test_a_template(client: TestClient) -> None:
    """It excludes what its search does not have."""
    file = npy(np.random.default_rng(0).standard_normal((4, 4, 31)).astype(np.float32))
    of = client.post("/api/descriptors?name=w.npy&preset=uoctti&as=template", content=file).json()["id"]
    kind, done = events(client, descriptor=of, seed=3, quality="best")[-1]
    command = "nablahog invert w.npy -o out --preset uoctti --template --seed 3"
    assert (kind, done["snippets"]["command"]) == ("done", command)
    assert "reconstruct_template(weights[None], spec, size, seed=3)" in done["snippets"]["python"]
    for asked in ({"quality": "fast"}, {"method": "paper"}, {"start": "sample-camera"}):
        answer = client.post("/api/invert", json={"descriptor": of, **asked})
        assert answer.status_code == 422
        assert "template" in answer.json()["error"]


def test_what_is_sure_is_not_faded_and_has_no_negative(
    client: TestClient, photo: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def sure(*arguments: Any) -> Reconstruction:
        results.append(results[0] if results else search(*arguments))
        result = results[0]
        regions, whole = torch.full_like(result.image, 0.8), torch.tensor([polarity], dtype=torch.float64)
        return replace(result, region_confidence=regions, polarity_confidence=whole)

    search, results = invert_module._search, list[Reconstruction]()
    monkeypatch.setattr(invert_module, "_search", sure)
    for polarity in (0.79, 0.8):
        done = events(client, photo=photo, preset="paper", size=24)[-1][1]
        assert done["faded"] == done["image"]
        assert (done["polarity"], done["negative"] is None) == (polarity, polarity == 0.8)
        if done["negative"] is not None:
            both = np.asarray(picture(done["negative"])).astype(int) + np.asarray(picture(done["image"]))
            assert np.abs(both - 255).max() <= 1


def test_it_ends_when_nobody_waits(photo_file: bytes) -> None:
    store, cancel, seen = Store(b""), CancelToken(), threading.Event()
    key = store_photograph(photo_file, "p.png", {}, store)["id"]
    request = InvertMessage(photo=key, prior="none")

    def send(event: Event) -> None:
        if event[0] == "frame":
            seen.set()
            cancel.cancel()

    with pytest.raises(Cancelled):
        invert(request, requested_descriptor(request, store), store, send, cancel)
    assert seen.is_set()


def test_a_photograph_is_described_once_and_not_on_the_event_loop(
    client: TestClient, photo: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    threads: list[str] = []

    def described(*arguments: Any, **options: Any) -> Any:
        threads.append(threading.current_thread().name)
        return from_photo(*arguments, **options)

    monkeypatch.setattr(store_module, "from_photo", described)
    assert events(client, photo=photo)[-1][0] == "done"
    assert [name.partition("_")[0] for name in threads] == ["quick"]
