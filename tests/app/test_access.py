"""Access control: which requests are refused, and how large they may be."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

import nablahog
from nablahog.app import access
from nablahog.app.access import HEADERS, AccessRules
from nablahog.app.server import make_app

from .conftest import HOST

STATIC = Path(nablahog.__file__).parent / "app" / "static"


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"host": "evil.example"}, 421),  # a name that now resolves to the loopback
        ({"origin": "http://evil.example"}, 403),
        ({"origin": "null"}, 403),
        ({"host": "127.0.0.1:9000", "origin": "http://127.0.0.1:9000"}, 200),  # ssh -L 9000:localhost:8765
        ({"host": "evil.example:8765"}, 421),
        ({"origin": "https://hub.example", "x-forwarded-host": "hub.example"}, 200),  # a proxy in front
        ({"origin": f"http://{HOST}"}, 200),
        ({"sec-fetch-site": "cross-site"}, 403),
        ({"sec-fetch-site": "none"}, 200),
    ],
)
def test_other_sites_are_refused(client: TestClient, headers: dict[str, str], status: int) -> None:
    answer = client.get("/api/about", headers=headers)
    assert answer.status_code == status
    assert status == 200 or "error" in answer.json()


def test_a_link_to_the_page_may_be_anywhere(client: TestClient) -> None:
    assert client.get("/", headers={"sec-fetch-site": "cross-site"}).status_code == 200


def test_the_page_may_be_behind_a_path(client: TestClient) -> None:
    """All addresses are relative: those at a host's root would be another page's."""
    page = client.get("/").text
    scripts = [path.read_text() for path in STATIC.glob("*.js")]
    assert not re.findall(r'(?:src|href)="/', page)
    assert not [script for script in scripts if re.search(r"""["'`]/(api|static)/""", script)]


def test_sockets_of_other_sites_are_refused(client: TestClient) -> None:
    with (
        pytest.raises(WebSocketDisconnect),
        client.websocket_connect(f"ws://{HOST}/api/fit", headers={"origin": "http://evil"}),
    ):
        pass


def test_the_page_is_offline_by_its_heads(client: TestClient) -> None:
    for address in ("/", "/static/main.js", "/api/about", "/api/nothing"):
        headers = client.get(address).headers
        assert {name: headers.get(name) for name in HEADERS} == dict(HEADERS)
    assert "http" not in HEADERS["content-security-policy"]


@pytest.mark.parametrize(
    "path", ["/static/..%2fserver.py", "/static/../server.py", "/static/", "/static/nothing.js", "/etc/passwd"]
)
def test_no_path_is_taken_from_a_request(client: TestClient, path: str) -> None:
    assert client.get(path).status_code == 404


def test_too_large(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(access, "MOST_UPLOAD_BYTES", 70_000)
    for path, most in (("hog", 65_536), ("cameras", 65_536), *((path, 70_000) for path in ("photos", "meshes"))):
        answer = client.post(f"/api/{path}", content=b"x" * (most + 1))
        assert (answer.status_code, answer.json()) == (413, {"error": f"expected at most {most:,} bytes"})
        assert client.post(f"/api/{path}", content=b"x" * most).status_code in (400, 422)  # for what is in it

    def pieces() -> Iterator[bytes]:
        for _ in range(70):
            yield b"x" * 1000

    assert client.post("/api/hog", content=pieces()).status_code == 413  # that does not say how long it is


def test_the_token() -> None:
    rules = AccessRules(frozenset({HOST}), "secret")
    with TestClient(make_app(rules), base_url="http://192.168.0.7:8765") as far:
        assert far.get("/").status_code == 401
        assert far.get("/?token=secret").status_code == 200
        assert far.get("/api/about").status_code == 401
        assert far.get("/api/about", headers={"x-nablahog-token": "guess"}).status_code == 401
        assert far.get("/api/about", headers={"x-nablahog-token": "secret"}).status_code == 200
        with far.websocket_connect("/api/fit?token=secret") as socket:
            socket.send_text("x")
        with pytest.raises(WebSocketDisconnect), far.websocket_connect("/api/fit"):
            pass
