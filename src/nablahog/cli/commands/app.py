"""``nablahog app``: starts the server, and says where its page is."""

from __future__ import annotations

import secrets
from argparse import Namespace
from pathlib import Path

from ...io.images import read_exif_focal, read_image
from ...runtime.extras import extra
from ..terminal import say

LOOPBACK = ("127.0.0.1", "localhost", "::1")


def app(arguments: Namespace) -> None:
    """Serves the page until it is interrupted."""
    with extra("app", "the page"):
        import uvicorn

        from ...app.access import AccessRules
        from ...app.server import listen, make_app
        from ...app.store import Photograph
    photographs = [
        Photograph(Path(path).name, read_image(path), focal=read_exif_focal(path)) for path in arguments.photos
    ]
    listening = listen(arguments.host, arguments.port)
    port = listening.getsockname()[1]
    token = None if arguments.host in LOOPBACK else secrets.token_urlsafe(24)
    shown = f"[{arguments.host}]" if ":" in arguments.host else arguments.host
    hosts = frozenset(f"{name}:{port}" for name in ("127.0.0.1", "localhost", "[::1]"))
    page = make_app(AccessRules(hosts, token), photographs)
    query = "" if token is None else f"?token={token}"
    say(f"The page is at http://{shown}:{port}/{query} until Ctrl-C")
    config = uvicorn.Config(
        page, log_level="error", ws="websockets-sansio", ws_max_size=2**16, timeout_graceful_shutdown=2
    )
    uvicorn.Server(config).run([listening])
