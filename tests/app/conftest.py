from __future__ import annotations

import io
from collections.abc import Iterator

import numpy as np
import pytest
import skimage.io  # noqa: F401  (here: its first import changes the filters of warnings, of all threads, for a moment)
from PIL import Image
from starlette.testclient import TestClient

from nablahog.app.access import AccessRules
from nablahog.app.server import make_app

HOST = "127.0.0.1:8765"


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
