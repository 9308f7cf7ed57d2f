"""``nablahog app``: starts the server, and says where its page is."""

from __future__ import annotations

import errno
import secrets
import socket
from argparse import Namespace
from pathlib import Path

from ..cli.terminal import say
from ..io.images import read_exif_focal, read_image
from ..runtime.extras import extra

LOOPBACK = ("127.0.0.1", "localhost", "::1")


def app(arguments: Namespace) -> None:
    """Serves the page until it is interrupted."""
    with extra("app", "the page"):
        import uvicorn

        from .access import AccessRules
        from .server import make_app
        from .store import Photograph
    photographs = [
        Photograph(Path(path).name, read_image(path), focal=read_exif_focal(path)) for path in arguments.photos
    ]
    listening = listen(arguments.host, arguments.port)
    port = listening.getsockname()[1]
    token = None if arguments.host in LOOPBACK else secrets.token_urlsafe(24)
    shown = f"[{arguments.host}]" if ":" in arguments.host else arguments.host
    hosts = frozenset(f"{name}:{port}" for name in ("127.0.0.1", "localhost", "[::1]"))
    made = make_app(AccessRules(hosts, token), photographs)
    query = "" if token is None else f"?token={token}"
    say(f"The page is at http://{shown}:{port}/{query} until Ctrl-C")
    config = uvicorn.Config(
        made, log_level="error", ws="websockets-sansio", ws_max_size=2**16, timeout_graceful_shutdown=2
    )
    uvicorn.Server(config).run([listening])


def listen(host: str, port: int) -> socket.socket:
    """A socket that listens; the connections that it accepts send at once."""
    try:
        made = socket.create_server((host, port), family=socket.AF_INET6 if ":" in host else socket.AF_INET)
    except OSError as error:
        reason = (error.strerror or str(error)).partition(" (while")[0]  # Python repeats the address
        free = "; --port 0 takes a free one" if error.errno == errno.EADDRINUSE else ""
        raise ValueError(f"cannot listen at {host}, port {port}: {reason}{free}") from None
    # asyncio does so only for sockets that name their protocol: the end of an answer would wait for 40 ms
    made.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return made
