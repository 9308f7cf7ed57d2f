from __future__ import annotations

import io
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import skimage.io  # noqa: F401  (here: its first import changes the filters of warnings, of all threads, for a moment)
from numpy.typing import NDArray
from PIL import Image
from starlette.testclient import TestClient

from nablahog.app.access import AccessRules
from nablahog.app.server import make_app

HOST = "127.0.0.1:8765"
EVENTS = Path(__file__).parents[2] / "docs" / "app_events.md"


def documented_fields(event: str) -> set[str]:
    """The fields of an event of a stream on the page that describes them."""
    section = EVENTS.read_text(encoding="utf-8").split(f"\n### {event}\n")[1].split("\n### ")[0]
    return {name for row in re.findall(r"^\| (`.*?) \|", section, re.MULTILINE) for name in re.findall(r"`(\w+)`", row)}


def npy(array: NDArray[Any]) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def npz(**arrays: NDArray[Any]) -> bytes:
    file = io.BytesIO()
    np.savez(file, **arrays)  # type: ignore[arg-type]
    return file.getvalue()


@pytest.fixture(scope="module")
def client() -> Iterator[TestClient]:
    """A page of a server on the loopback."""
    with TestClient(make_app(AccessRules(frozenset({HOST}), None)), base_url=f"http://{HOST}") as made:
        yield made


@pytest.fixture(scope="session")
def photo_file() -> bytes:
    """A PNG file of 64x48 pixels, height first."""
    levels = np.random.default_rng(0).integers(0, 256, (64, 48, 3), dtype=np.uint8)
    file = io.BytesIO()
    Image.fromarray(levels).save(file, format="PNG")
    return file.getvalue()


@pytest.fixture
def photo(client: TestClient, photo_file: bytes) -> str:
    """Its id after it was uploaded."""
    answer = client.post("/api/photos?name=noise.png", content=photo_file)
    assert answer.status_code == 200
    key: str = answer.json()["id"]
    return key
